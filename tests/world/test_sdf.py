"""Gazebo worlds: what they reduce to, and every refusal of one that cannot be read."""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from tests.published_data import published_data

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError
from rvsg.world.creation import WorldSource
from rvsg.world.world import Polygon, SolidObject
from rvsg_exchange.mesh import turned_profile
from rvsg_exchange.sdf import load_sdf
from rvsg_exchange.solid import solid_objects

AT_ORIGIN = "0 0 0 0 0 0"
COLLADA = pytest.mark.skipif(not find_spec("collada"), reason="pycollada is not installed")


def shape(geometry: str, pose: str = "0 0 0.5 0 0 0") -> str:
    return f"<collision name='c'><pose>{pose}</pose><geometry>{geometry}</geometry></collision>"


def box(size: str = "1 2 1", pose: str = AT_ORIGIN) -> str:
    return shape(f"<box><size>{size}</size></box>", pose)


def model(name: str, inside: str, pose: str = "0 0 0.5 0 0 0") -> str:
    return f"<model name='{name}'><pose>{pose}</pose><link name='l'>{inside}</link></model>"


def include(uri: str, more: str = "") -> str:
    return f"<include><uri>{uri}</uri>{more}</include>"


def write(folder: Path, inside: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "a.world"
    path.write_text(f"<?xml version='1.0'?>\n<sdf version='1.7'>\n<world name='w'>\n{inside}\n</world></sdf>")
    return path


def write_model(models: Path, name: str, inside: str) -> Path:
    folder = models / name
    folder.mkdir(parents=True)
    (folder / "model.config").write_text("<model><sdf version='1.6'>model.sdf</sdf></model>")
    (folder / "model.sdf").write_text(f"<sdf version='1.6'>\n{inside}\n</sdf>")
    return folder


def loaded(folder: Path, inside: str, **options: Any) -> WorldSource:
    return load_sdf(write(folder, inside), **options)


def only(world: WorldSource) -> SolidObject:
    (thing,) = world.objects
    return thing


def region(rings: tuple[Polygon, ...]) -> shapely.Polygon:
    filled = shapely.Polygon()
    for ring in rings:
        filled = filled.symmetric_difference(shapely.Polygon(ring))
    return filled


def refusal(path: Path, **options: Any) -> FileError:
    with pytest.raises(FileError) as caught:
        load_sdf(path, **options)
    return caught.value


def codes(error: FileError) -> list[str]:
    """What is wrong: the code of every problem, or of the error itself."""
    return [problem.code for problem in error.problems] if isinstance(error, DocumentError) else [error.code]


def test_a_box_keeps_its_pose_size_and_slice(tmp_path: Path) -> None:
    thing = only(loaded(tmp_path, model("Crate_3", box("2 1 1"), pose="3 4 0.5 0 0 0.5")))
    assert (thing.name, thing.kind) == ("Crate_3", "Crate")
    assert thing.box.center == pytest.approx((3, 4, 0.5))
    assert thing.box.size == pytest.approx((2, 1, 1))
    assert thing.box.yaw == pytest.approx(0.5)
    assert thing.origin == pytest.approx((3, 4, 0.5))
    assert region(thing.slices).area == pytest.approx(2.0, abs=1e-4)
    assert shapely.Polygon(thing.footprint).area == pytest.approx(2.0, abs=1e-3)


@given(x=st.floats(-20, 20), y=st.floats(-20, 20), yaw=st.floats(-3.1, 3.1), lx=st.floats(-3, 3), lyaw=st.floats(-3, 3))
@settings(max_examples=20, deadline=None)
def test_poses_of_model_link_and_collision_chain(
    tmp_path_factory: pytest.TempPathFactory, x: float, y: float, yaw: float, lx: float, lyaw: float
) -> None:
    text = (
        f"<model name='a'><pose>{x} {y} 0 0 0 {yaw}</pose><link name='l'><pose>{lx} 0 0 0 0 {lyaw}</pose>"
        f"{box('1 1 1', '0 0.5 0.5 0 0 0')}</link></model>"
    )
    thing = only(load_sdf(write(tmp_path_factory.mktemp("w"), text)))
    cx = x + math.cos(yaw) * lx - math.sin(yaw + lyaw) * 0.5
    cy = y + math.sin(yaw) * lx + math.cos(yaw + lyaw) * 0.5
    centre = region(thing.slices).centroid
    assert (centre.x, centre.y) == pytest.approx((cx, cy), abs=1e-4)


INNER = f"<model name='in'><pose relative_to='f'>1 0 0 0 0 0</pose><link name='l'>{box('1 1 1')}</link></model>"
NESTED = (
    f"<model name='out'><pose>10 0 0.5 0 0 0</pose><frame name='f'><pose>0 2 0 0 0 1.5707963</pose></frame>{INNER}"
    "</model><model name='p' placement_frame='l'><pose relative_to='out::f'>0 0 0 0 0 0</pose>"
    f"<link name='l'><pose>7 7 0 0 0 0</pose>{box('1 1 1')}</link></model>"
)
TURNED = (
    f"<model name='d'><pose degrees='true'>0 0 .5 0 0 90</pose><link name='l'>{box()}</link></model>"
    "<model name='q'><pose rotation_format='quat_xyzw'>9 0 .5 0 0 0.70710678 0.70710678</pose>"
    f"<link name='l'>{box()}</link></model>"
)
SAVED = (
    model("a", box("1 1 1")) + model("b", box(), "9 0 0 0 0 0")
    + "<state world_name='w'><deletions><name>b</name></deletions>"
    "<model name='a'><pose>3 0 0.5 0 0 0</pose><scale>2 1 1</scale></model></state>"
)  # fmt: skip


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        (NESTED, {"out": {"center": (10, 3, 0.5)}, "p": {"center": (10, 2, 0.5)}}),
        (TURNED, {"d": {"yaw": math.pi / 2}, "q": {"yaw": math.pi / 2}}),
        (SAVED, {"a": {"center": (3, 0, 0.5), "size": (2, 1, 1)}}),
    ],
    ids=["frames", "rotations", "state"],
)
def test_frames_and_saved_states_are_applied(tmp_path: Path, inside: str, expected: dict[str, dict[str, Any]]) -> None:
    found = {thing.name: thing for thing in loaded(tmp_path, inside).objects}
    assert found.keys() == expected.keys()
    for name, box_values in expected.items():
        for key, value in box_values.items():
            assert getattr(found[name].box, key) == pytest.approx(value)


