"""Metrics: numbers that are read off one run, those that ship and those of plug-ins."""

from rvsg.evaluation.metrics.measurement import METRICS, find_metric, measure, metric
from rvsg.evaluation.metrics.metric import Metric

__all__ = ["METRICS", "Metric", "find_metric", "measure", "metric"]
