"""A campaign, or the results of a suite, as one file `.rvsg`: the report page, and the files it was made from.

The file is a JSON object, compressed with gzip. The viewer shows its page in a browser; `rvsg report`, `rvsg studio`
and the home page of the studio unpack its files. It may come from a stranger: it is checked, and nothing of it is run.
"""

from __future__ import annotations

import base64
import binascii
import gzip
import hashlib
import re
import tempfile
import zlib
from pathlib import Path
from typing import Literal

from markupsafe import Markup
from pydantic import Field

import rvsg
from rvsg.app.campaign import Campaign
from rvsg.app.folder import CONFIG, LEDGER, holds_several, store_of
from rvsg.app.input_files import INPUTS
from rvsg.core.documents import record_of
from rvsg.core.errors import FileError
from rvsg.core.files import write_whole
from rvsg.core.inputs import LARGEST_FILE, parse_json
from rvsg.core.records import Record
from rvsg.report.renderer import component, look, render, viewer_script
from rvsg.store.sqlite import SqliteLedger
from rvsg.suites.suite_folder import read_results

SUFFIX = ".rvsg"
RESULTS = "results.json"
LARGEST = 400_000_000
"""Bytes of a view, unpacked; the viewer has the same limit."""
MEMBER = re.compile(rf"({re.escape(LEDGER)}|{CONFIG}|notes\.yaml|{RESULTS}|({INPUTS}|vlm)(/[^./\\\0][^/\\\0]*)+)")
"""What the files of a view may be named; none lies outside the folder."""
_TEXTS = rb'(?:[\s,:0-9]++|"(?:[^"\\]++|\\.)*+"'
_SHAPE = re.compile(rb"\{" + _TEXTS + rb"|\{" + _TEXTS + rb"){0,400000}+\}){0,99}+\}")
"""A view as JSON: an object of few texts and of one object of texts."""


class View(Record):
    """The content of a `.rvsg` file."""

    format: Literal["rvsg-view"] = "rvsg-view"
    version: Literal[1] = 1
    made_by: str = rvsg.__version__
    page: str
    """The report page. The viewer takes its content and its data, and no script."""
    files: dict[str, str] = Field(min_length=1)
    """The content of each file as base64."""


def write_view(source: Path, out: Path) -> None:
    """Write the campaign of a folder, or a file of results of `rvsg suite run --json`, as a view.

    Raises:
        FileError: the folder holds no campaign, several, or one in another store; or the view would be too large.
    """
    if source.is_dir():
        page, files = _campaign(source)
    else:
        result = read_results(source)
        page, files = render("suite.html", result=result, look=Markup(look())), {RESULTS: source.read_bytes()}  # noqa: S704
    view = View(page=page, files={name: base64.b64encode(data).decode() for name, data in files.items()})
    data = view.model_dump_json().encode()
    if len(data) > LARGEST:
        raise FileError(source, f"this is too large for a view: {len(data):,} bytes; the most is {LARGEST:,}.")
    write_whole(out, gzip.compress(data, mtime=0))


def _campaign(folder: Path) -> tuple[str, dict[str, bytes]]:
    store = store_of(folder)
    if store is None or store[0] != "sqlite":
        wrong = "it keeps its campaign in another store than SQLite." if store else "it holds no campaign."
        hint = " It holds folders of campaigns: export one of these." if holds_several(folder) else ""
        raise FileError(folder, f"this folder cannot be exported as a view: {wrong}{hint}")
    page = Campaign.open(folder).report().read_text(encoding="utf-8")
    with SqliteLedger.existing(folder / LEDGER) as ledger:
        files = {LEDGER: ledger.snapshot()}
    found = [folder / CONFIG, folder / "notes.yaml", *(folder / INPUTS).rglob("*"), *(folder / "vlm").rglob("*")]
    names = {path.relative_to(folder).as_posix(): path for path in sorted(found) if path.is_file()}
    return page, files | {name: path.read_bytes() for name, path in names.items() if MEMBER.fullmatch(name)}


def unpack_view(path: Path, folder: Path | None = None) -> Path:
    """Write the files of a view into a new folder, by default beside it and named like it; return the folder.

    Raises:
        FileError: the file is damaged, too large, of another version or no view; or the folder exists.
    """
    folder = path.with_suffix("") if folder is None else folder
    view = read_view(path)
    if folder.exists():
        raise FileError(
            folder,
            f"this is there already, and {path.name} is unpacked into a new folder. Open the folder, or rename one.",
        )
    try:
        files = {name: base64.b64decode(text, validate=True) for name, text in view.files.items()}
    except (binascii.Error, ValueError):
        raise FileError(path, "this view is damaged: one of its files is not base64.", code="view-damaged") from None
    if wrong := next((name for name in files if not MEMBER.fullmatch(name)), None):
        raise FileError(path, f"no view holds a file of this name: {wrong[:80]!r}.", code="view-damaged")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as draft:
        for name, data in files.items():
            write_whole(Path(draft, "view", name), data)
        Path(draft, "view").rename(folder)
    return folder


def unpack_campaign(path: Path) -> Path:
    """Unpack the view of a campaign as `unpack_view` does; FileError where it holds the results of a suite."""
    if RESULTS in read_view(path).files:
        raise FileError(
            path,
            f"this holds the results of a suite, which the viewer and `rvsg studio {path}` open.",
            code="view-suite",
        )
    return unpack_view(path)


def read_view(path: Path) -> View:
    """Return the content of a view, checked; FileError as `unpack_view`."""
    try:
        with gzip.open(path) as file:
            data = file.read(LARGEST + 1)
    except gzip.BadGzipFile:
        raise FileError(
            path, "this is no .rvsg file. `rvsg export --to view` writes one.", code="view-foreign"
        ) from None
    except (EOFError, zlib.error):
        raise FileError(path, "this .rvsg file is damaged or cut off. Copy it again.", code="view-damaged") from None
    except OSError as error:
        raise FileError(path, f"the file cannot be read: {error.strerror}") from None
    if len(data) > LARGEST:
        raise FileError(path, f"this unpacks to more than {LARGEST:,} bytes, the most that a view may have.")
    if len(data) > LARGEST_FILE and not _SHAPE.fullmatch(data.strip()):
        # Told before it is parsed: lists of lists need twenty times their size.
        raise FileError(path, "this is large and holds other things than the files of a view.", code="view-damaged")
    value = parse_json(data.decode(errors="replace"), path)
    if not isinstance(value, dict) or value.get("format") != "rvsg-view":
        raise FileError(path, "this is no .rvsg file. `rvsg export --to view` writes one.", code="view-foreign")
    if value.get("version") != 1:
        by, other = str(value.get("made_by"))[:40], str(value.get("version"))[:40]
        raise FileError(
            path,
            f"this view has version {other}, made by RVSG {by}; RVSG {rvsg.__version__} reads version 1. Open it with "
            "that version.",
            code="view-version",
        )
    return record_of(path, value, View)


def viewer_page() -> str:
    """Return the viewer: a page that opens views in the browser, loads nothing from elsewhere and sends nothing."""
    script = f"\n{component()}\n{viewer_script(LARGEST)}\n"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return render("viewer.html", script=Markup(script), digest=digest, look=Markup(look()))  # noqa: S704 - our files
