"""Notes on findings: kept beside the campaign, the others untouched."""

from __future__ import annotations

from pathlib import Path

import pytest

from rvsg.core.errors import FileError
from rvsg_studio.workspace import FILE, Note, note, notes_of


def test_a_note_is_kept_and_changed_in_part(tmp_path: Path) -> None:
    assert notes_of(tmp_path).findings == {}
    note(tmp_path, "scenario-1", status="known", comment='<b>"quoted": [x]\nsecond line')
    note(tmp_path, "scenario-2", status="fixed")
    note(tmp_path, "scenario-1", status="accepted")
    assert notes_of(tmp_path).findings == {
        "scenario-1": Note(status="accepted", comment='<b>"quoted": [x]\nsecond line'),
        "scenario-2": Note(status="fixed"),
    }


def test_a_mistake_in_the_file_is_told_with_its_line_and_the_file_stays(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("findings:\n  scenario-1:\n    status: nwe\n")
    with pytest.raises(FileError) as error:
        note(tmp_path, "scenario-2", comment="x")
    assert (error.value.path, error.value.line) == (tmp_path / FILE, 3)
    assert "nwe" in (tmp_path / FILE).read_text()
