"""Tuning: settings of a stack over failures, their checks and what they show."""
