"""Find the files that a Gazebo world refers to, on this machine only: folders, packages, the Fuel cache."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlparse

from rvsg.core.errors import FileError
from rvsg.world.io.safe_xml import read_xml

PATH_VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
PACKAGE_VARIABLES = ("ROS_PACKAGE_PATH",)
PREFIX_VARIABLES = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH")
CACHE_VARIABLES = ("GZ_FUEL_CACHE_PATH", "IGN_FUEL_CACHE_PATH")
WEB = ("http", "https", "fuel")
SCHEMES = ("model", "package", "file", "", *WEB)
_FUEL = re.compile(
    r"(?:\d+\.\d+/)?(?P<owner>[^/]+)/models/(?P<name>[^/]+)(?:/(?P<version>\d+|tip))?(?:/files)?(?P<rest>/.*)?"
)


class ModelFiles:
    """Looks up URIs in the given folders, the folders around the world file, Gazebo's variables and its caches."""

    def __init__(self, world: Path, given: Sequence[Path] = (), environment: Mapping[str, str] | None = None) -> None:
        variables = os.environ if environment is None else environment
        folder = world.resolve().parent
        found = [*given, folder, folder / "models", folder.parent / "models", folder.parent]
        for name in (*PATH_VARIABLES, *PACKAGE_VARIABLES):
            found += _listed(variables, name)
        for name in PREFIX_VARIABLES:
            found += [path / "share" for path in _listed(variables, name)]
        home = Path(variables.get("HOME") or Path.home())
        found.append(home / ".gazebo" / "models")
        self.folders: tuple[Path, ...] = tuple(dict.fromkeys(found))
        caches = [path for name in CACHE_VARIABLES for path in _listed(variables, name)]
        self.caches = (*caches, home / ".gz" / "fuel", home / ".ignition" / "fuel")

    def find(self, uri: str, base: Path) -> Path | None:
        """Return the file or folder of a URI that is written in the file `base`; None if it is not on this machine."""
        scheme, rest = split(uri)
        if ".." in Path(rest).parts and scheme != "":
            return None
        return next((path for path in self._candidates(scheme, rest, base) if path.exists()), None)

    def searched(self, uri: str, base: Path) -> tuple[Path, ...]:
        """Return the folders in which a URI is looked for, in order."""
        scheme, rest = split(uri)
        if scheme in WEB:
            return (*self.caches, *self.folders)
        if scheme == "file" and rest.startswith("/"):
            return (Path(rest).parent,)
        return tuple(dict.fromkeys((*self.folders, base.parent if scheme == "" else base.parent.parent)))

    def _candidates(self, scheme: str, rest: str, base: Path) -> list[Path]:
        folders = (*self.folders, base.parent.parent)
        if scheme in WEB:
            return [*self._in_fuel_cache(rest), *(folder / _fuel_tail(rest) for folder in folders)]
        if scheme == "file" and rest.startswith("/"):
            return [Path(rest)]
        found = [folder / rest for folder in folders]
        if scheme == "":
            found.insert(0, base.parent / rest)
        if scheme in ("package", "file", "model"):
            package, _, inner = rest.partition("/")
            found += [folder / inner for folder in base.resolve().parents if _package(folder) == package]
        if scheme == "file":  # written relative to the root of a checkout: file://models/chair/meshes/chair.dae
            found += [folder / rest for folder in list(base.resolve().parents)[:5]]
        return found

    def _in_fuel_cache(self, rest: str) -> list[Path]:
        host, _, address = rest.partition("/")
        match = _FUEL.fullmatch(address.rstrip("/"))
        if match is None:
            return []
        inner = (match["rest"] or "").lstrip("/")
        found = []
        for cache_folder in self.caches:
            model = cache_folder / host / match["owner"].lower() / "models" / match["name"].lower()
            found += [version / inner if inner else version for version in _versions(model, match["version"])]
        return found


def split(uri: str) -> tuple[str, str]:
    """Return the scheme and the rest of a URI, percent signs decoded."""
    try:
        parsed = urlparse(uri.strip())
    except ValueError:  # such as a bracket that is not closed; no file has that name
        return "", uri.strip()
    if parsed.scheme in WEB:
        return parsed.scheme, unquote(parsed.netloc.lower() + parsed.path)
    return parsed.scheme, unquote(parsed.netloc + parsed.path)


def model_of(uri: str) -> str:
    """Return the name by which a missing file is reported: the model, package or Fuel model it belongs to."""
    scheme, rest = split(uri)
    if scheme in WEB:
        return _fuel_tail(rest).partition("/")[0]
    return rest.partition("/")[0] if scheme in ("model", "package") else rest


def _fuel_tail(rest: str) -> str:
    """Return the model's name, with the file in it if the address names one."""
    match = _FUEL.fullmatch(rest.partition("/")[2].rstrip("/"))
    if match is None:
        return rest.rstrip("/").rpartition("/")[2]
    return match["name"] + (match["rest"] or "")


def _versions(model: Path, wanted: str | None) -> list[Path]:
    if wanted and wanted != "tip":
        return [model / wanted]
    if not model.is_dir():
        return []
    numbered = [path for path in model.iterdir() if path.name.isdecimal()]
    return sorted(numbered, key=lambda path: -int(path.name))


def _listed(variables: Mapping[str, str], name: str) -> list[Path]:
    return [Path(part) for part in variables.get(name, "").split(os.pathsep) if part]


@cache
def _package(folder: Path) -> str | None:
    """Return the name of the ROS package whose root a folder is."""
    manifest = folder / "package.xml"
    if not manifest.is_file():
        return None
    try:
        return read_xml(manifest).text_of("name") or folder.name
    except FileError:
        return folder.name


def model_file(folder: Path) -> Path | None:
    """Return the SDF (or URDF) file of a model folder: the newest version in model.config, else model.sdf."""
    for candidate in (*_named_in_config(folder), folder / "model.sdf", folder / "model.urdf"):
        if candidate.is_file():
            return candidate
    alone = sorted(folder.glob("*.sdf"))
    return alone[0] if len(alone) == 1 else None


def _named_in_config(folder: Path) -> list[Path]:
    """Return the files that model.config names, the newest SDF version first; none if it cannot be read."""
    config = folder / "model.config"
    if not config.is_file():
        return []
    try:
        entries = read_xml(config).all("sdf")
    except FileError:
        return []
    named = []
    for entry in entries:
        version = tuple(
            int(p) if p.isdecimal() and len(p) < 10 else 0 for p in entry.attributes.get("version", "0").split(".")
        )
        named.append((version, entry.text.strip()))
    return [folder / name for _, name in sorted(named, reverse=True) if name]
