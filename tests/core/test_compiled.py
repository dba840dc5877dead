"""The cache of compiled kernels: what it is addressed by."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
from rvsg.core.compiled import inner, kernel
from rvsg.simulation import constants_of_test as constants

LIMIT = 2.0

@inner
def scaled(x):
    return constants.FACTOR * x

@kernel
def limited(x):
    return min(LIMIT, scaled(x))
"""
PACKAGE = "import rvsg.simulation, sys; rvsg.simulation.__path__.append({folder!r})\n"


def run(folder: Path, cache: Path, code: str) -> str:
    """What a fresh process prints that has the module of this test in rvsg.simulation."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    text = PACKAGE.format(folder=str(folder)) + code
    done = subprocess.run([sys.executable, "-c", text], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


CALL = "from rvsg.simulation import kernels_of_test as m; from rvsg.core.compiled import is_cached\n"
LOOK = CALL + "print(is_cached(m.limited), is_cached(m.scaled))"
USE = CALL + "print(m.limited(1.5))"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    folder = tmp_path / "one"
    folder.mkdir()
    (folder / "kernels_of_test.py").write_text(MODULE)
    (folder / "constants_of_test.py").write_text("FACTOR = 1.0\n")
    return folder


@pytest.mark.slow
class TestCache:
    def test_a_copy_of_the_sources_elsewhere_and_younger_loads_what_is_compiled(self, place: Path) -> None:
        cache = place.parent / "cache"
        assert run(place, cache, LOOK) == "False False"
        assert run(place, cache, USE) == "1.5"
        other = place.parent / "two"
        shutil.copytree(place, other)
        (other / "kernels_of_test.py").touch()
        assert run(other, cache, LOOK) == "True True"

    def test_a_changed_constant_of_another_module_makes_code_obsolete(self, place: Path) -> None:
        cache = place.parent / "cache"
        run(place, cache, USE)
        (place / "constants_of_test.py").write_text("FACTOR = 1.2\n")
        assert run(place, cache, LOOK) == "False False"
        assert run(place, cache, USE) == "1.7999999999999998"

    def test_a_changed_callee_makes_its_callers_obsolete_and_not_the_reverse(self, place: Path) -> None:
        cache = place.parent / "cache"
        run(place, cache, USE)
        (place / "kernels_of_test.py").write_text(MODULE.replace("LIMIT = 2.0", "LIMIT = 1.0"))
        assert run(place, cache, LOOK) == "False True"
        (place / "kernels_of_test.py").write_text(MODULE.replace("FACTOR * x", "FACTOR + x"))
        assert run(place, cache, LOOK) == "False False"

    def test_a_patched_constant_does_not_reach_other_processes(self, place: Path) -> None:
        cache = place.parent / "cache"
        patched = CALL + "m.constants.FACTOR = 4.0; m.LIMIT = 9.0; print(m.limited(1.5))"
        assert run(place, cache, patched) == "6.0"
        assert run(place, cache, USE) == "1.5"

    def test_a_constant_patched_while_another_kernel_was_compiled_does_not_either(self, place: Path) -> None:
        cache = place.parent / "cache"
        patched = CALL + "m.constants.FACTOR = 4.0; m.limited(1.5); m.constants.FACTOR = 1.0; "
        # For a float numba keeps the factor it compiled first, for an integer it compiles again.
        assert run(place, cache, patched + "print(m.limited(0.1), m.limited(1))") == "0.4 1.0"
        call_both = CALL + "print(m.limited(0.1), m.limited(1))"
        assert run(place, cache, CALL + "m.constants.FACTOR = 4.0; print(m.limited(1))") == "2.0"
        assert run(place, cache, call_both) == "0.1 1.0"


def test_the_simulators_loop_is_kept() -> None:
    from rvsg.simulation.embedded.episode import go_on

    cache = go_on._cache  # type: ignore[attr-defined]
    assert cache.content() and cache._is_unchanged(set())
