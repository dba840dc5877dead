"""Runs the bridge of rvsg-ros2 from its sources: `python run_bridge.py`, in an environment with rclpy."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Answer RVSG until it closes."""
    sys.path[:0] = [
        str(ROOT / "packages" / "rvsg-ros2" / "src"),
        str(ROOT / "src" / "rvsg" / "simulation" / "stacks" / "clients"),
    ]
    import rvsg_client

    sys.modules["rvsg_ros2.rvsg_client"] = rvsg_client
    import rvsg_ros2

    rvsg_ros2.rvsg_client = rvsg_client
    from rvsg_ros2.bridge import main as serve

    serve()


if __name__ == "__main__":
    main()
