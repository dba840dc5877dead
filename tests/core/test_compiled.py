"""The cache of compiled kernels: what it is addressed by, and what it does with damage and with folders of others."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

from rvsg.core import kernels

MODULE = """
from rvsg.core.kernels import inner, kernel
from rvsg.simulation import constants_of_test as constants

LIMIT = 2.0

@inner(cached=True)
def scaled(x):
    return constants.FACTOR * x

@kernel
def limited(x):
    return min(LIMIT, scaled(x))
"""
CODE = """
import rvsg.simulation, sys; rvsg.simulation.__path__.append({folder!r})
from rvsg.simulation import kernels_of_test as m; from rvsg.core.kernels import is_cached, seal_cache
print(is_cached(m.limited), m.limited(1.5), sum(m.limited.stats.cache_hits.values())); seal_cache()
"""


def run(folder: Path) -> str:
    """What a fresh process prints that has the module of this test in rvsg.simulation: whether cached, result, hits."""
    # Python takes a module compiled in the same second for current where the source has as many characters.
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder.parent / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", CODE.format(folder=str(folder))]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture
def place(tmp_path: Path) -> Path:
    folder = tmp_path / "one"
    folder.mkdir()
    (folder / "kernels_of_test.py").write_text(MODULE)
    (folder / "constants_of_test.py").write_text("FACTOR = 1.0\n")
    return folder


@pytest.mark.slow
class TestCache:
    def test_a_second_process_finds_what_is_compiled(self, place: Path) -> None:
        assert run(place) == "False 1.5 0"
        (place / "kernels_of_test.py").touch()
        assert run(place) == "True 1.5 1"

    def test_a_changed_constant_of_another_module_makes_code_obsolete(self, place: Path) -> None:
        run(place)
        (place / "constants_of_test.py").write_text("FACTOR = 1.2\n")
        assert run(place) == "False 1.7999999999999998 0"

    @pytest.mark.parametrize("suffix", ["nbc", "nbi"])
    def test_a_damaged_file_is_removed_and_compiled_again(self, place: Path, suffix: str) -> None:
        run(place)
        (file,) = (place.parent / "cache").glob(f"*/*/*/kernels_of_test.limited-*.{suffix}")
        whole = file.read_bytes()
        middle = len(whole) // 2
        file.write_bytes(whole[:middle] if suffix == "nbi" else whole[:middle] + b"damage" + whole[middle + 6 :])
        assert run(place) == "False 1.5 0"
        assert run(place) == "True 1.5 1"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only place for a cache besides the temporary folder."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    return tmp_path / "home"


def folder() -> Path:
    return kernels.cache_folder.__wrapped__()


class TestFolder:
    def test_it_is_closed_to_others(self, home: Path) -> None:
        assert folder().parent == home
        assert folder().stat().st_mode & 0o777 == 0o700

    def test_one_that_others_may_write_is_not_used(self, home: Path) -> None:
        folder().chmod(0o777)
        assert folder().parent == home.parent / "other" / "rvsg"

    def test_one_of_another_owner_is_not_used(self, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        mine = folder()
        monkeypatch.setattr(os, "getuid", lambda: mine.stat().st_uid + 1)
        monkeypatch.setattr(Path, "home", lambda: home.parent)
        found = folder()
        assert found.parent.name.startswith("rvsg-kernels-")
        assert found.stat().st_mode & 0o777 == 0o700

    def test_a_link_is_not_used(self, home: Path) -> None:
        mine = folder()
        mine.rename(home / "elsewhere")
        mine.symlink_to(home / "elsewhere")
        assert folder().parent == home.parent / "other" / "rvsg"


def test_a_quarter_of_the_functions_is_told_with_the_time_left(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = folder()
    monkeypatch.setattr(kernels, "cache_folder", lambda: place)
    (place / "a" / "b").mkdir(parents=True)
    (place / "a" / "b" / "old.nbc").touch()
    told = list[str]()
    with kernels.compilation_reported(8, told.append, period_s=0.01):
        for k in range(9):
            (place / "a" / "b" / f"{k}.nbc").touch()
            time.sleep(0.05)
    counts = [int(re.match(r"compiled (\d) of about 8 functions, about \d+ s left", text)[1]) for text in told]
    assert counts == [2, 4, 6]


class TestNumba:
    """What RVSG needs of numba beyond its documented interface. Where one of these fails, bound numba's version."""

    def test_njit_knows_the_options(self) -> None:
        known = numba.njit(error_model="numpy", no_cpython_wrapper=False, no_cfunc_wrapper=True, _nrt=False)
        assert known(lambda x: 1.0 / x)(0.0) == float("inf")

    def test_an_option_that_numba_lacks_is_refused_at_the_first_call(self) -> None:
        with pytest.raises(KeyError, match="_no_such_option"):
            numba.njit(_no_such_option=False)(lambda x: x)(1.0)


def test_the_simulators_loop_is_kept() -> None:
    from rvsg.simulation.embedded.episode import go_on

    assert Path(go_on.stats.cache_path).is_relative_to(kernels.cache_folder())  # type: ignore[attr-defined]
