"""Six navigation stacks and three robots on the worst scenarios of the warehouse: the figures of docs/explanation.

    rvsg run --route all --requirement R1 --requirement R2 --requirement clearance --scenarios 8 --refinements 3 \\
        --repeats 4 --confirmations 20 --seed 13 --out runs/search
    python benchmarks/stacks_show.py --suite runs/search
    python benchmarks/stacks_show.py --out runs/stacks --jobs 2
    python benchmarks/stacks_show.py --out runs/stacks --page docs

The first command searches with `nav2-dwb` and the robot of the study. The second keeps the 30 worst scenarios as
`examples/suites/stacks`, two of every route and requirement. The third drives them; it keeps what every stack and robot
did in a file, and resumes. The last writes the table and the pictures that the documentation holds.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rvsg.api.stacks import compare_stacks
from rvsg.api.suites import Suite
from rvsg.campaign.stack_scores import StackScore, StackScores, score_stacks

HERE = Path(__file__).resolve().parents[1]
SUITE = HERE / "examples" / "suites" / "stacks"
STACKS = ("nav2-dwb", "nav2-rpp", "nav2-mppi", "stop-and-go", "social", "examples/stacks/nav2_params.yaml")
ROBOTS = ("tiago_omni", "industrial_amr", "turtlebot3_waffle")
SCENARIOS = 30


def keep_worst(searched: Path) -> None:
    """Write the worst scenarios of a folder of campaigns as a suite."""
    from rvsg.api.stack_comparison import tested_in

    suite = Suite.create(SUITE, title="The 30 worst scenarios for nav2-dwb on the five warehouse routes")
    for case in tested_in(searched, SCENARIOS):
        name = f"{case.scenario.mission.route.name}-{case.requirement.name.lower()}-{case.name.rpartition('#')[2]}"
        suite = suite.add(case.scenario, case.requirement.name, name=name, reason="found by a campaign on nav2-dwb")


def driven(out: Path, runs: int, jobs: int) -> StackScores:
    """Drive every stack and robot that has no file in `out` yet; return all of them."""
    scores = []
    for robot in ROBOTS:
        for stack in STACKS:
            path = out / f"{robot}-{Path(stack).stem}.json"
            if not path.is_file():
                found = compare_stacks(SUITE, [stack], robots=[robot], runs=runs, jobs=jobs)
                path.write_text(found.scores[0].to_json())
                score = found.scores[0]
                print(f"{score.label}: {score.violated} of {score.judged} runs violate", flush=True)
            scores.append(StackScore.from_json(path.read_text()))
    cases = list(dict.fromkeys(run.case for score in scores for run in score.runs))
    return score_stacks("examples/suites/stacks", cases, runs, scores)


def main() -> int:
    """Keep the suite, drive it, or write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", type=Path, metavar="CAMPAIGNS", help="keep the worst scenarios of these campaigns")
    parser.add_argument("--out", type=Path, default=Path("runs/stacks"))
    parser.add_argument("--runs", type=int, default=3, help="seeds of every scenario")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    if args.suite:
        keep_worst(args.suite)
        return 0
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "stacks.json").write_text(driven(args.out, args.runs, args.jobs).to_json())
    return 0


if __name__ == "__main__":
    sys.exit(main())
