"""What an assistant can do: the SDK's client speaks to the server over standard input and output."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp.client.stdio import stdio_client

from mcp import ClientSession, StdioServerParameters
from rvsg.core.errors import InputError
from rvsg_mcp.tools import AssistantFolder

PLACE = {"world": "warehouse", "route": "route_1"}
PERSON = {"name": "Anna", "waypoints": ["E19", "E21"], "speed_m_s": 1.0}


def asked(
    folder: Path, *calls: tuple[str, dict[str, Any]], on_progress: Callable[[float], None] | None = None
) -> list[Any]:
    """Start the server on a folder, call tools in order, and return their results."""

    async def talk() -> list[Any]:
        command = StdioServerParameters(
            command=sys.executable, args=["-m", "rvsg_mcp", str(folder)], env=dict(os.environ)
        )

        async def heard(progress: float, total: float | None, message: str | None) -> None:
            if on_progress is not None:
                on_progress(progress)

        async with stdio_client(command) as (read, write), ClientSession(read, write) as session:
            await session.initialize()
            return [await session.call_tool(name, options, progress_callback=heard) for name, options in calls]

    return anyio.run(talk)


def text_of(result: Any) -> str:
    return "\n".join(part.text for part in result.content if part.type == "text")


@pytest.mark.slow
def test_an_assistant_writes_a_scenario_and_runs_a_campaign(tmp_path: Path) -> None:
    progress: list[float] = []
    catalogue, world, scenario, wrong, outside, code, campaign, listed, findings, finding, suite = asked(
        tmp_path,
        ("catalogue", {}),
        ("show_world", {"world": "warehouse"}),
        ("write_scenario", {"file": "a.json", "people": [PERSON]} | PLACE),
        ("write_scenario", {"file": "b.json", "world": "warehouse", "route": "route_9", "people": []}),
        ("simulate", {"scenario": "../a.json"}),
        ("simulate", {"scenario": "a.json", "stack": "exec:touch here"}),
        ("run_campaign", {"out": "first", "simulator": "kinematic", "scenarios": 1} | PLACE),
        ("campaigns", {}),
        ("findings", {"campaign": "first"}),
        ("findings", {"campaign": "first", "number": "1.1"}),
        ("keep", {"suite": "suite", "scenario": "a.json", "requirement": "R1"}),
        on_progress=progress.append,
    )  # fmt: skip
    assert "warehouse" in text_of(catalogue) and "nav2-dwb" in text_of(catalogue)
    assert [part.type for part in world.content] == ["text", "image"]
    assert not scenario.is_error and (tmp_path / "a.json").exists()
    assert wrong.is_error and "route_1" in text_of(wrong)
    assert outside.is_error and "outside the folder" in text_of(outside)
    assert code.is_error and not (tmp_path / "here").exists()
    assert not campaign.is_error, text_of(campaign)
    assert progress == sorted(progress) and progress
    assert "first" in text_of(listed)
    assert (tmp_path / "first" / "report.html").exists() and text_of(findings)
    assert [part.type for part in finding.content][-1] == "image"
    assert (tmp_path / "first" / "scenario-1.1.json").exists() and "Human 1" in text_of(finding)
    assert "1 case" in text_of(suite)


def test_a_path_outside_of_the_workspace_is_refused(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("/etc")
    workspace = AssistantFolder(tmp_path)
    for name in ("../x", "/etc/passwd", "link/passwd"):
        with pytest.raises(InputError) as caught:
            workspace.path(name)
        assert caught.value.code == "outside-workspace"
