"""Metrics: numbers that are read off one run, those that ship and those of plug-ins."""

from rvsg.evaluation.metrics.metric import Metric
from rvsg.evaluation.metrics.registry import METRICS, find_metric, measure, metric

__all__ = ["METRICS", "Metric", "find_metric", "measure", "metric"]
