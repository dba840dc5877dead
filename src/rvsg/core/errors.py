"""The error tree. Every error a user can cause or meet is one of these; foreign errors are translated at the door.

::

    RvsgError                     anything RVSG reports in one message, without a traceback
    ├── InputError                what the user gave is wrong (exit code 2)
    │   ├── FileError             ... in a file: knows its path and, where it can, the line
    │   ├── UnknownName           ... names something that does not exist: knows "did you mean"
    │   ├── Unfit                 ... a key or an option whose value cannot be used: knows the key
    │   ├── InvalidOptions        ... options of a plug-in whose values cannot be used: knows the keys
    │   └── InvalidScenario       ... a scenario the checker refuses: knows every finding
    ├── SimulationError           a simulator could not run a valid scenario
    ├── GenerationError           a generator could not answer (never a merely bad answer: that is a Proposal)
    │   ├── ModelUnavailable      the model's service refused, is absent or did not answer
    │   ├── BudgetSpent           the declared budget of calls, tokens or money is spent (resumable)
    │   └── ReplayDiverged        a recorded conversation does not hold the call that is asked for
    │       └── NotRecorded       it holds none for the attempt: the record ended before
    ├── NothingJudged             a campaign or suite is over, and no run says anything of the robot
    ├── StoreError                the store cannot be read or written
    │   └── NewerStore            it was written by a newer version of RVSG
    └── Interrupted               the user or the system stopped the work (exit code 3, resumable)

A message says what was expected, what was got, where, and the next step; it is for people and may be reworded at any
time. A program that must tell errors apart reads the class, its fields and `code`.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

CONSTRAINTS = Path(__file__).parents[3] / "constraints.txt"
"""There in a clone; not where RVSG is installed from wheels."""
DISTRIBUTIONS = {
    "bag": ("exchange",),
    "exchange": ("exchange",),
    "rerun": ("exchange",),
    "ros2": ("exchange", "ros2"),
    "studio": ("studio",),
    "study": ("study",),
}
"""The distributions beside this one that an extra needs; a clone holds them in `packages`."""


def how_to_install(extra: str) -> str:
    """Return the command that installs an extra where RVSG is installed: in a clone, or from wheels."""
    names = [f"rvsg-{name}" for name in DISTRIBUTIONS.get(extra, ())]
    if not CONSTRAINTS.is_file():
        return " ".join([f"pip install --find-links FOLDER_OF_WHEELS 'rvsg[{extra}]'", *names])
    beside = "".join(f" -e ./packages/{name}" for name in names)
    return f"in your clone, .venv/bin/pip install -c constraints.txt -e '.[{extra}]'{beside}"


class RvsgError(Exception):
    """Anything RVSG reports to its user in one message."""

    exit_code = 2
    code = "error"
    """What is wrong, as a stable word such as `store-damaged`; a class has one, an error may have a narrower one."""

    def __init__(self, message: str = "", *, code: str | None = None) -> None:
        super().__init__(message)
        if code is not None:
            self.code = code

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle with all fields: the arguments of a subclass are not those of `Exception`."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(kind: type[RvsgError], arguments: tuple[Any, ...], fields: dict[str, Any]) -> RvsgError:
    error = kind.__new__(kind, *arguments)
    error.__dict__.update(fields)
    return error


class InputError(RvsgError):
    """What the user gave cannot be used."""

    code = "input"


class FileError(InputError):
    """A file that cannot be used; the message begins with `path:line:`."""

    code = "file"

    def __init__(self, path: str | Path, message: str, *, line: int | None = None, code: str | None = None) -> None:
        self.path = Path(path)
        self.line = line
        self.reason = message
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {message}", code=code)


class UnknownName(InputError):
    """A name that is not among those known; `nearest` is the one to suggest, None if none is near."""

    code = "unknown-name"

    def __init__(self, kind: str, name: str, known: Iterable[str], *, hint: str = "") -> None:
        self.kind = kind
        self.name = name
        self.known = sorted(known)
        near = difflib.get_close_matches(name, self.known, n=1, cutoff=0.5)
        number = re.compile(r"\d+")  # which other number was meant cannot be known
        self.nearest = next(
            (candidate for candidate in near if number.sub("", candidate) != number.sub("", name)), None
        )
        asked = f' Did you mean "{self.nearest}"?' if self.nearest else ""
        listed = ", ".join(self.known[:30]) + (", ..." if len(self.known) > 30 else "")
        known_text = f" Known: {listed}." if self.known else ""
        name = name if len(name) <= 200 else f"{name[:100]}...{name[-40:]}"
        super().__init__(f'There is no {kind} "{name}".{asked}{known_text}{" " + hint if hint else ""}')


class Unfit(InputError):
    """The value of a key or of an option cannot be used, by itself or beside the other keys; `key` names it."""

    code = "unfit"

    def __init__(self, key: str, message: str) -> None:
        self.key = key
        super().__init__(message)


class InvalidOptions(InputError):
    """Options that cannot be used; `keys` names them, as in `costmaps.local_size_m`."""

    code = "options"

    def __init__(self, message: str, keys: Iterable[str], *, code: str | None = None) -> None:
        self.keys = tuple(keys)
        super().__init__(message, code=code)


class InvalidScenario(InputError):
    """A scenario that breaks the rules of validity; `findings` holds every reason as text."""

    code = "invalid-scenario"

    def __init__(self, message: str, findings: Iterable[str]) -> None:
        self.findings = list(findings)
        super().__init__("\n".join([message, *(f"  - {finding}" for finding in self.findings)]))


class SimulationError(RvsgError):
    """A simulator could not run a scenario that is valid."""

    code = "simulation"


class GenerationError(RvsgError):
    """A generator could not answer at all."""

    code = "generation"


class ModelUnavailable(GenerationError):
    """The model's service refused the call, is absent, or did not answer in time."""

    code = "model-unavailable"


class BudgetSpent(GenerationError):
    """A declared budget of calls, tokens or money is spent; the campaign can be resumed with a larger one."""

    code = "budget-spent"
    exit_code = 3


class ReplayDiverged(GenerationError):
    """The recorded conversation does not hold the call that is now asked for."""

    code = "replay-diverged"


class NotRecorded(ReplayDiverged):
    """The record holds no call for an attempt at all: it ended before."""

    code = "replay-ended"


class NothingJudged(RvsgError):
    """No run of a campaign or suite could be judged, so its requirements are neither kept nor violated."""

    code = "nothing-judged"


class StoreError(RvsgError):
    """The store cannot be read or written."""

    code = "store"


class NewerStore(StoreError):
    """The store was written by a newer version of RVSG than this one."""

    code = "store-newer"


class Interrupted(RvsgError):
    """The work was stopped from outside; what is finished is stored, and the same command resumes it."""

    code = "interrupted"
    exit_code = 3
