"""The layout for Foxglove that fits the bags of `rvsg.exchange.bag`."""

from __future__ import annotations

import json


def foxglove_layout(lidars: int = 2) -> str:
    """Return a layout as Foxglove imports it: the map with robot and people, and plots of speed and acceleration."""
    scans = {f"/scan_{k}": {"visible": True, "pointSize": 3, "colorField": "range"} for k in range(lidars)}
    topics = {
        "/map": {"visible": True},
        "/global_costmap/costmap": {"visible": False, "colorMode": "costmap"},
        "/local_costmap/costmap": {"visible": True, "colorMode": "costmap"},
        "/local_trajectories": {"visible": True},
        "/local_plan": {"visible": True, "lineWidth": 0.03},
        "/plan": {"visible": True, "lineWidth": 0.04},
        "/people": {"visible": True},
        **scans,
    }
    layout = {
        "configById": {
            "3D!map": {
                "cameraState": {"perspective": False, "distance": 25, "phi": 0, "thetaOffset": 0},
                "followMode": "follow-none",
                "followTf": "map",
                "topics": topics,
                "transforms": {"frame:base_footprint": {"visible": True}},
            },
            "Plot!speed": {
                "title": "Speed, m/s",
                "paths": [
                    {"value": "/odom.twist.twist.linear.x", "enabled": True, "label": "measured"},
                    {"value": "/cmd_vel.linear.x", "enabled": True, "label": "commanded"},
                    {"value": "/human_states.agents[:].linear_vel", "enabled": True, "label": "people"},
                ],
                "showLegend": True,
                "isSynced": True,
            },
            "Plot!acceleration": {
                "title": "Acceleration, m/s²",
                "paths": [
                    {"value": "/imu.linear_acceleration.x", "enabled": True, "label": "ahead"},
                    {"value": "/imu.linear_acceleration.y", "enabled": True, "label": "to the left"},
                ],
                "showLegend": True,
                "isSynced": True,
            },
            "RawMessages!navigation": {"topicPath": "/rvsg/navigation"},
            "RawMessages!tree": {"topicPath": "/behavior_tree_log"},
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": "3D!map",
            "second": {
                "direction": "column",
                "first": "Plot!speed",
                "second": {
                    "direction": "column",
                    "first": "Plot!acceleration",
                    "second": {"direction": "row", "first": "RawMessages!navigation", "second": "RawMessages!tree"},
                },
            },
            "splitPercentage": 65,
        },
    }
    return json.dumps(layout, indent=2, ensure_ascii=False) + "\n"
