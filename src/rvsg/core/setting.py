"""The declaration of a setting: what a field of a record says besides its type, its bounds and its default."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Literal

from pydantic import Field

TEST = "What to test"
SEARCH = "How to find scenarios"
RUNS = "How it is simulated"
MODEL = "A vision language model"
OUTPUT = "What comes out"
GROUPS = (TEST, SEARCH, RUNS, MODEL, OUTPUT)


@dataclass(frozen=True)
class Setting:
    """What the declaration of a setting says besides its type and its default."""

    help: str
    group: str
    _: KW_ONLY
    more: str = ""
    """What the reference page says in addition."""
    default: str = ""
    """The default in words, where it depends on other settings."""
    option: str = ""
    """The option of the command line, if its name is not that of the key."""
    metavar: str | None = None
    label: str = ""
    """The label in the studio's form; a setting without one is not in the form."""
    common: bool = False
    """Whether `rvsg run --help` shows the option; `--help-all` shows all."""
    file: Literal["", "path", "or name"] = ""
    """Whether the value is the path of a file or folder, or may be one instead of a name."""
    decides: bool = True
    """Whether records depend on it; another value is refused when a campaign is resumed."""
    machine: bool = False
    """Whether it says where and by how many workers runs are made."""
    several: bool = False
    """Whether a list of values asks for several campaigns."""
    of_model: bool = False
    """Whether only a vision language model needs it."""


Positive = Annotated[int, Field(ge=1, le=100_000, strict=True)]
NotNegative = Annotated[int, Field(ge=0, strict=True)]