@pytest.mark.parametrize(
    ("geometry", "area"),
    [
        ("<cylinder><radius>0.5</radius><length>1</length></cylinder>", math.pi * 0.25),
        ("<sphere><radius>0.5</radius></sphere>", math.pi * (0.25 - 0.29**2)),
        ("<ellipsoid><radii>0.5 1 0.5</radii></ellipsoid>", 2 * math.pi * (0.25 - 0.29**2)),
        ("<capsule><radius>0.2</radius><length>0.6</length></capsule>", math.pi * 0.04),
        ("<cone><radius>1</radius><length>1</length></cone>", math.pi * 0.79**2),
        ("<polyline><point>0 0</point><point>1 0</point><point>0 1</point><height>1</height></polyline>", 0.5),
    ],
)
def test_a_primitive_is_cut_at_the_lidar_height(tmp_path: Path, geometry: str, area: float) -> None:
    base = "0 0 0 0 0 0" if "polyline" in geometry else "0 0 0.5 0 0 0"
    thing = only(loaded(tmp_path, model("a", shape(geometry, base), pose="0 0 0 0 0 0")))
    assert region(thing.slices).area == pytest.approx(area, rel=0.03)


def test_a_table_shows_the_lidar_its_legs_and_people_its_top(tmp_path: Path) -> None:
    legs = "".join(box("0.1 0.1 0.7", f"{x} {y} 0.35 0 0 0") for x in (-0.7, 0.7) for y in (-0.4, 0.4))
    thing = only(loaded(tmp_path, model("Table", legs + box("1.5 0.9 0.05", "0 0 0.725 0 0 0"), "0 0 0 0 0 0")))
    assert len(thing.slices) == 4
    assert region(thing.slices).area == pytest.approx(0.04)
    assert shapely.Polygon(thing.footprint).area == pytest.approx(1.35, rel=0.01)


