"""Robots as records: body, drive, limits, sensors and the parameters of the navigation stack."""
