"""Local planners."""