def test_a_room_of_four_walls_keeps_its_floor_open(tmp_path: Path) -> None:
    walls = "".join(
        box("10 .2 3", f"0 {y} 1.5 0 0 0") + box(".2 8.2 3", f"{x} 0 1.5 0 0 0") for x, y in ((5, 4), (-5, -4))
    )
    thing = only(loaded(tmp_path, model("Room", walls, "0 0 0 0 0 0")))
    assert len(thing.holes) == 1
    assert not region((thing.footprint, *thing.holes)).contains(shapely.Point(0, 0))
    assert region(thing.slices).contains(shapely.Point(5, 0))


SLAB = model("Ground", shape("<plane><normal>0 0 1</normal><size>9 9</size></plane>"), AT_ORIGIN)
SLAB += model("Slab", box("20 20 1"), "0 0 -0.5 0 0 0") + model("Lamp", box("1 1 .2"), "0 0 3 0 0 0")
SKIPPED = include("model://lamp") + include("model://walker") + "<actor name='joe'/><light name='sun'/>"
SKIPPED += "<plugin name='clock' filename='libclock.so'/>"
GROUND = include("model://sun") + include("model://ground_plane")
GROUND += include("https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground Plane")
LINK = "<link name='l'><pose>{} 0 0.5 0 0 0</pose>" + box() + "</link>"


@pytest.mark.parametrize(
    ("inside", "options", "names", "notes"),
    [
        (SLAB + model("Crate", box()), {}, ["Crate"], ["Slab, Lamp"]),
        (model("Walls", box("8 .2 3", "0 4 1 0 0 0") + box("8 .2 3", "0 -4 1 0 0 0")), {}, ["Walls 1", "Walls 2"], []),
        (model("tb3", box() + "<sensor name='s'/>") + model("a", box(), "9 0 .5 0 0 0"), {}, ["a", "tb3"],
         ["tb3", "--without"]),
        (model("robot", box(), "3 0 10.5 0 0 0") + model("Crate", box(), "0 0 10.5 0 0 0"),
         {"without": ["rob*"], "floor_m": 10.0}, ["Crate"], []),
        (model("Crate", box()) + SKIPPED, {"without": ["lamp", "joe"]}, ["Crate"], ["lamp", "walker", "joe", "clock"]),
        (model("Crate", box()) + GROUND, {}, ["Crate"], []),
        (model("Crate", box()) + GROUND, {"without": ["sun", "ground_plane"]}, ["Crate"], []),
        ("".join(model("a", box(), f"{5 * i} 0 0.5 0 0 0") for i in range(3)), {}, ["a", "a_0", "a_1"],
         ["second model", "second model"]),
        (f"<model name='a'>{LINK.format(0)}{LINK.format(9)}</model>", {}, ["a 1", "a 2"], []),
    ],
    ids=["floor-lamp", "far-walls", "robot", "without", "actors", "ground", "no-ground", "equal-names", "equal-links"],
)  # fmt: skip
def test_a_world_has_the_objects_that_count_and_notes_on_the_others(
    tmp_path: Path, inside: str, options: dict[str, Any], names: list[str], notes: list[str]
) -> None:
    write_model(tmp_path / "models", "lamp", "<light name='l' type='point'/>")
    write_model(tmp_path / "models", "walker", "<actor name='a'/>")
    world = loaded(tmp_path, inside, **options)
    assert sorted(thing.name for thing in world.objects) == names
    assert all(thing.box.center[2] == pytest.approx(0.5) for thing in world.objects if thing.name == "Crate")
    said = " ".join(world.notes)
    assert all(note in said for note in notes)
    assert said.count("second model") == notes.count("second model")


