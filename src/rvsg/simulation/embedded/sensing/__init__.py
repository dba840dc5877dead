"""Lidars, what the costmaps learn from them, and localisation."""
