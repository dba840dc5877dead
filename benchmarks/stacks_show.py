"""Six navigation stacks and three robots on the worst scenarios of the warehouse: the figures of docs/explanation.

    rvsg run --stack nav2-dwb-humble --route all --requirement R1 --requirement R2 --requirement clearance \\
        --scenarios 8 --refinements 3 --repeats 4 --confirmations 20 --seed 13 --out runs/search
    python benchmarks/stacks_show.py --suite runs/search
    python benchmarks/stacks_show.py --out runs/stacks --jobs 2
    python benchmarks/stacks_show.py --out runs/stacks --docs docs

The first command searches with `nav2-dwb-humble` and the robot of the study. The second keeps the 30 worst scenarios as
`examples/suites/stacks`, two of every route and requirement. The third drives them; it keeps what every stack and robot
did in a file, and resumes. The last writes the table and the pictures that the documentation holds.
"""

from __future__ import annotations

import argparse
import html
import sys
from pathlib import Path

from rvsg.app.comparison import compare_stacks
from rvsg.app.suites import Suite
from rvsg.evaluation.statistics import wilson
from rvsg.evaluation.verdict import percent
from rvsg.report.charts import COLOURS
from rvsg.report.comparison_page import ranking_markdown, shares_figure
from rvsg.suites.suite import CaseResult, Comparison, SuiteResult, compare
from rvsg.world.drawing.sheet import palette
from rvsg.world.drawing.svg import floor_plan, style
from rvsg.world.world_folder import load_world

HERE = Path(__file__).resolve().parents[1]
SUITE = HERE / "examples" / "suites" / "stacks"
STACKS = ("nav2-dwb-humble", "nav2-rpp", "nav2-mppi", "stop-and-go", "social", "examples/stacks/nav2_params.yaml")
ROBOTS = ("tiago_omni", "industrial_amr", "turtlebot3_waffle")
REQUIREMENTS = ("R1", "R2", "clearance")
SCENARIOS = 30
BEGIN, END = "<!-- tables of benchmarks/stacks_show.py -->", "<!-- end of tables -->"


def keep_worst(searched: Path) -> None:
    """Write the worst scenarios of a folder of campaigns as a suite."""
    from rvsg.app.comparison import tested_in

    suite = Suite.create(SUITE, title="The 30 worst scenarios for nav2-dwb-humble on the five warehouse routes")
    for tested in tested_in(searched, SCENARIOS):
        scenario, (requirement,) = tested.case.scenario, tested.requirements
        name = f"{scenario.mission.route.name}-{requirement.name.lower()}-{tested.case.title.rpartition('#')[2]}"
        suite = suite.add(scenario, requirement.name, name=name, reason="found by a campaign on nav2-dwb-humble")


def driven(out: Path, robots: list[str], runs: int, jobs: int) -> list[SuiteResult]:
    """Drive every stack and robot that has no file in `out` yet; return all of them."""
    results = []
    for robot in robots:
        for stack in STACKS:
            path = out / f"{robot}-{Path(stack).stem}.json"
            if not path.is_file():
                (made,) = compare_stacks(SUITE, [stack], robots=[robot], runs=runs, jobs=jobs).variants
                path.write_text(made.to_json())
                print(f"{made.version}: {made.violated} of {made.judged} runs violate", flush=True)
            results.append(SuiteResult.from_json(path.read_text()))
    return results


def pooled(results: list[SuiteResult]) -> Comparison:
    """Return every stack over all robots, so that a case is a scenario with a robot."""
    each: dict[str, list[SuiteResult]] = {}
    for result in results:
        each.setdefault(Path(result.version.rpartition(" on ")[0]).name, []).append(result)
    whole = []
    for label, parts in each.items():
        cases = [
            case.replace(case=f"{case.case} on {part.version.rpartition(' on ')[2]}")
            for part in parts
            for case in part.cases
        ]
        whole.append(parts[0].replace(version=label, cases=tuple(cases)))
    return compare(whole, source="examples/suites/stacks", ranked=True)


