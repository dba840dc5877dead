from xml.etree import ElementTree

import pytest

from rvsg_study import table_files
from rvsg_study.study_tables import TABLED, Material, Sample
from rvsg_study.table_files import write_repeat_figures, write_tables

pytest.importorskip("matplotlib")
SVG = "{http://www.w3.org/2000/svg}"


def material(requirement="R1", routes=("route_1", "route_4", "route_5")):
    def samples(shift):
        return [Sample(f"run-{k}", dict.fromkeys(TABLED, shift + 0.1 * k), None, selection=k == 0) for k in range(6)]

    repeats = {(requirement, route): {"best": samples(0.0), "worst": samples(1.0)} for route in routes}
    return Material((), repeats=repeats)


STRANGE = "../$x_1$ & <b>"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """The figures of two routes by whether they leave out the run that selected a scenario."""
    found = {}
    for honest in (False, True):
        folder = tmp_path_factory.mktemp("figures")
        (found[honest],) = write_repeat_figures(material(STRANGE, ("route_1", "route_4")), folder, honest=honest)
        assert found[honest].parent == folder, "a strange name gives a harmless file"
    return found


def test_every_requirement_has_a_figure_of_every_metric_and_route(drawn):
    text = drawn[True].read_text()
    ElementTree.fromstring(text)
    assert text.count('<g id="axes_') == len(TABLED)
    for name in ("route 1", "route 4", "(dto), m", "(jerk), m/s"):
        assert name in text


def test_the_honest_figure_leaves_the_selecting_run_out(drawn):
    routes = ("route_1", "route_4")
    names = {f"runs-{name}-{route}-{method}" for name in TABLED for route in routes for method in ("best", "worst")}
    for honest, runs in ((False, 6), (True, 5)):
        groups = [g for g in ElementTree.parse(drawn[honest]).iter(f"{SVG}g") if g.get("id", "").startswith("runs-")]
        assert {g.get("id"): len(list(g.iter(f"{SVG}use"))) for g in groups} == dict.fromkeys(names, runs)


def test_equal_material_gives_equal_bytes(drawn, tmp_path):
    (again,) = write_repeat_figures(material(STRANGE, ("route_1", "route_4")), tmp_path, honest=True)
    assert (again.name, again.read_bytes()) == (drawn[True].name, drawn[True].read_bytes())


def test_one_sided_and_single_runs_are_drawn(tmp_path):
    few = Material((), repeats={("R3", "route_2"): {"best": [Sample("run-1", {"trg": 20.0}, None)]}})
    (path,) = write_repeat_figures(few, tmp_path, honest=False)
    assert path.read_text().count('<g id="axes_') == 4  # one panel, three empty places


def test_without_matplotlib_the_tables_are_written_and_the_figures_missed(tmp_path, monkeypatch):
    monkeypatch.setattr(table_files.importlib.util, "find_spec", lambda name: None)
    assert not table_files.can_draw()
    monkeypatch.setattr("rvsg_study.table_files.gather", lambda *_: material())
    monkeypatch.setattr("rvsg_study.study_tables.Material.positions", lambda *_: None)
    monkeypatch.setattr("rvsg_study.study_tables.simulation_diversity", lambda _: None)
    notes = write_tables(out=tmp_path)
    assert any("-e '.[figures]'" in note for note in notes)
    assert (tmp_path / "honest" / "rq3.csv").exists() and not list(tmp_path.glob("*/*.svg"))