def test_includes_are_found_through_search_paths_and_posed_by_the_include(tmp_path: Path) -> None:
    write_model(tmp_path / "elsewhere", "shelf", model("shelf", box()))
    text = "<include><uri>model://shelf</uri><name>s_1</name><pose>5 0 0.5 0 0 0</pose></include>"
    world = write(tmp_path / "w", text)
    thing = only(load_sdf(world, model_paths=[tmp_path / "elsewhere"]))
    assert (thing.name, thing.kind, thing.origin[0]) == ("s_1", "shelf", 5.0)
    refused = refusal(world)
    assert codes(refused) == ["sdf-model-missing", "sdf-searched"]
    assert "shelf" in str(refused) and f"{tmp_path / 'w' / 'models'}" in str(refused)
    assert refused.line == 4


def test_the_newest_sdf_of_a_model_folder_is_read(tmp_path: Path) -> None:
    folder = write_model(tmp_path / "models", "m", model("m", box("1 1 1")))
    (folder / "new.sdf").write_text(f"<sdf version='1.9'>{model('m', box('3 3 1'))}</sdf>")
    (folder / "model.config").write_text(
        "<model><sdf version='1.10'>new.sdf</sdf><sdf version='1.9'>model.sdf</sdf></model>"
    )
    assert only(loaded(tmp_path, "<include><uri>model://m</uri></include>")).box.size[0] == pytest.approx(3)


# --- meshes ---


def cube() -> Any:
    """A cube of 1 m with a corner in the origin."""
    trimesh = pytest.importorskip("trimesh")
    return trimesh.creation.box(bounds=[(0, 0, 0), (1, 1, 1)])


def mesh_world(folder: Path, name: str, scale: str = "1 1 1") -> Path:
    geometry = f"<mesh><uri>{name}</uri><scale>{scale}</scale></mesh>"
    return write(folder, model("m", shape(geometry, AT_ORIGIN), AT_ORIGIN))


@pytest.mark.parametrize(("name", "y"), [("m.stl", -0.5), ("m.obj", -0.5), ("m.glb", 0.5)])  # GLB has y up
def test_a_mesh_is_scaled_and_sliced(tmp_path: Path, name: str, y: float) -> None:
    cube().export(tmp_path / "m.stl")
    cube().export(tmp_path / "m.glb")
    (tmp_path / "m.obj").write_text("mtllib ../../none.mtl\n" + cube().export(file_type="obj"))
    thing = only(load_sdf(mesh_world(tmp_path, name, "2 -1 1")))
    assert thing.box.size == pytest.approx((2, 1, 1))
    assert thing.box.center == pytest.approx((1, y, 0.5))
    assert region(thing.slices).area == pytest.approx(2.0, abs=1e-4)


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>
<unit meter="0.01" name="centimeter"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="g-positions-array" count="{count}">{values}</float_array>
<technique_common><accessor source="#g-positions-array" count="{points}" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
</source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{order}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><translate>100 0 0</translate>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def dae(folder: Path) -> Path:
    values, order = (cube().triangles * 100).reshape(-1), " ".join(map(str, range(36)))
    path = folder / "m.dae"
    path.write_text(DAE.format(count=len(values), values=" ".join(f"{v:g}" for v in values), points=36, order=order))
    return path


@COLLADA
def test_a_colladas_unit_and_nodes_are_applied_and_its_up_axis_is_not(tmp_path: Path) -> None:
    path = dae(tmp_path)
    thing = only(load_sdf(mesh_world(tmp_path, "m.dae", "1 1 2")))
    assert thing.box.center == pytest.approx((1.5, 0.5, 1.0))
    assert thing.box.size == pytest.approx((1, 1, 2))
    path.write_text(path.read_text().replace("</mesh>", ""))  # broken: its box is used if that is allowed
    world = mesh_world(tmp_path, "m.dae")
    assert refusal(world).path.name == "m.dae"
    assert only(load_sdf(world, box_for_unreadable=True)).box.size == pytest.approx((1, 1, 1))


