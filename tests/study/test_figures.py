from xml.etree import ElementTree

import pytest

from rvsg.study import figures
from rvsg.study.figures import write_repeat_figures
from rvsg.study.material import TABLED, Material, Sample
from rvsg.study.table_files import write_tables

pytest.importorskip("matplotlib")
SVG = "{http://www.w3.org/2000/svg}"


def material(requirement="R1", routes=("route_1", "route_4", "route_5")):
    def samples(shift):
        return [Sample(f"run-{k}", dict.fromkeys(TABLED, shift + 0.1 * k), None, selection=k == 0) for k in range(6)]

    repeats = {(requirement, route): {"best": samples(0.0), "worst": samples(1.0)} for route in routes}
    return Material((), repeats=repeats)


def test_every_requirement_has_a_figure_of_every_metric_and_route(tmp_path):
    (path,) = write_repeat_figures(material(), tmp_path, honest=True)
    assert path.name == "rq3_R1.svg"
    text = path.read_text()
    ElementTree.fromstring(text)
    assert text.count('<g id="axes_') == len(TABLED)
    for name in ("route 1", "route 4", "route 5", "(dto), m", "(jerk), m/s"):
        assert name in text


def test_the_honest_figure_leaves_the_selecting_run_out(tmp_path):
    drawn = {}
    for honest in (False, True):
        (path,) = write_repeat_figures(material(routes=("route_1",)), tmp_path, honest=honest)
        groups = [g for g in ElementTree.parse(path).iter(f"{SVG}g") if g.get("id", "").startswith("runs-")]
        drawn[honest] = {group.get("id"): len(list(group.iter(f"{SVG}use"))) for group in groups}
    names = {f"runs-{name}-route_1-{method}" for name in TABLED for method in ("best", "worst")}
    assert drawn[False] == dict.fromkeys(names, 6)
    assert drawn[True] == dict.fromkeys(names, 5)


def test_equal_material_gives_equal_bytes_and_a_strange_name_a_harmless_file(tmp_path):
    strange = "../$x_1$ & <b>"
    (first,) = write_repeat_figures(material(strange, ("route_1",)), tmp_path, honest=True)
    before = first.read_bytes()
    (again,) = write_repeat_figures(material(strange, ("route_1",)), tmp_path, honest=True)
    assert again == first and first.parent == tmp_path and again.read_bytes() == before
    ElementTree.fromstring(before)


def test_one_sided_and_single_runs_are_drawn(tmp_path):
    few = Material((), repeats={("R3", "route_2"): {"best": [Sample("run-1", {"trg": 20.0}, None)]}})
    (path,) = write_repeat_figures(few, tmp_path, honest=False)
    assert path.read_text().count('<g id="axes_') == 4  # one panel, three empty places


def test_without_matplotlib_the_tables_are_written_and_the_figures_missed(tmp_path, monkeypatch):
    monkeypatch.setattr(figures.importlib.util, "find_spec", lambda name: None)
    assert not figures.can_draw()
    monkeypatch.setattr("rvsg.study.table_files.gather", lambda *_: material())
    monkeypatch.setattr("rvsg.study.material.Material.positions", lambda *_: None)
    monkeypatch.setattr("rvsg.study.tables.simulation_diversity", lambda _: None)
    notes = write_tables(out=tmp_path)
    assert any("-e '.[figures]'" in note for note in notes)
    assert (tmp_path / "honest" / "rq3.csv").exists() and not list(tmp_path.glob("*/*.svg"))
