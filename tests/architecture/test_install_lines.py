"""Pages and messages show one way to install what is optional: into the environment of the README, or from wheels."""

from __future__ import annotations

import re
import tomllib

import pytest
from tests.architecture.size import ROOT

from rvsg.core import errors
from rvsg.core.errors import how_to_install

READ = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "src").rglob("*.py")]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
FORM = r"\.venv/bin/pip install -c constraints\.txt -e '\.\[{}\]'"


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_command_installs_an_extra_into_the_environment_of_the_readme(extra: str) -> None:
    assert re.search(FORM.format(extra), how_to_install(extra))


def test_where_there_is_no_clone_the_command_installs_from_wheels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "CONSTRAINTS", ROOT / "absent")
    said = how_to_install("studio")
    assert said == "pip install --find-links FOLDER_OF_WHEELS 'rvsg[studio]' rvsg-studio"


def test_ci_installs_a_checkout_with_its_constraints() -> None:
    for path in (".github/actions/rvsg-suite/action.yml", "examples/ci/gitlab-ci.yml"):
        installed = re.findall("pip install (.*)", (ROOT / path).read_text(encoding="utf-8"))
        assert len(installed) == 1 and installed[0].startswith('-c "$RVSG/constraints.txt" "'), path


def test_what_is_optional_is_installed_in_one_way() -> None:
    for path in READ:
        text = path.read_text(encoding="utf-8")
        assert "rvsg[" not in re.sub(r".*pip install --find-links .*", "", text), path
        assert text.count("-e '.[") == len(re.findall(FORM.format(r"[\w{}]+"), text)), path
        named = re.findall(FORM.format(r"(\w+)"), text) + re.findall(r"how_to_install\([\"'](\w+)[\"']\)", text)
        assert set(named) <= set(EXTRAS), path