def test_a_mesh_of_very_many_triangles_keeps_its_footprint_and_cut() -> None:
    angles = np.linspace(-math.pi / 2, math.pi / 2, 1200)
    ball = turned_profile(0.9 * np.column_stack([np.cos(angles).clip(0.0), np.sin(angles)]))
    pose = np.eye(4)
    pose[2, 3] = 1.0
    (thing,) = solid_objects("ball", "ball", pose, ball.moved(pose), lidar_height_m=0.21)
    assert len(ball.faces) > 50_000
    assert region(thing.slices).area == pytest.approx(math.pi * (0.81 - 0.79**2), rel=0.03)
    assert shapely.Polygon(thing.footprint).area == pytest.approx(math.pi * 0.81, rel=0.15)


def test_an_unreadable_mesh_is_named_and_its_box_is_used_only_if_allowed(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_bytes(cube().export(file_type="stl")[:-20])
    world = mesh_world(tmp_path, "m.stl")
    assert refusal(world).path.name == "m.stl"
    read = load_sdf(world, box_for_unreadable=True)
    assert only(read).box.size == pytest.approx((1, 1, 1))
    assert any("m.stl" in note and "bounding box" in note for note in read.notes)


@COLLADA
@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("m.stl", b"", "mesh-empty"),
        ("m.dae", b"<COLLADA>", "xml-malformed"),
        ("m.dae", b"<!DOCTYPE x [<!ENTITY a 'b'>]><COLLADA>&a;</COLLADA>", "xml-refused"),
        ("m.dae", b"<COLLADA/>", "mesh-unreadable"),
        ("m.fbx", b"x", "mesh-format"),
        ("m.obj", b"v 0 0 0\n", "mesh-empty"),
    ],
)
def test_bad_meshes_are_refused_by_name(tmp_path: Path, name: str, content: bytes, code: str) -> None:
    (tmp_path / name).write_bytes(content)
    refused = refusal(mesh_world(tmp_path, name), box_for_unreadable=True)
    assert (refused.path.name, codes(refused)) == (name, [code])


# --- refusals ---


def test_includes_and_frames_in_a_circle_are_refused(tmp_path: Path) -> None:
    for one, other in (("a", "b"), ("b", "a")):
        inside = f"<model name='{one}'><include><uri>model://{other}</uri></include></model>"
        write_model(tmp_path / "models", one, inside)
    refused = refusal(write(tmp_path, "<include><uri>model://a</uri></include>"))
    assert codes(refused) == ["sdf-include-circle"] and "a → b → a" in str(refused)
    frames = "<frame name='f'><pose relative_to='g'/></frame><frame name='g'><pose relative_to='f'/></frame>"
    text = f"<model name='m'>{frames}<link name='l'><pose relative_to='f'/>{box()}</link></model>"
    assert set(codes(refusal(write(tmp_path, text)))) == {"sdf-frame-circle"}


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("<!DOCTYPE sdf [<!ENTITY a 'x'>]><sdf/>", "xml-refused"),
        ("<!DOCTYPE sdf SYSTEM 'file:///etc/passwd'><sdf/>", "xml-refused"),
        ("<sdf><world>", "xml-malformed"),
        ("", "xml-malformed"),
        ("<html/>", "sdf-expected"),
        ("<sdf version='1.6'><world name='w'/></sdf>", "sdf-empty"),
        ("<a>" * 300 + "</a>" * 300, "xml-refused"),
    ],
)
def test_a_file_that_is_no_world_is_refused(tmp_path: Path, text: str, code: str) -> None:
    (tmp_path / "a.world").write_text(text)
    assert codes(refusal(tmp_path / "a.world")) == [code]


