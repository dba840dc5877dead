"""Navigation stacks under test. The names load on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rvsg.core.lazy import lazily

if TYPE_CHECKING:
    from rvsg.api.stack_comparison import compare_stacks as compare_stacks
    from rvsg.api.stack_comparison import write_comparison as write_comparison
    from rvsg.campaign.stack_scores import StackScore as StackScore
    from rvsg.report.stacks import stacks_markdown as stacks_markdown
    from rvsg.simulation.stacks.clients import write_clients_to as write_clients_to
    from rvsg.simulation.stacks.nav2_params import read_nav2_params as read_nav2_params
    from rvsg.simulation.stacks.registry import DEFAULT_STACK as DEFAULT_STACK
    from rvsg.simulation.stacks.registry import Listed as Listed
    from rvsg.simulation.stacks.registry import StackChoice as StackChoice
    from rvsg.simulation.stacks.registry import listed_stacks as listed_stacks

__getattr__ = lazily(
    __name__,
    {
        "StackScore": "rvsg.campaign.stack_scores",
        "compare_stacks": "rvsg.api.stack_comparison",
        "stacks_markdown": "rvsg.report.stacks",
        "write_comparison": "rvsg.api.stack_comparison",
        "DEFAULT_STACK": "rvsg.simulation.stacks.registry",
        "Listed": "rvsg.simulation.stacks.registry",
        "StackChoice": "rvsg.simulation.stacks.registry",
        "read_nav2_params": "rvsg.simulation.stacks.nav2_params",
        "listed_stacks": "rvsg.simulation.stacks.registry",
        "write_clients_to": "rvsg.simulation.stacks.clients",
    },
)
