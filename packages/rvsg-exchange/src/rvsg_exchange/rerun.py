"""Runs as a recording of Rerun (`.rrd`), for its viewer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError, how_to_install
from rvsg.core.files import write_whole
from rvsg.report.run_facts import footprint_of
from rvsg.simulation.exporter import Exportable, Exporter

Floats = NDArray[np.float64]


class Rerun(Exporter):
    """One run: the objects of the world, the robot's footprint, people as discs, speeds; needs rerun-sdk."""

    takes = "runs"

    def check(self) -> None:
        """Raise InputError where rerun-sdk is not installed."""
        try:
            import rerun  # noqa: F401
        except ImportError:
            raise InputError(f"Rerun needs rerun-sdk: {how_to_install('rerun')}.") from None

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the run in the world frame (x, y, m; z up), on a timeline of simulated seconds."""
        self.check()
        import rerun as rr

        if len(source.runs) != 1:
            raise InputError(f"A recording of Rerun holds one run, and {len(source.runs)} are given.")
        run, track = source.runs[0], source.runs[0].trajectory
        clock = [rr.TimeColumn("simulated", duration=track.t)]
        with rr.RecordingStream("rvsg", recording_id=run.id) as to:
            stream = rr.binary_stream(to)
            to.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            if source.world is not None:
                rings = [_flat([*thing.footprint, thing.footprint[0]]) for thing in source.world.objects]
                to.log("world", rr.LineStrips3D(rings, colors=[120, 130, 140]), static=True)

            def moving(name: str, outline: Floats, pose: tuple[Floats, Floats, Floats], speed: Floats) -> None:
                x, y, half = pose[0], pose[1], pose[2] / 2
                none = np.zeros_like(x)
                placed = rr.Transform3D.columns(
                    translation=np.column_stack([x, y, none]),
                    quaternion=np.column_stack([none, none, np.sin(half), np.cos(half)]),
                )
                to.send_columns(name, indexes=clock, columns=placed)
                to.log(f"{name}/outline", rr.LineStrips3D([outline], labels=[name.rpartition("/")[2]]), static=True)
                to.send_columns(f"speed/{name}", indexes=clock, columns=rr.Scalars.columns(scalars=speed))

            body = [*footprint_of(run, None)]
            moving("robot", _flat([*body, body[0]]), (track.x, track.y, track.yaw), track.v)
            around = np.linspace(0.0, 2.0 * np.pi, 33)
            for k, name in enumerate(run.human_names):
                disc = run.human_radius_m[k] * np.column_stack([np.cos(around), np.sin(around)])
                pose = (track.human_x[:, k], track.human_y[:, k], track.human_yaw[:, k])
                moving(f"people/{name}", _flat([(0.0, 0.0), *disc.tolist()]), pose, track.human_speed[:, k])
            write_whole(path, stream.read() or b"")
        return ()


def _flat(points: list[tuple[float, float]]) -> Floats:
    """Return points of the floor as points of space."""
    return np.column_stack([np.asarray(points, dtype=float), np.zeros(len(points))])
