"""`rvsg studio`: the local web page of a folder of work."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def studio(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder with your worlds, campaigns, suites.")] = (
        Path()
    ),
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port of 127.0.0.1; 0 is any free one. [8420, else any]")
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the address in your browser.")] = True,
) -> None:
    """Open the studio: work with worlds, campaigns and findings in a local web page.

    It shows what lies in DIR: worlds (folders with world.yaml), campaigns, suites, and running jobs.

    \b
    Home           worlds, campaigns, suites, jobs, newest findings
    Campaign       settings with an estimate; watch, pause, stop, resume; confirm a candidate now
    Finding        replay, timeline, charts; shrink, 30 more runs, without people, export, comment
    Scenario       move people, and see what it does to the robot at once
    World          label areas, draw routes, mend what the check finds; the YAML keeps its comments
    Description    review what a model wrote of a world
    Compare        two campaigns side by side
    Conversations  what a model was asked and answered, and what the checker said

    The page is served to this machine alone, and only to who has the token in the printed address. Nothing is loaded
    from the network. Campaigns run in processes of their own: they go on when you close the page or the studio.
    Every action shows the command line that does the same.

    Needs the extra `studio`.
    """
    from rvsg.studio.server import serve

    serve(folder, port=port, browser=browser, say=say)
