"""RVSG: find, confirm and explain the human behaviours that make a mobile robot violate its requirements.

The folders stand in the order the data flows, each owns the record it produces, and a folder imports
only folders upstream of it::

    world <- scenario <- (generation | simulation) <- evaluation <- campaign <- store <- report <- app

Importing this package loads no simulator, database or client of a vision language model.
"""

__version__ = "0.1.0"
__all__ = ["__version__"]
