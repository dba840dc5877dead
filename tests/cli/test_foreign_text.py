"""Names that strangers chose, where they are shown: no terminal obeys them, no page of a service links or mentions."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest
from rich.table import Table

from rvsg.app.view import View, read_view
from rvsg.cli.console import harmless, print_json, say
from rvsg.core.errors import FileError
from rvsg.report.comparison_page import _plain
from rvsg_exchange.formats import _no_formula

HOSTILE = "\x1b]0;owned\x07\x9b31m\u202ename\r"


def test_no_terminal_obeys_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(HOSTILE)
    table.add_row(HOSTILE)
    say(HOSTILE)
    say(table)
    print_json({"name": HOSTILE})
    written = capsys.readouterr()
    assert "name" in written.err and not set("\x1b\x07\x9b\u202e\r") & set(written.err + harmless(HOSTILE))
    assert json.loads(written.out) == {"name": HOSTILE} and not set("\x1b\x07\x9b") & set(written.out)


@pytest.mark.parametrize(
    "mark", ["@somebody", "#12", "![x](", "[x](", "https://e.org", "www.e.org", "<img", " `", "a|b"]
)
def test_a_comment_of_a_pull_request_holds_text_alone(mark: str) -> None:
    assert mark not in _plain(f"a{mark} b") and _plain("tiago_omni (5 m)") == "tiago_omni (5 m)"


def test_a_table_holds_no_formula() -> None:
    assert [_no_formula(each) for each in ("=1+1", "@x", -1.5, "Anna")] == ["'=1+1", "'@x", -1.5, "Anna"]


def test_a_view_is_bounded_before_it_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "a.rvsg"
    path.write_bytes(gzip.compress(b'{"format":"rvsg-view","files":[' + b"[]," * 8_000_000 + b"[]]}", 1))
    with pytest.raises(FileError, match="other things"):
        read_view(path)
    view = View(page='<p>"\\' * 10, files={"config.json": "QUJD" * 5_500_000})
    path.write_bytes(gzip.compress(view.model_dump_json().encode(), 1))
    assert read_view(path) == view
