"""Files of tracks, cleaning, and people without names."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from rvsg.core.errors import FileError
from rvsg.core.records import Pose
from rvsg.recording.inspection import inspect
from rvsg.recording.tracker import LaserScan, people_in_scans, track_places
from rvsg.recording.tracks import PersonTrack, Recording, clean, load_recording
from rvsg.world.world import OccupancyMap
from rvsg.world.world_folder import load_world

T = np.arange(0.0, 10.0, 0.1)


def walk(name: str, x: np.ndarray, y: np.ndarray, t: np.ndarray = T) -> PersonTrack:
    return PersonTrack(name=name, rows=np.column_stack([t, x, y, np.zeros(len(t)), np.full(len(t), np.nan)]))


def drive(x: np.ndarray = 0.5 * T, t: np.ndarray = T) -> np.ndarray:
    return np.column_stack([t, x, np.zeros((len(t), 2)), np.full(len(t), 0.5), np.zeros((len(t), 2))])


def of(*people: PersonTrack) -> Recording:
    return Recording(source="bag", people=people, robot=drive())


def kinds(found: Recording) -> dict[str, int]:
    return {note.kind: note.count for note in found.notes}


def test_what_needs_no_mending_stays() -> None:
    found = clean(of(walk("Ann", 8.0 - T, np.full(len(T), 1.0))))
    assert found.notes == ()
    (ann,) = found.people
    assert ann.rows[:, 1] == pytest.approx(8.0 - ann.rows[:, 0] - found.begin_s - 0.0, abs=0.02)
    assert np.diff(ann.rows[:, 0]) == pytest.approx(0.2)


def test_noise_is_smoothed_and_the_note_says_how_much() -> None:
    rng = np.random.default_rng(1)
    noisy = walk("Ann", 8.0 - T + rng.normal(0, 0.05, len(T)), 1.0 + rng.normal(0, 0.05, len(T)))
    found = clean(of(noisy))
    (ann,) = found.people
    off = np.hypot(ann.rows[:, 1] - (8.0 - ann.rows[:, 0] - clean(of(noisy)).begin_s), ann.rows[:, 2] - 1.0)
    assert math.sqrt((off**2).mean()) < 0.04
    assert kinds(found)["smooth"] == 1 and "0.0" in str(found.notes[-1])


def test_odometry_tells_where_a_drive_began() -> None:
    """The places alone tell little of where a robot stood that soon drives a bend."""
    t = np.arange(0.0, 12.0, 0.05)
    speed, yaw = np.clip(0.5 * t - 0.1, 0.0, 0.5), 0.8 * np.sin(t)
    way = np.cumsum(0.05 * speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)]), axis=0)
    ann = walk("Ann", 8.0 - T, np.full(len(T), 1.0))
    off = {}
    for odometry in (True, False):
        errors = []
        for seed in range(8):
            places = way + np.random.default_rng(seed).normal(0.0, 0.05, way.shape)
            robot = np.column_stack([t, places, yaw, speed, np.gradient(yaw, t), np.zeros(len(t))])
            found = clean(Recording(source="bag", people=(ann,), robot=robot, odometry=odometry, goal_s=0.0))
            assert len(found.robot) == len(t)
            errors.append(np.hypot(*(found.robot[:, 1:3] - way).T)[:20].mean())
        off[odometry] = float(np.mean(errors))
    assert off[True] < 0.6 * off[False] and off[True] < 0.015


def test_samples_that_jump_are_left_out_and_counted() -> None:
    x = 8.0 - T
    x[40], x[70] = 30.0, -30.0
    found = clean(of(walk("Ann", x, np.full(len(T), 1.0))))
    assert kinds(found)["jump"] == 2 and len(found.people) == 1
    assert found.people[0].rows[:, 1].max() < 8.1


def test_exchanged_names_are_mended() -> None:
    a, b = np.column_stack([8.0 - T, np.full(len(T), 1.0)]), np.column_stack([T - 2.0, np.full(len(T), 4.0)])
    a[50:], b[50:] = b[50:].copy(), a[50:].copy()
    found = clean(of(walk("Ann", *a.T), walk("Bo", *b.T)))
    assert kinds(found)["identity"] == 2
    ann, bo = found.people
    assert ann.rows[:, 2] == pytest.approx(1.0, abs=0.05) and bo.rows[:, 2] == pytest.approx(4.0, abs=0.05)


def test_a_track_that_is_found_again_before_it_ends_is_one_person() -> None:
    first, again = walk("1", (8.0 - T)[:52], np.ones(52), T[:52]), walk("2", (8.0 - T)[50:], np.ones(50), T[50:])
    (one,) = clean(of(first, again)).people
    assert one.rows[-1, 0] > 8.0 and (np.diff(one.rows[:, 0]) > 0.0).all()


def test_short_gaps_are_crossed_and_long_ones_make_another_person() -> None:
    keep = ~((T > 2.0) & (T < 4.0))
    found = clean(of(walk("Ann", 8.0 - T[keep], np.ones(keep.sum()), T[keep])))
    assert kinds(found)["gap"] == 1 and len(found.people) == 1
    keep = ~((T > 2.0) & (T < 7.5))
    found = clean(of(walk("Ann", 8.0 - T[keep], np.ones(keep.sum()), T[keep])))
    assert kinds(found)["long-gap"] == 1 and [person.name for person in found.people] == ["Ann", "Ann (2)"]


def test_people_of_a_moment_are_left_out_with_a_note_and_nobody_left_is_refused() -> None:
    short = walk("Bo", 8.0 - T[:5], np.ones(5), T[:5] + 3.0)
    assert kinds(clean(of(walk("Ann", 8.0 - T, np.ones(len(T))), short)))["short"] == 1
    for people in ((), (short,), (walk("One", np.ones(1), np.ones(1), T[:1]),)):
        with pytest.raises(FileError):
            clean(of(*people))


def test_people_without_names_keep_theirs_where_they_cross() -> None:
    frames = [
        (float(t), np.array([[8.0 - t, 0.5 * t], [t - 1.0, 4.0 - 0.5 * t]])[:: (-1) ** k]) for k, t in enumerate(T)
    ]
    tracks = track_places(frames)
    assert len(tracks) == 2 and all(len(track.rows) == len(T) for track in tracks)
    for track in tracks:
        assert np.abs(np.diff(track.rows[:, 1])).max() < 0.15


def test_people_are_found_in_scans_of_their_legs() -> None:
    cells = np.zeros((200, 200), np.uint8)
    cells[[0, -1], :] = 100
    room = OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=0.0, y=0.0))
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)

    def seen(t: float) -> LaserScan:
        legs = [(7.0 - 0.8 * t, 6.0), (7.15 - 0.8 * t, 6.25), (2.5, 2.5)]  # a walker, and something that stands
        ranges = np.full(len(angles), np.inf)
        for x, y in legs:
            away, bearing = math.hypot(x - 5.0, y - 5.0), math.atan2(y - 5.0, x - 5.0)
            off = away * np.sin(angles - bearing)
            hit = (np.abs(off) < 0.06) & (np.cos(angles - bearing) > 0)
            ranges[hit] = np.minimum(
                ranges[hit], away * np.cos(angles - bearing)[hit] - np.sqrt(0.0036 - off[hit] ** 2)
            )
        return LaserScan(t, (5.0, 5.0, 0.0), angles, ranges)

    (walker,) = people_in_scans([seen(float(t)) for t in T[:50]], room)
    expected = np.column_stack([7.075 - 0.8 * walker.rows[:, 0], np.full(len(walker.rows), 6.125)])
    assert np.hypot(*(walker.rows[:, 1:3] - expected).T).max() < 0.2
    assert 0.0 < walker.spread_m < 0.1


CSV = "id,t_ms,x_cm,y_cm\n" + "\n".join(
    f"{name},{round(100 * k)},{x},{y}"
    for k in range(50)
    for name, x, y in (("7", 800 - 10 * k, 100), ("robot", 5 * k, 0))
)


def test_tables_are_read_in_their_units(tmp_path: Path) -> None:
    world = load_world("warehouse")
    path = tmp_path / "tracks.csv"
    path.write_text(CSV)
    found = load_recording(path)
    assert [person.name for person in found.people] == ["Person 7"]
    assert found.people[0].rows[-1, :3] == pytest.approx([4.9, 3.1, 1.0])
    assert found.robot[-1, :3] == pytest.approx([4.9, 2.45, 0.0]) and found.robot[:, 4] == pytest.approx(0.5)
    moved = load_recording(path, world=world)
    assert moved.people[0].rows[0, 1:3] == pytest.approx(np.array([8.0, 1.0]) + world.map_offset)
    rows = [{"id": "Ann", "t": 0.1 * k, "x": 1.0 * k, "y": 0.0, "yaw": 0.0, "speed": 1.0} for k in range(5)]
    path = tmp_path / "tracks.json"
    path.write_text(json.dumps({"frame": "world", "tracks": rows}))
    assert load_recording(path, world=world).people[0].rows[3, 1] == 3.0
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.Table.from_pylist(rows), tmp_path / "tracks.parquet")
    assert load_recording(tmp_path / "tracks.parquet").people[0].rows[3, 1] == 3.0


def test_texts_of_public_data_sets_are_read(tmp_path: Path) -> None:
    path = tmp_path / "obsmat.txt"
    path.write_text("".join(f"{780 + 6 * k}.0 1 {k}.5 0 2.5 0 0 0\n" for k in range(5)))
    rows = load_recording(path).people[0].rows
    assert rows[:, 0] == pytest.approx([0.0, 0.4, 0.8, 1.2, 1.6]) and rows[2, 1:3] == pytest.approx([2.5, 2.5])
    path = tmp_path / "scene.ndjson"
    lines = [{"scene": {"id": 1, "p": 3, "s": 0, "e": 40, "fps": 2.5}}]
    lines += [{"track": {"f": 10 * k, "p": 3, "x": 0.5 * k, "y": 1.0}} for k in range(5)]
    path.write_text("\n".join(map(json.dumps, lines)))
    (person,) = load_recording(path).people
    assert person.rows[:, 0] == pytest.approx([0.0, 0.4, 0.8, 1.2, 1.6]) and person.name == "Person 3"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", ""),
        ("a.csv", "id,t,x\n1,0,0\n"),
        ("a.csv", "id,t,x,y\n1,0,0,north\n"),
        ("a.csv", "id,t,x,y,frame\n1,0,0,0,camera\n"),
        ("a.csv", "id,t,x,y\n1,100,0,0\n1,5,0,0\n"),
        ("a.csv", "id,t,x,y,yaw\nrobot,0,0,0,1\nrobot,1,0,0,90\n"),
        ("a.csv", b"id,t,x,y\n1,0,0,0\n1,1,\x80,0\n"),
        ("a.csv", "id,t,x,y\n1,0,0,0,5\n1,1"),
        ("a.json", "[1, 2]"),
        ("a.json", '{"tracks": 3'),
        ("a.txt", "1 2 3\n"),
        ("a.txt", '{"track": {"f": 1}}\n'),
        ("a.parquet", "no table"),
        ("absent.csv", None),
    ],
)
def test_files_that_are_no_tracks_are_refused(tmp_path: Path, name: str, text: str | bytes | None) -> None:
    if text is not None:
        (tmp_path / name).write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(FileError):
        load_recording(tmp_path / name)


def test_a_column_that_is_not_read_is_told_and_a_yaw_with_its_unit_is_taken(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("id,t,x,y,yaw_rad,theta\nrobot,0,0,0,20,1\nrobot,1,1,0,20,1\n")
    found = load_recording(tmp_path / "a.csv")
    assert [note.text for note in found.notes if note.kind == "columns"] == ["Columns that are not read: theta."]
    assert found.robot[0, 3] == pytest.approx(20.0)


def test_many_people_are_counted_and_not_listed() -> None:
    found = inspect(of(*(walk(f"p{k}", T, T + k) for k in range(200)))).lines
    assert len(found) < 40 and "170 more people, whom --json lists" in found and found[-1].endswith(", and 170 more.")