def share(cases: list[CaseResult]) -> str:
    """Return the share of violating runs with its interval."""
    flags = [flag for case in cases for flag in case.flags.values()]
    if not flags:
        return "-"
    low, high = wilson(sum(flags), len(flags))
    return f"{percent(sum(flags) / len(flags))} ({100 * low:.0f} to {100 * high:.0f})"


def parts_table(found: Comparison) -> str:
    """Return the share of each stack by robot and by requirement, as Markdown."""
    groups = [*ROBOTS, *REQUIREMENTS]
    lines = [f"| stack | {' | '.join(groups)} |", f"|{'---|' * (1 + len(groups))}"]
    for score in found.variants:
        cells = [share([case for case in score.cases if case.case.endswith(f" on {robot}")]) for robot in ROBOTS]
        cells += [share([case for case in score.cases if case.requirement == name]) for name in REQUIREMENTS]
        lines.append(f"| {score.version} | {' | '.join(cells)} |")
    return "\n".join(lines)


def places(found: Comparison) -> str:
    """Return an SVG with a floor plan for each stack and the robot's place in every violating run."""
    world = load_world("warehouse")
    plan = floor_plan(world, areas=False, tooltips=False)
    x0, y0, width, height = map(float, plan.view_box.split())
    colours = dict(zip(ROBOTS, COLOURS, strict=False))
    rows = (len(found.variants) + 1) // 2
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * width + 1:.2f} {rows * (height + 2) + 2:.2f}" '
        f'width="1000" font-family="sans-serif" font-size="0.9" role="img" aria-label="Where each stack fails">'
        f'<style>{style(world, palette("light"))}</style><rect width="100%" height="100%" fill="white"/>'
        f'<defs><g id="plan">{plan.shapes}</g></defs>'
    ]
    for k, score in enumerate(found.variants):
        parts.append(
            f'<g transform="translate({(k % 2) * (width + 1) - x0:.2f} {(k // 2) * (height + 2) + 1.5 - y0:.2f})">'
        )
        parts.append(f'<text x="{x0}" y="{y0 - 0.4}">{k + 1}. {html.escape(score.version)}</text><use href="#plan"/>')
        for case in score.cases:
            colour = colours[case.case.rpartition(" on ")[2]]
            for at in case.places:
                x, y = plan.transform.point(*at)
                parts.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="0.2" fill="{colour}" fill-opacity="0.6"/>')
        parts.append("</g>")
    for k, (robot, colour) in enumerate(colours.items()):
        x, y = 0.5 + 8 * k, rows * (height + 2) + 1.2
        parts.append(
            f'<circle cx="{x}" cy="{y}" r="0.3" fill="{colour}"/><text x="{x + 0.5}" y="{y + 0.3}">{robot}</text>'
        )
    return "".join([*parts, "</svg>\n"])


def write_docs(found: Comparison, docs: Path) -> None:
    """Write the pictures, and put the tables between the marks of the page."""
    images = docs / "images"
    (images / "stacks-ranking.svg").write_text(shares_figure(found))
    (images / "stacks-where.svg").write_text(places(found))
    tables = ranking_markdown(found).partition("\n\n")[2]
    page = docs.parent / "benchmarks" / "results" / "stacks.md"
    before, _, rest = page.read_text().partition(BEGIN)
    page.write_text(f"{before}{BEGIN}\n\n{parts_table(found)}\n\n{tables}\n{END}{rest.partition(END)[2]}")


def main() -> int:
    """Keep the suite, drive it, or write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", type=Path, metavar="CAMPAIGNS", help="keep the worst scenarios of these campaigns")
    parser.add_argument("--out", type=Path, default=Path("runs/stacks"))
    parser.add_argument("--robots", nargs="+", default=ROBOTS)
    parser.add_argument("--runs", type=int, default=3, help="seeds of every scenario")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--docs", type=Path, help="write the tables and pictures of the documentation in this folder")
    args = parser.parse_args()
    if args.suite:
        keep_worst(args.suite)
        return 0
    args.out.mkdir(parents=True, exist_ok=True)
    found = pooled(driven(args.out, args.robots, args.runs, args.jobs))
    (args.out / "stacks.json").write_text(found.to_json())
    if args.docs:
        write_docs(found, args.docs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
