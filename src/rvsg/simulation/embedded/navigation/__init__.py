"""The navigation stack: costmaps, planners, controllers, behaviour tree."""
