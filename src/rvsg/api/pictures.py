"""Pictures of runs for a notebook."""

from __future__ import annotations

import html
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.world.drawing.svg import floor_plan

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rvsg.api.simulating import RunSet

ROBOT = "#1f4e9e"
PEOPLE = ("#d9630a", "#0b8f7a", "#a23bb8", "#8a6d00", "#c2255c", "#3f7d20", "#5b5fc7", "#9c4a2f")
STEP = 4
"""Every n-th sample becomes a point of a line."""


@dataclass(frozen=True)
class Picture:
    """A picture as SVG; a notebook shows it."""

    svg: str

    def save(self, path: str | Path) -> None:
        """Write the picture to an SVG file."""
        write_whole(Path(path), self.svg)

    def _repr_svg_(self) -> str:
        return self.svg


def picture_of(runs: RunSet) -> Picture:
    """Return the floor plan with the ways of the robot (blue) and every person in all runs.

    Raises:
        InputError: the world of the runs is not known.
    """
    if runs.world is None:
        raise InputError("The world of these runs is not known: load them with load_runs(path, scenario=...).")
    plan = floor_plan(runs.world, areas=True)
    lines = []
    names = runs[0].human_names if runs.runs else ()
    opacity = max(0.15, 1.0 / max(1, len(runs)))
    for run in runs:
        path = run.trajectory
        for h, name in enumerate(run.human_names):
            colour = PEOPLE[h % len(PEOPLE)]
            lines.append(_line(path.human_x[:, h], path.human_y[:, h], colour, opacity, name))
        lines.append(_line(path.x, path.y, ROBOT, opacity, "robot"))
    key = "; ".join(f"{html.escape(name)} {PEOPLE[h % len(PEOPLE)]}" for h, name in enumerate(names))
    return Picture(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{plan.view_box}" width="640" role="img">'
        f"<title>Ways of the robot {ROBOT}; {key}</title><style>{_STYLE}</style>{plan.shapes}{plan.names}"
        f'<g transform="{plan.matrix}">{"".join(lines)}</g></svg>'
    )


_STYLE = (
    ".floor{fill:#f7f6f2}.wall{fill:#454545}.thing{fill:#c9c4b8}.area{fill:#e6eef5}"
    ".area-name{fill:#444;font-family:sans-serif}.waypoint{fill:none}"
)


def _line(x: NDArray[np.float64], y: NDArray[np.float64], colour: str, opacity: float, name: str) -> str:
    points = " ".join(f"{a:.2f},{b:.2f}" for a, b in zip(x[::STEP], y[::STEP], strict=True))
    return (
        f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="0.08" opacity="{opacity:.2f}">'
        f"<title>{html.escape(name)}</title></polyline>"
    )
