"""Worlds that RVSG writes follow the descriptions of SDFormat's elements, as Gazebo's own parser reads them.

The descriptions (`sdf/1.7/*.sdf` of gazebosim/sdformat) are read from the folder in `RVSG_SDFORMAT`, or from where
Gazebo installs them; without them the tests that need them are skipped.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from rvsg.generation.random_search import RandomGenerator
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Mission
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.world.world import World
from rvsg.world.world_folder import load_world
from rvsg_exchange.formats import SDF_VERSION, world_sdf

INSTALLED = ("/usr/share", "/usr/local/share", "/opt/ros")
VALUES = {"double": 1, "int": 1, "unsigned int": 1, "vector2d": 2, "vector2i": 2, "vector3": 3, "pose": 6, "color": 4}
"""How many numbers a value of each type holds."""
LEAST, MOST = {"1": 1, "+": 1}, {"1": 1, "0": 1, "-1": 0}
"""How often an element of each kind of `required` stands."""


class Description:
    """The description of an element: its attributes and children, as a file of SDFormat writes them."""

    def __init__(self, folder: Path, node: ET.Element, required: str | None = None) -> None:
        self.name, self.type = node.attrib["name"], node.attrib.get("type")
        self.required = required or node.attrib.get("required", "0")
        self.attributes = {each.attrib["name"]: each.attrib for each in node.findall("attribute")}
        self.is_open = any(each.attrib.get("copy_data") == "true" for each in node.findall("element"))
        self._folder, self._node = folder, node

    @property
    def children(self) -> dict[str, Description]:
        found = [Description(self._folder, each) for each in self._node.findall("element") if "name" in each.attrib]
        for each in self._node.findall("include"):
            root = ET.parse(self._folder / each.attrib["filename"]).getroot()
            found.append(Description(self._folder, root, each.attrib.get("required")))
        return {each.name: each for each in found}


def wrong(node: ET.Element, described: Description, at: str = "") -> Iterator[str]:
    """Yield what an element and all within it do against their description."""
    at = f"{at}/{node.tag}"
    for name in node.attrib.keys() - described.attributes.keys():
        yield f"{at}: attribute {name} is not described"
    for name, attribute in described.attributes.items():
        if attribute.get("required") == "1" and name not in node.attrib:
            yield f"{at}: attribute {name} is missing"
        elif name in node.attrib and not is_value(node.attrib[name], attribute.get("type")):
            yield f"{at}@{name}: {node.attrib[name]!r} is no {attribute.get('type')}"
    if not is_value(node.text or "", described.type):
        yield f"{at}: {node.text!r} is no {described.type}"
    if described.is_open:
        return
    children, counts = described.children, Counter(child.tag for child in node)
    for name in counts.keys() - children.keys():
        yield f"{at}: element {name} is not described"
    for name, child in children.items():
        if counts[name] < LEAST.get(child.required, 0):
            yield f"{at}: element {name} is missing"
        if counts[name] > MOST.get(child.required, counts[name]):
            yield f"{at}: element {name} stands {counts[name]} times"
    for child in node:
        if child.tag in children:
            yield from wrong(child, children[child.tag], at)


def is_value(text: str, kind: str | None) -> bool:
    if kind == "bool":
        return text.strip() in ("true", "false", "0", "1")
    number = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", re.IGNORECASE)
    parts = text.split()
    return kind not in VALUES or (len(parts) == VALUES[kind] and all(map(number.fullmatch, parts)))


@pytest.fixture(scope="module")
def described() -> Description:
    named = os.environ.get("RVSG_SDFORMAT")
    folders = [Path(named)] if named else [path for root in INSTALLED for path in Path(root).glob("**/sdformat*")]
    for folder in folders:
        for root in sorted(folder.glob(f"**/{SDF_VERSION}/root.sdf")):
            return Description(root.parent, ET.parse(root).getroot())
    pytest.skip("the descriptions of SDFormat are not installed; RVSG_SDFORMAT names their folder")


KNOWN = {
    "/sdf/world/actor: element link is missing",
    *(f"/sdf/world: element {name} is missing" for name in ("physics", "scene", "atmosphere", "gravity",
                                                            "magnetic_field")),
}  # fmt: skip
"""What Gazebo's parser fills in by default, and shipped worlds leave out, too."""


@pytest.mark.parametrize("name", ["warehouse", "hospital"])
def test_a_world_with_actors_follows_the_description_of_sdformat(described: Description, name: str) -> None:
    world = load_world(name)
    brief = Brief(mission=Mission.of(world, world.routes[0]), requirement=None, seed=3)
    scenario = RandomGenerator().propose(brief, world).scenario
    assert scenario is not None
    root = ET.fromstring(world_sdf(world, KinematicSimulator().run(scenario, world, seed=1)))
    assert len(list(root.iter("actor"))) == 2
    assert set(wrong(root, described)) <= KNOWN


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<height>", "<height>high "),
        ('name="walking"', 'nome="walking"'),
        ("<loop>false</loop>", "<loop>no</loop>"),
        ("<static>true</static>", "<statik>true</statik>"),
        ("<delay_start>0</delay_start>", "<delay_start>0</delay_start><delay_start>0</delay_start>"),
    ],
)
def test_the_check_finds_what_is_wrong(described: Description, world: World, run: Run, old: str, new: str) -> None:
    text = world_sdf(world, run)
    assert old in text
    assert set(wrong(ET.fromstring(text.replace(old, new, 1)), described)) - KNOWN
