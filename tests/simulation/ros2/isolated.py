"""Run a Python file where its DDS traffic reaches nobody: in a network namespace with loopback only, or bound to it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
</General><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""


@cache
def namespace() -> tuple[str, ...]:
    """The command that opens a network namespace; empty where that is not allowed."""
    for command in (("unshare", "-rn"), ("unshare", "-n")):
        if shutil.which(command[0]) and subprocess.run([*command, "true"], capture_output=True).returncode == 0:
            return command
    return ()


def drive(peer: dict[str, Any] | None = None, **given: Any) -> dict[str, Any]:
    """Run drive.py with a peer of these options; return what it prints."""
    return run_isolated(HERE / "drive.py", peer=peer, **given)


def run_isolated(file: Path, **given: Any) -> dict[str, Any]:
    """Run a Python file with its options as JSON; return the JSON that it prints last."""
    pytest.importorskip("cyclonedds", reason="ROS 2 needs cyclonedds (extra ros2)")
    paths = [str(HERE.parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    if not namespace():
        environment |= {"CYCLONEDDS_URI": LOOPBACK, "ROS_DOMAIN_ID": str(100 + os.getpid() % 100)}
    command = [*namespace(), sys.executable, str(file), json.dumps(given)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found
