"""Input files of a campaign: its world, robot, requirements, recorded calls and others, copied into its folder.

A campaign stores paths as they were typed, and the folder it was begun in. Each is read from there while it has the
content it had then, else from the copy. So a folder can be moved to another machine and resumed there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rvsg.app.settings import FILES, CampaignConfig, file_of
from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.generation.vlm.call_log import recorded_files
from rvsg.robots.robot import shipped_robots
from rvsg.scenario.requirement import shipped_requirements
from rvsg.world.world_folder import file_names, shipped_worlds, world_folder

INPUTS = "inputs"
"""The folder of the copies in the folder of a campaign."""
COPIED = ("world", "requirement", "also", "robot", "moved", "stack", "start_from", "replay")


def paths_of(values: Mapping[str, Any], begun_in: str | None, folder: Path) -> dict[str, str]:
    """Return the typed paths among settings, each with where it is, seen from the current folder.

    Args:
        folder: the folder of the campaign, with the copies.
    """
    found = {}
    for key, text, copy in _typed(values, folder):
        path = Path(begun_in or "", text)
        if begun_in and Path(file_of(str(path))).exists() and (not copy.exists() or _is_same(key, str(path), copy)):
            found[text] = text if Path(begun_in) == Path.cwd() else str(path)
        elif copy.exists():
            found[text] = f"{copy}{text[len(file_of(text)) :]}"
    return found


def copy_inputs(values: Mapping[str, Any], paths: Mapping[str, str], folder: Path, *, anew: bool) -> None:
    """Copy the files that settings name into the folder of a campaign; without `anew` only those it lacks."""
    for key, text, copy in _typed(values, folder):
        source = Path(file_of(paths.get(text, text)))
        if key in COPIED and source.suffix != ".py" and source.exists() and (anew or not copy.exists()):
            for file, target in _files(key, source, copy):
                write_whole(target, file.read_bytes())


def located(config: CampaignConfig, paths: Mapping[str, str]) -> CampaignConfig:
    """Return settings with every typed path as where it is."""
    return config.replace(**_changed(config.model_dump(), lambda _, text: paths.get(text, text)))


def as_campaign_file(config: CampaignConfig, paths: Mapping[str, str], folder: Path) -> CampaignConfig:
    """Return settings as a campaign file in the folder names them: its copies, and other paths from the root."""
    copies = {text: copy for _, text, copy in _typed(config.model_dump(), folder)}

    def spelled(_: str, text: str) -> str:
        if text in copies and copies[text].exists():
            return f"{copies[text].relative_to(folder)}{text[len(file_of(text)) :]}"
        path = paths.get(text, text)
        return str(Path(path).absolute()) if text in copies and Path(file_of(path)).exists() else text

    return config.replace(**_changed(config.model_dump(), spelled))


def as_stored(asked: Mapping[str, Any], known: Mapping[str, str]) -> dict[str, Any]:
    """Return settings with every path as the stored campaign types it, where both name the same file or content.

    A path that is typed like a stored one but names another file here is made absolute, so that the two differ.
    """

    def typed(key: str, text: str) -> str:
        for kept, path in known.items():
            if _absolute(text) == _absolute(path):
                return kept
            part, other = text[len(file_of(text)) :], path[len(file_of(path)) :]
            if part == other and Path(file_of(text)).exists() and _is_same(key, text, Path(file_of(path))):
                return kept
        return str(Path(text).absolute()) if text in known and Path(file_of(text)).exists() else text

    return {**asked, **_changed(asked, typed)}


def _typed(values: Mapping[str, Any], folder: Path) -> Iterator[tuple[str, str, Path]]:
    """Yield key, text and the place of the copy of everything among settings that may be a path."""
    shipped = {*shipped_worlds(), *shipped_requirements(), *shipped_robots()}
    for key in FILES:
        value = values.get(key)
        for index, text in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(text, str) and text not in shipped:
                name = Path(file_of(text)).name.replace("..", "") or key
                yield key, text, folder / INPUTS / (f"{key}-{index + 1}" if index else key) / name


def _files(key: str, source: Path, copy: Path) -> list[tuple[Path, Path]]:
    """Return the files of an input, each with the place of its copy."""
    if key == "replay":
        return [(path, copy / path.relative_to(source)) for path in recorded_files(source)]
    if key != "world":
        return [(source, copy)]
    place = world_folder(source)
    return [(place / name, copy / name) for name in file_names(place)]


def _is_same(key: str, text: str, copy: Path) -> bool:
    try:
        pairs = _files(key, Path(file_of(text)), copy)
        return all(file.read_bytes() == target.read_bytes() for file, target in pairs)
    except (OSError, InputError):
        return False


def _changed(values: Mapping[str, Any], change: Callable[[str, str], str]) -> dict[str, Any]:
    """Return the settings that may name a file, each text changed."""
    return {
        key: [change(key, text) for text in value] if isinstance(value, list | tuple) else change(key, value)
        for key in FILES
        if (value := values.get(key)) is not None
    }


def _absolute(text: str) -> str:
    """Return a path with its links resolved, and the name of a part of the file unchanged."""
    file = file_of(text)
    return f"{Path(file).resolve()}{text[len(file) :].replace(':', '#', 1)}"
