"""Load and draw robots. The names load on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rvsg.core.lazy import lazily

if TYPE_CHECKING:
    from rvsg.robots import load_robot as load_robot
    from rvsg.robots import shipped_robots as shipped_robots
    from rvsg.robots.drawing import draw_robot as draw_robot
    from rvsg_exchange.urdf import read_urdf as read_urdf

__getattr__ = lazily(
    __name__,
    {
        "draw_robot": "rvsg.robots.drawing",
        "load_robot": "rvsg.robots",
        "read_urdf": "rvsg_exchange.urdf",
        "shipped_robots": "rvsg.robots",
    },
)