@pytest.mark.parametrize(
    ("inside", "code"),
    [
        (model("a", box("1 2")), "sdf-numbers"),
        (model("a", box("1 0 1")), "sdf-size"),
        (model("a", box("nan 1 1")), "sdf-numbers"),
        (model("a", box(), pose="1 2 3"), "sdf-numbers"),
        (model("a", shape("<mesh/>")), "sdf-tag-missing"),
        (model("a", shape("<box/>")), "sdf-tag-missing"),
        (model("a", box("5000 5000 1")), "sdf-size"),
        ("<include/>", "sdf-tag-missing"),
        (include("https://fuel.org/models/Table"), "sdf-model-missing"),
        (include("model://../../../etc"), "sdf-model-missing"),
        (f"<model name='a'><link name='l'><pose relative_to='no'/>{box()}</link></model>", "sdf-unknown-frame"),
        (model("Lamp", box(), "0 0 9 0 0 0"), "sdf-nothing-solid"),
        (model("a", box("1 2")) + include("model://gone"), "sdf-numbers sdf-model-missing sdf-searched"),
    ],
)
def test_mistakes_in_a_world_are_told_at_once(tmp_path: Path, inside: str, code: str) -> None:
    refused = refusal(write(tmp_path, inside))
    assert set(code.split()) <= set(codes(refused))
    assert refused.path.name == "a.world"


# --- the study's world ---


@pytest.mark.skipif(published_data() is None, reason="the study's world is not here")
@COLLADA
def test_the_studys_world_reduces_to_its_published_objects() -> None:
    data = published_data()
    assert data is not None
    read = load_sdf(data / "sdf" / "worlds" / "no_roof_small_warehouse.world")
    published = {thing["name"]: thing for thing in yaml.safe_load((data / "warehouse" / "objects.yaml").read_text())}
    assert {thing.name for thing in read.objects} == set(published)
    for thing in read.objects:
        expected = published[thing.name]
        assert thing.kind == expected["kind"]
        assert thing.box.center == pytest.approx(expected["box"]["center"], abs=1e-3)
        assert thing.box.size == pytest.approx(expected["box"]["size"], abs=1e-3)
        assert math.remainder(thing.box.yaw - expected["box"]["yaw"], math.tau) == pytest.approx(0, abs=1e-3)
        ours, theirs = region(thing.slices), region(tuple(expected["slice_at_0_21_m"]))
        assert ours.hausdorff_distance(theirs) < 2e-3, thing.name


def test_a_pattern_of_models_to_leave_out_that_matches_none_is_refused_with_their_names(tmp_path: Path) -> None:
    path = write(tmp_path, model("crate", box()) + model("robot_1", box(), "4 0 0.5 0 0 0"))
    assert [thing.name for thing in load_sdf(path, without=["robot*"]).objects] == ["crate"]
    refused = refusal(path, without=["rob"])
    assert codes(refused) == ["sdf-unknown-model"]
    assert "crate, robot_1" in str(refused)


# --- SDF as it is in the wild ---


@pytest.mark.parametrize("before", [b"\n\n", b"\xef\xbb\xbf", b"\xef\xbb\xbf\r\n"])
def test_what_stands_before_the_xml_declaration_is_skipped_and_lines_stay_right(tmp_path: Path, before: bytes) -> None:
    path = write(tmp_path, model("a", box("1 2")))
    lines = before.count(b"\n")
    path.write_bytes(before + path.read_bytes())
    assert refusal(path).line == 4 + lines


def test_bytes_that_are_not_utf8_do_not_stop_the_import(tmp_path: Path) -> None:
    path = write(tmp_path, model("a", box()))
    path.write_bytes(path.read_bytes().replace(b"<world", b"<!-- caf\xe9 --><world"))
    assert len(load_sdf(path).objects) == 1


def test_a_missing_model_is_told_once_and_lenient_imports_the_rest(tmp_path: Path) -> None:
    gone = "<include><name>{}</name><uri>model://gone</uri></include>"
    path = write(tmp_path, model("a", box()) + "".join(gone.format(i) for i in range(7)))
    with pytest.raises(DocumentError) as caught:
        load_sdf(path, model_paths=[tmp_path / "mine"])
    gone, searched = caught.value.problems
    assert (gone.code, searched.code) == ("sdf-model-missing", "sdf-searched")
    assert "7" in gone.message and str(tmp_path / "mine") in searched.message
    world = load_sdf(path, lenient=True)
    assert [thing.name for thing in world.objects] == ["a"]
    assert any("gone (7)" in note for note in world.notes)
    assert len(load_sdf(path, without=["gone"]).objects) == 1


