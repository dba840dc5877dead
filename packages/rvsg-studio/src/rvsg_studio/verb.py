"""`rvsg studio`: a local web page for a folder of work."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import CONNECT, Verb, verb

app = verb()


@app.command()
def studio(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="The folder with your worlds, campaigns, suites; or a .rvsg file.")
    ] = (Path()),
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port of 127.0.0.1; 0 is any free one. [8420, else any]")
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the address in your browser.")] = True,
) -> None:
    """Open the studio: work with worlds, campaigns and findings in a local web page.

    It shows the worlds (folders with world.yaml), campaigns and suites in DIR, and running jobs.

    \b
    Home           worlds, campaigns, suites, jobs, newest findings
    Campaign       settings with an estimate; watch, pause, stop, resume; confirm a candidate now
    Finding        replay, timeline, charts; shrink, 30 more runs, without people, export, comment
    Scenario       move people, and see at once what the robot does
    World          label areas, draw routes, fix what the check finds; the YAML keeps its comments
    Description    review what a model wrote about a world
    Compare        two campaigns side by side
    Conversations  the prompts and replies of a model, and what the checker found

    The studio serves only this machine, and only a browser with the token in the printed address. It loads nothing from
    the network. Campaigns run in processes of their own and continue when you close the page or the studio. Every
    action shows the command line that does the same.

    Needs the extra `studio`.
    """
    from rvsg_studio.server import serve

    serve(folder, port=port, browser=browser, say=say)


VERBS = {
    "studio": Verb("rvsg_studio.verb", "Open the local web page", CONNECT),
}
