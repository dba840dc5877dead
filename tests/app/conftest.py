"""The terminal of the tests of the command line."""

from tests.cli.conftest import errors, terminal

__all__ = ["errors", "terminal"]