def test_a_fuel_address_is_read_from_the_local_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for version, size in ((1, "1 1 1"), (12, "3 1 1")):
        folder = tmp_path / "cache" / "fuel.gazebosim.org" / "openrobotics" / "models" / "big chair" / str(version)
        folder.mkdir(parents=True)
        (folder / "model.sdf").write_text(f"<sdf version='1.6'>{model('Chair', box(size))}</sdf>")
    monkeypatch.setenv("GZ_FUEL_CACHE_PATH", str(tmp_path / "cache"))
    address = "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Big%20Chair"
    path = write(tmp_path / "w", f"<include><uri>{address}</uri></include>")
    assert only(load_sdf(path)).box.size[0] == pytest.approx(3)
    path = write(tmp_path / "w", f"<include><uri>{address}/1</uri></include>")
    assert only(load_sdf(path)).box.size[0] == pytest.approx(1)


def test_a_population_on_a_grid_and_a_drawn_one_are_the_same_every_time(tmp_path: Path) -> None:
    grid = (
        "<population name='p'><pose>10 0 0.5 0 0 0</pose>"
        + model("post", box("1 1 1"), "0 0 0 0 0 0")
        + "<distribution>"
        "<type>grid</type><rows>2</rows><cols>3</cols><step>4 4 0</step></distribution></population>"
    )
    world = loaded(tmp_path, grid)
    assert sorted(thing.box.center[0] for thing in world.objects) == pytest.approx([6, 6, 10, 10, 14, 14])
    drawn = grid.replace("<type>grid", "<box><size>50 50 0.1</size></box><model_count>5</model_count><type>random")
    drawn = drawn.replace("<distribution><box>", "<box>").replace(
        "</model_count><type>", "</model_count><distribution><type>"
    )
    path = write(tmp_path, drawn)
    first, again = load_sdf(path), load_sdf(path)
    assert len(first.objects) == 5 and first == again


def test_a_room_in_urdf_is_read_with_its_joints(tmp_path: Path) -> None:
    path = tmp_path / "room.urdf"
    path.write_text(
        "<robot name='room'><link name='base'/><link name='wall'><collision><origin xyz='0 0 1'/>"
        "<geometry><box size='4 0.2 2'/></geometry></collision></link>"
        "<joint name='j' type='fixed'><parent link='base'/><child link='wall'/>"
        "<origin xyz='5 6 0' rpy='0 0 1.5707963'/></joint></robot>"
    )
    thing = only(load_sdf(path))
    assert thing.box.center == pytest.approx((5, 6, 1))
    xs = [x for x, _ in thing.footprint]
    assert max(xs) - min(xs) == pytest.approx(0.2, abs=1e-3)


def test_a_heightmap_is_solid_where_it_rises(tmp_path: Path) -> None:
    ground = np.zeros((65, 65), np.uint8)
    ground[:20, 40:] = 255  # the image's upper right is at high x and high y
    Image.fromarray(ground).save(tmp_path / "ground.png")
    inside = shape("<heightmap><uri>file://ground.png</uri><size>64 64 3</size></heightmap>", "0 0 0 0 0 0")
    thing = only(loaded(tmp_path, model("Ground", inside, "0 0 0 0 0 0")))
    filled = region(thing.slices)
    assert filled.contains(shapely.Point(20, 25))
    assert not filled.contains(shapely.Point(-20, -25)) and not filled.contains(shapely.Point(20, -25))


def test_a_large_open_box_is_a_room_of_thin_walls(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    room = trimesh.creation.box(extents=(8, 6, 3))
    room.update_faces(room.face_normals[:, 2] < 0.5)  # without its ceiling
    room.export(tmp_path / "room.stl")
    inside = shape("<mesh><uri>room.stl</uri></mesh>", "0 0 1.5 0 0 0")
    thing = only(loaded(tmp_path, model("Room", inside, "0 0 0 0 0 0")))
    filled = region(thing.slices)
    assert filled.distance(shapely.Point(0, 0)) > 2.9
    assert filled.distance(shapely.Point(4, 0)) < 0.01
