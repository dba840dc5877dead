"""Puts the client of the stack protocol beside the bridge, which runs where RVSG itself is not installed."""

from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

CLIENT = "../../src/rvsg/simulation/stacks/clients/rvsg_client.py"


class CopyClient(BuildHookInterface):
    """Adds the client from a checkout; an sdist holds it already."""

    def initialize(self, version, build_data):
        """Add it where a build of this kind keeps the package."""
        client = Path(self.root, CLIENT)
        if client.exists():
            package = "src/rvsg_ros2" if self.target_name == "sdist" else "rvsg_ros2"
            build_data["force_include"][str(client)] = f"{package}/{client.name}"
