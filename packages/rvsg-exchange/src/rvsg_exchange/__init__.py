"""File formats of the field: read and write what other tools of mobile robotics understand."""
