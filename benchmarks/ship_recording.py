"""Make a shipped demonstration of the recorded calls of a campaign, or of a description.

    rvsg run examples/recordings/NAME/campaign.yaml --model PROVIDER:MODEL --out runs/NAME
    python benchmarks/ship_recording.py runs/NAME/vlm NAME

    rvsg world describe warehouse --model PROVIDER:MODEL --record runs/describe-warehouse --out description.yaml
    python benchmarks/ship_recording.py runs/describe-warehouse describe-warehouse

Answered calls and the messages they refer to are copied, without the pictures (they are drawn anew) and without calls
that failed. The description comes first, for it stands in every prompt: store it in the world's world.yaml.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from rvsg.generation.vlm.call_log import CALLS, HISTORIES, MEASURED, MESSAGES, CallLog

ROOT = Path(__file__).resolve().parents[1]


def folder_of(name: str) -> Path:
    """The folder of a recording: that of the package for the shipped one, else that of the examples."""
    shipped = ROOT / "src" / "rvsg" / "app" / "recordings" / name
    return shipped if shipped.exists() else ROOT / "examples" / "recordings" / name


def ship(recording: Path, name: str) -> None:
    """Copy what a replay needs of a recording into the folder of the demonstration."""
    answered = {call.key for call in CallLog(recording) if call.answer is not None}
    calls = [call for call in lines(recording / CALLS) if call["key"] in answered and call["answer"] is not None]
    histories = lines(recording / HISTORIES)
    needed = {message for entry in (*calls, *histories) for message in entry["messages"]}
    needed |= {call["shape"] for call in calls if call["shape"]}
    sessions = {call["session"] for call in calls}
    kept = {
        CALLS: calls,
        MESSAGES: [entry for entry in lines(recording / MESSAGES) if entry["id"] in needed],
        HISTORIES: histories,
        MEASURED: [entry for entry in lines(recording / MEASURED) if entry["session"] in sessions],
    }
    folder = folder_of(name)
    folder.mkdir(exist_ok=True)
    for file, entries in kept.items():
        path = folder / file
        if not entries:
            path.unlink(missing_ok=True)
            continue
        text = "".join(json.dumps(e, ensure_ascii=False, sort_keys=True, separators=(",", ":")) + "\n" for e in entries)
        path.write_text(text, encoding="utf-8")
    print(f"{name}: {len(calls)} calls of {len(sessions)} sessions, {len(kept[MESSAGES])} messages in {folder}")


def lines(path: Path) -> list[dict[str, Any]]:
    """The objects of a file of JSON lines; none where there is no such file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, help="the folder with the recorded calls (calls.jsonl)")
    parser.add_argument("name", help="the demonstration")
    given = parser.parse_args()
    ship(given.recording, given.name)
