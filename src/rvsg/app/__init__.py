"""The doors: configuration file, plug-in look-up, wiring, command line."""
