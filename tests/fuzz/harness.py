"""Runs one damaged input, and finds what is wrong with how it was received.

A finding is an exit code 4, an exception, a traceback, an output that is half written, a hang over a minute, memory
over 2 GB, or a damaged store that is reported as if it were whole.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import random
import resource
import shutil
import signal
import tempfile
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType

from tests.fuzz.kinds import KINDS, Kind
from tests.fuzz.mutate import damaged

HANG_S = 60
"""Seconds of processor time; the seconds of the clock depend on what else the machine does."""
STUCK_S = 600
"""Seconds of the clock, for a wait without end."""
MOST_MEMORY_KB = 2_000_000
BY_NAME = {kind.name: kind for kind in KINDS}


@dataclass(frozen=True)
class Outcome:
    """How an input was received; `finding` is empty where all is well."""

    code: int
    messages: str
    finding: str


class Hang(BaseException):
    """The time is up; no Exception, so that nothing catches it by the way."""


def received(kind: Kind, folder: Path) -> Outcome:
    """Let the program read the folder, and look at what it does."""
    out, messages = io.StringIO(), io.StringIO()
    code = 0
    try:
        with _time_limit(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(messages):
            code = kind.read(folder, "--debug")
    except Hang:
        finding = f"it hangs: more than {HANG_S} s"
    except BaseException:
        finding = traceback.format_exc()
    else:
        finding = _finding(kind, code, out.getvalue(), messages.getvalue(), folder)
    return Outcome(code, messages.getvalue(), finding)


def _finding(kind: Kind, code: int, output: str, messages: str, folder: Path) -> str:
    if code not in (0, 1, 2, 3):
        return f"exit code {code}:\n{messages[-3000:]}"
    if code == 2 and not messages.strip():
        return "refused without a message"
    if code == 2 and str(kind.command).startswith("world new") and (folder / "w" / "world.yaml").exists():
        return "refused, and world.yaml is written"
    if drafts := [path.name for path in folder.rglob(".*") if path.is_file() and path.name != ".lock"]:
        return f"left behind: {drafts}"
    if (used := resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) > MOST_MEMORY_KB:
        return f"{used} kB of memory"
    if kind.silent and code == 0 and _facts(output) != _facts_of_whole(kind):
        return "a damaged input is reported as if it were whole"
    return ""


@cache
def _facts_of_whole(kind: Kind) -> str:
    """What the command prints for the undamaged example."""
    with tempfile.TemporaryDirectory() as folder:
        kind.write(Path(folder))
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
            assert kind.read(Path(folder)) == 0
        return _facts(out.getvalue())


def _facts(output: str) -> str:
    """The JSON of a report without the paths of its folder."""
    with contextlib.suppress(ValueError):
        value = json.loads(output)
        return json.dumps({key: each for key, each in value.items() if "/" not in json.dumps(each)}, sort_keys=True)
    return output


def case(kind: Kind, seed: int, folder: Path) -> None:
    """Write the example of a kind with damage that follows from the seed."""
    chance = random.Random(f"{kind.name} {seed}")
    files = kind.write(folder)
    for file in chance.sample(files, 1 if chance.random() < 0.8 else min(2, len(files))):
        file.write_bytes(damaged(file.read_bytes(), chance))


def run_case(name: str, seed: int, *, keep: Path | None = None) -> Outcome:
    """Run the case of a seed; where it is a finding, its files are kept in a folder under `keep`."""
    with tempfile.TemporaryDirectory(prefix="fuzz") as made:
        folder = Path(made)
        case(BY_NAME[name], seed, folder)
        outcome = received(BY_NAME[name], folder)
    if outcome.finding and keep is not None:
        target = keep / name / hashlib.sha256(f"{name}{seed}".encode()).hexdigest()[:8]
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        case(BY_NAME[name], seed, target)
        (target / "finding.txt").write_text(f"{name} {seed}\n{outcome.finding}", errors="replace")
    return outcome


@contextlib.contextmanager
def _time_limit() -> Iterator[None]:
    def late(number: int, frame: FrameType | None) -> None:
        raise Hang

    before = [(number, signal.signal(number, late)) for number in (signal.SIGALRM, signal.SIGPROF)]
    signal.alarm(STUCK_S)
    signal.setitimer(signal.ITIMER_PROF, HANG_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        for number, handler in before:
            signal.signal(number, handler)
