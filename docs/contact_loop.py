"""The loop at the top of the README: six seconds of the demonstration's worst run.

`python docs/contact_loop.py` makes it of the stored campaign with `rvsg demo` and `rvsg replay`, so nothing is
simulated; with `--check` it compares the stored picture with a new one.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence

from rvsg.cli import main

LOOP = Path(__file__).with_name("images") / "contact.webp"
WIDTH_PX, FRAMES, FRAME_MS = 1500, 60, 100
PART_PX, CAPTION_PX = (540, 300, 1260, 620), 56
"""The part of the floor around the contact (left, upper, right, lower), and the height of the caption below."""


def frames() -> list[Image.Image]:
    """Return the frames of the loop."""
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.webp"
        for command in (["demo", "--out", folder], ["replay", folder, "--out", str(film), "--width", str(WIDTH_PX)]):
            if main([*command, *(["--speed", "1"] if command[0] == "replay" else [])]) != 0:
                raise SystemExit(f"rvsg {' '.join(command)} failed")
        with Image.open(film) as whole:
            return [
                cut(each.convert("RGB")) for each, _ in zip(ImageSequence.Iterator(whole), range(FRAMES), strict=False)
            ]


def cut(frame: Image.Image) -> Image.Image:
    """Return the part around the contact, with the caption."""
    part = frame.crop(PART_PX)
    sheet = Image.new("RGB", (part.width, part.height + CAPTION_PX), "white")
    sheet.paste(part)
    sheet.paste(frame.crop((0, frame.height - CAPTION_PX, part.width, frame.height)), (0, part.height))
    return sheet


def differs(made: list[Image.Image]) -> bool:
    """Whether the stored loop shows anything else."""
    with Image.open(LOOP) as stored:
        kept = [each.convert("RGB") for each in ImageSequence.Iterator(stored)]
    if len(kept) != len(made) or kept[0].size != made[0].size:
        return True
    pairs = zip(kept, made, strict=True)
    return any(np.abs(np.asarray(a, dtype=int) - np.asarray(b, dtype=int)).mean() > 3.0 for a, b in pairs)


if __name__ == "__main__":
    first, *rest = made = frames()
    if "--check" in sys.argv[1:]:
        sys.exit(f"{LOOP}: it is not the present run; run docs/contact_loop.py" if differs(made) else 0)
    first.save(LOOP, save_all=True, append_images=rest, duration=FRAME_MS, loop=0, quality=70, method=4)
