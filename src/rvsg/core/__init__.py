"""Records, ids, errors, seeds, plug-in look-up and files: what every other room uses."""
