"""A map, its obstacles and its labels become a World, then a Grid of named waypoints; draws what the VLM sees."""
