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
    # Python takes a module compiled in the same second for current where the source has as many characters.
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    text = PACKAGE.format(folder=str(folder)) + code
    done = subprocess.run([sys.executable, "-c", text], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


CALL = "from rvsg.simulation import kernels_of_test as m; from rvsg.core.compiled import is_cached\n"
LOOK = CALL + "print(is_cached(m.limited), is_cached(m.scaled))"
USE = CALL + "print(m.limited(1.5))"
LOOK_AND_USE = LOOK + "; print(m.limited(1.5))"


def written(folder: Path) -> Path:
    folder.mkdir()
    (folder / "kernels_of_test.py").write_text(MODULE)
    (folder / "constants_of_test.py").write_text("FACTOR = 1.0\n")
    return folder


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return written(tmp_path / "one")


@pytest.fixture(scope="module")
def _used(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("used")
    assert run(written(root / "one"), root / "cache", LOOK_AND_USE) == "False False\n1.5"
    return root


@pytest.fixture
def used(_used: Path, tmp_path: Path) -> Path:
    """A copy of the module in another place, with a cache that holds it compiled."""
    return Path(shutil.copytree(_used, tmp_path / "used")) / "one"


@pytest.mark.slow
class TestCache:
    def test_a_copy_of_the_sources_elsewhere_and_younger_loads_what_is_compiled(self, used: Path) -> None:
        (used / "kernels_of_test.py").touch()
        assert run(used, used.parent / "cache", LOOK) == "True True"

    def test_a_changed_constant_of_another_module_makes_code_obsolete(self, used: Path) -> None:
        (used / "constants_of_test.py").write_text("FACTOR = 1.2\n")
        assert run(used, used.parent / "cache", LOOK_AND_USE) == "False False\n1.7999999999999998"

    def test_a_changed_callee_makes_its_callers_obsolete_and_not_the_reverse(self, used: Path) -> None:
        cache = used.parent / "cache"
        (used / "kernels_of_test.py").write_text(MODULE.replace("LIMIT = 2.0", "LIMIT = 1.0"))
        assert run(used, cache, LOOK) == "False True"
        (used / "kernels_of_test.py").write_text(MODULE.replace("FACTOR * x", "FACTOR + x"))
        assert run(used, cache, LOOK) == "False False"

    def test_a_patched_constant_does_not_reach_other_processes(self, place: Path) -> None:
        cache = place.parent / "cache"
        patched = CALL + "m.constants.FACTOR = 4.0; m.LIMIT = 9.0; print(m.limited(1.5))"
        assert run(place, cache, patched) == "6.0"
        assert run(place, cache, USE) == "1.5"

    @pytest.mark.exhaustive
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
