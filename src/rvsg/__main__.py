"""`python -m rvsg` is the command line."""

import sys

from rvsg.cli import main

if __name__ == "__main__":
    sys.exit(main())
