"""Runs one damaged input, and says what is wrong with how it was received.

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

from rvsg.cli import main

HANG_S = 60
"""Seconds of processor time; the seconds of the clock depend on what else the machine does."""
STUCK_S = 600
"""Seconds of the clock, for a wait without end."""
MOST_MEMORY_KB = 2_000_000


@dataclass(frozen=True)
class Outcome:
    """How an input was received; `finding` is empty where all is well."""

    code: int
    output: str
    messages: str
    finding: str = ""


class Hang(BaseException):
    """The time is up; no Exception, so that nothing catches it by the way."""


def kind_of(name: str) -> Kind:
    """Return the kind of that name."""
    return next(kind for kind in KINDS if kind.name == name)


def received(kind: Kind, folder: Path) -> Outcome:
    """Let the program read the folder, and look at what it does."""
    out, messages = io.StringIO(), io.StringIO()
    code = 0
    try:
        with _time_limit(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(messages):
            if kind.call is not None:
                kind.call(folder)
            elif kind.argv is not None:
                code = main(["--debug", *kind.argv(folder)])
    except Hang:
        return Outcome(code, out.getvalue(), messages.getvalue(), f"it hangs: more than {HANG_S} s")
    except BaseException:
        return Outcome(code, out.getvalue(), messages.getvalue(), traceback.format_exc())
    outcome = Outcome(code, out.getvalue(), messages.getvalue())
    return Outcome(code, outcome.output, outcome.messages, _finding(kind, outcome, folder))


def _finding(kind: Kind, outcome: Outcome, folder: Path) -> str:
    if outcome.code not in (0, 1, 2, 3):
        return f"exit code {outcome.code}:\n{outcome.messages[-3000:]}"
    if outcome.code == 2 and not outcome.messages.strip():
        return "refused without a message"
    if outcome.code == 2 and (
        half := [path for path in folder.glob("w/world.yaml") if kind.argv and "new" in kind.argv(folder)]
    ):
        return f"refused, and {half[0].name} is written"
    if drafts := [path.name for path in folder.rglob(".*") if path.is_file() and path.name not in (".lock",)]:
        return f"left behind: {drafts}"
    if (used := resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) > MOST_MEMORY_KB:
        return f"{used} kB of memory"
    if kind.silent and outcome.code == 0 and _facts(outcome.output) != whole_output(kind.name):
        return "a damaged input is reported as if it were whole"
    return ""


@cache
def whole_output(name: str) -> str:
    """Return what the command prints for the undamaged example."""
    kind = kind_of(name)
    with tempfile.TemporaryDirectory() as folder:
        kind.write(Path(folder))
        out = io.StringIO()
        assert kind.argv is not None
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
            assert main(kind.argv(Path(folder))) == 0
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
    kind = kind_of(name)
    with tempfile.TemporaryDirectory(prefix="fuzz") as made:
        folder = Path(made)
        case(kind, seed, folder)
        before = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        outcome = received(kind, folder)
        if outcome.finding and keep is not None:
            target = keep / name / hashlib.sha256(f"{name}{seed}".encode()).hexdigest()[:8]
            shutil.rmtree(target, ignore_errors=True)
            for path, content in before.items():
                (target / path).parent.mkdir(parents=True, exist_ok=True)
                (target / path).write_bytes(content)
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
