"""Where the published study's data is: tests that read it are skipped, with a reason, where it is absent."""

from __future__ import annotations

import os
from pathlib import Path


def published_data() -> Path | None:
    """The folder that holds `published/`: by RVSG_PUBLISHED_DATA, else `shared/data` beside or above the checkout."""
    if "RVSG_PUBLISHED_DATA" in os.environ:
        folders = [Path(os.environ["RVSG_PUBLISHED_DATA"])]
    else:
        folders = [parent / "shared" / "data" for parent in Path(__file__).resolve().parents]
    return next((folder for folder in folders if (folder / "published").is_dir()), None)
