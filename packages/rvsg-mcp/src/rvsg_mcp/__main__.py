"""`rvsg-mcp DIR`: tools for an assistant that speaks the Model Context Protocol, over standard input and output."""

from __future__ import annotations

import argparse
from pathlib import Path

from rvsg.core import permission
from rvsg_mcp.tools import server


def main() -> None:
    """Serve until the assistant leaves."""
    parser = argparse.ArgumentParser(prog="rvsg-mcp", description=(__doc__ or "").partition(": ")[2])
    parser.add_argument(
        "folder", metavar="DIR", type=Path, nargs="?", default=Path(), help="where it may read and write"
    )
    with permission.only_in_process(()):
        server(parser.parse_args().folder).run("stdio")


if __name__ == "__main__":
    main()
