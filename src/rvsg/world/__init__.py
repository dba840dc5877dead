"""Worlds from maps, obstacles and labels; grids of named waypoints; pictures for people and models."""
