"""First proposal of labels: neighbours of a kind become "Shelf 1" to "Shelf 6", open floor becomes areas."""

from __future__ import annotations

import difflib
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from rvsg.world.rooms import areas_of_rooms, without_building
from rvsg.world.schema import rectangle_outline
from rvsg.world.space import Bools, Space, coarser, human_space_of, main_floor
from rvsg.world.world import Area, OccupancyMap, Polygon, SolidObject

Rectangle = tuple[float, float, float, float]

NOT_WORKED = re.compile(
    r"\b(wall|ground|floor|roof|ceiling|lamp|light|window|sun|door|column|pillar|portrait|painting|poster)\b"
)
GAP_M = 0.6  # things nearer to each other than a person can pass between are worked as one
LARGE = 4.0
LONGEST_M = 7.0  # a longer shelf is labelled in parts
PART_M = 4.5
SMALLEST_THING_M = 0.3
FLOOR_SIDE_M = 8.0
FLOOR_LEAST_M2 = 4.0
FLOOR_NARROWEST_M = 1.2
CORRIDOR_WIDTH_M = 2.6
MOST_FLOOR_AREAS = 12
MOST_OBSTACLES = 30
SEARCH_CELLS = 160
ENCLOSED_FLOOR = 0.5
PILLAR_M, PILLAR_RATIO = 0.25, 2.0
FEWEST_ROOMS = 3  # with fewer the floor is one open place, which is labelled by rectangles


def propose_areas(objects: Sequence[SolidObject], occupancy: OccupancyMap) -> tuple[Area, ...]:
    """Propose areas without waypoints: things by kind (or a bare map's obstacles), and rooms or parts of open floor.

    `occupancy` lies in the world frame with origin yaw 0.
    """
    space = human_space_of(objects, occupancy)
    apart = {id(thing) for thing in without_building(objects, occupancy)}
    furniture = []
    for thing in objects:
        short, long = sorted(thing.box.size[:2])
        if id(thing) in apart:
            furniture.append(thing)
        elif short >= PILLAR_M and long <= min(PILLAR_RATIO * short, 2.0):  # a pillar or the like, and no wall
            furniture.append(thing.replace(kind="fixture"))
    things = areas_of_objects(furniture) if objects else areas_of_obstacles(occupancy, space)
    rooms = areas_of_rooms(space, main_floor(space))
    return (*things, *(rooms if len(rooms) >= FEWEST_ROOMS else areas_of_floor(space) or rooms))


# --- things -------------------------------------------------------------------------------------------------------


def readable_kind(kind: str) -> str:
    """Return the words of a model's name: "aws_ShelfD_01" is "Aws Shelf", "PalletJackB_01" is "Pallet Jack"."""
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", kind)
    while len(words) > 1 and (words[-1].isdigit() or len(words[-1]) == 1):
        words.pop()
    return " ".join(word[:1].upper() + word[1:] for word in words) or "Object"


def areas_of_objects(objects: Sequence[SolidObject]) -> tuple[Area, ...]:
    """Return one area per cluster of neighbouring things of one kind; what is longer than 7 m in equal parts."""
    by_kind: dict[str, list[SolidObject]] = defaultdict(list)
    for thing in objects:
        word = readable_kind(thing.kind)
        if not NOT_WORKED.search(word.lower()) and max(thing.box.size[:2]) >= SMALLEST_THING_M:
            by_kind[word].append(thing)
    areas: list[Area] = []
    for word, things in by_kind.items():
        sizes = [thing.box.size[0] * thing.box.size[1] for thing in things]
        for large, name in ((False, word), (True, f"Large {word}")):  # several times as large as their namesakes
            members = [t for t, size in zip(things, sizes, strict=True) if (size >= LARGE * min(sizes)) == large]
            outlines = [part for cluster in _clusters(members) for part in _outlines(cluster)] if members else []
            areas += _numbered(name, name.lower(), outlines, region=_plural(name))
    return tuple(areas)


def _clusters(things: Sequence[SolidObject]) -> list[list[SolidObject]]:
    """Groups of things connected by gaps below GAP_M."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from shapely import Polygon, STRtree

    shapes = [Polygon(thing.footprint) for thing in things]
    pairs = STRtree(shapes).query(shapes, predicate="dwithin", distance=GAP_M)
    graph = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(len(things), len(things)))
    groups: dict[int, list[SolidObject]] = defaultdict(list)
    for thing, group in zip(things, connected_components(graph)[1].tolist(), strict=True):
        groups[group].append(thing)
    return list(groups.values())


def _outlines(cluster: Sequence[SolidObject]) -> list[Polygon]:
    """Return the outline of a cluster: a rectangle where it nearly is one, else the convex hull; long ones in parts."""
    from shapely import Polygon, get_coordinates, unary_union

    whole = unary_union([Polygon(thing.footprint) for thing in cluster])
    x0, y0, x1, y1 = (float(v) for v in whole.bounds)
    hull = whole.convex_hull
    if hull.area < 0.7 * (x1 - x0) * (y1 - y0):
        hull = hull.minimum_rotated_rectangle if hull.minimum_rotated_rectangle.area < 1.3 * hull.area else hull
        return [tuple((round(float(x), 2), round(float(y), 2)) for x, y in get_coordinates(hull)[:-1])]
    return [rectangle_outline(part) for part in _parts((x0, y0, x1, y1), LONGEST_M, PART_M)]


def _parts(rectangle: Rectangle, longest: float, part: float) -> list[Rectangle]:
    """Return the rectangle, cut across its sides that are longer than `longest` into equal parts of about `part`."""
    x0, y0, x1, y1 = rectangle
    columns = max(1, math.ceil((x1 - x0) / part - 0.5)) if x1 - x0 > longest else 1
    rows = max(1, math.ceil((y1 - y0) / part - 0.5)) if y1 - y0 > longest else 1
    xs, ys = np.linspace(x0, x1, columns + 1).round(2), np.linspace(y0, y1, rows + 1).round(2)
    return [
        (float(xs[i]), float(ys[j]), float(xs[i + 1]), float(ys[j + 1])) for j in range(rows) for i in range(columns)
    ]


def _numbered(word: str, kind: str, outlines: Iterable[Polygon], *, region: str | None) -> list[Area]:
    """Areas named "Word 1", "Word 2", ... from top to bottom and left to right; one alone has no number."""
    ordered = sorted(outlines, key=lambda outline: (-round(_middle(outline)[1]), _middle(outline)[0]))
    names = [word] if len(ordered) == 1 else [f"{word} {i}" for i in range(1, len(ordered) + 1)]
    shared = region if len(ordered) > 1 else None
    return [
        Area(name=name, kind=kind, region=shared, outline=outline, waypoints=())
        for name, outline in zip(names, ordered, strict=True)
    ]


def _middle(outline: Polygon) -> tuple[float, float]:
    xs, ys = [p[0] for p in outline], [p[1] for p in outline]
    return (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2


def _plural(word: str) -> str:
    for end, ends in (("lf", "lves"), ("fe", "ves"), ("s", "s"), ("ing", "ing")):
        if word.endswith(end):
            return word.removesuffix(end) + ends
    return f"{word}s"


# --- a bare map ---------------------------------------------------------------------------------------------------


def areas_of_obstacles(occupancy: OccupancyMap, space: Space) -> tuple[Area, ...]:
    """Return the largest obstacles that stand free on the main floor as areas "Obstacle 1", ..., long ones in parts.

    Occupied cells less than a person's passage apart are one obstacle; walls are not labelled.
    """
    from scipy.ndimage import find_objects, label, maximum_filter1d

    size = occupancy.resolution
    occupied = occupancy.cells == 100
    floor = main_floor(space)
    if not floor.any() or not occupied.any():
        return ()
    reach = 2 * max(1, round(0.75 * GAP_M / 2 / size)) + 1  # a square of this reach is about a disc of GAP_M / 2
    grown = maximum_filter1d(maximum_filter1d(occupied, reach, axis=0), reach, axis=1)
    labels, _ = label(grown, np.ones((3, 3)))
    rectangles: list[tuple[float, Rectangle]] = []
    for number, window in enumerate(find_objects(labels), start=1):
        mine = occupied[window] & (labels[window] == number)
        r, c = np.nonzero(mine)
        wide, high = (np.ptp(c) + 1) * size, (np.ptp(r) + 1) * size
        inside = floor[window][r.min() : r.max() + 1, c.min() : c.max() + 1]
        around = float(inside.mean()) > ENCLOSED_FLOOR  # the walls of a room hold its floor
        walls = around or (min(wide, high) < 0.35 and max(wide, high) > 1.5)
        if walls or max(wide, high) < SMALLEST_THING_M or not _stands_on(floor, window):
            continue
        x = space.frame.origin.x + (window[1].start + c.min()) * size
        y = space.frame.origin.y + (window[0].start + r.min()) * size
        rectangles.append((wide * high, (round(x, 2), round(y, 2), round(x + wide, 2), round(y + high, 2))))
    largest: list[Rectangle] = []
    for _, (x0, y0, x1, y1) in sorted(rectangles, reverse=True):
        holding = (
            o for o in largest if x0 >= o[0] - 0.1 and y0 >= o[1] - 0.1 and x1 <= o[2] + 0.1 and y1 <= o[3] + 0.1
        )
        if len(largest) < MOST_OBSTACLES and next(holding, None) is None:
            largest.append((x0, y0, x1, y1))
    parts = [part for rectangle in largest for part in _parts(rectangle, LONGEST_M, PART_M)]
    return tuple(_numbered("Obstacle", "obstacle", [rectangle_outline(part) for part in parts], region=None))


def _stands_on(floor: Bools, window: tuple[slice, slice]) -> bool:
    """Return whether floor lies on at least three sides of a window of cells."""
    rows, columns = window
    reach = 12
    low, high = max(rows.start - reach, 0), rows.stop + reach
    left, right = max(columns.start - reach, 0), columns.stop + reach
    sides = (
        floor[low : rows.start, columns],
        floor[rows.stop : high, columns],
        floor[rows, left : columns.start],
        floor[rows, columns.stop : right],
    )
    return sum(bool(side.any()) for side in sides) >= 3


def areas_of_floor(space: Space) -> tuple[Area, ...]:
    """Open floor as rectangles, the largest first found: long narrow ones "Corridor 1", others "Area 1", ..."""
    floor = main_floor(space).copy()
    # Cells of at least 0.2 m, free only where all of them are, and few enough to search
    step = max(1, round(0.2 / space.frame.resolution), math.ceil(max(floor.shape) / SEARCH_CELLS))
    cells, frame = coarser(floor, space.frame, step, np.all)
    longest = max(FLOOR_SIDE_M, 0.3 * max(cells.shape) * frame.resolution)
    side = FLOOR_NARROWEST_M / frame.resolution
    corridors: list[Polygon] = []
    places: list[Polygon] = []
    while len(corridors) + len(places) < MOST_FLOOR_AREAS:
        top, left, high, wide = largest_rectangle(cells, side)
        if high * wide * frame.resolution**2 < FLOOR_LEAST_M2:
            break
        cells[top : top + high, left : left + wide] = False
        corners = frame.to_metres(np.array([[left, top], [left + wide, top + high]], float)).round(2)
        (x0, y0), (x1, y1) = corners.tolist()
        narrow, long = sorted((x1 - x0, y1 - y0))
        if narrow <= CORRIDOR_WIDTH_M and long >= 3 * narrow:
            corridors += [rectangle_outline(p) for p in _parts((x0, y0, x1, y1), 15.0, 10.0)]
        else:
            places += [rectangle_outline(p) for p in _parts((x0, y0, x1, y1), longest, longest * 0.75)]
    proposed = _numbered("Corridor", "corridor", corridors[:MOST_FLOOR_AREAS], region=None)
    return (*proposed, *_numbered("Area", "floor", places[: MOST_FLOOR_AREAS + 4], region=None))


def largest_rectangle(cells: Bools, least_side: float = 1.0) -> tuple[int, int, int, int]:
    """Return the largest rectangle of true cells without a shorter side: row, column, height and width; or zeros."""
    best = (0, 0, 0, 0)
    best_size = 0
    heights = np.zeros(cells.shape[1] + 1, int)
    for row in range(cells.shape[0]):
        heights[:-1] = np.where(cells[row], heights[:-1] + 1, 0)
        stack: list[tuple[int, int]] = []
        for column, height in enumerate(heights.tolist()):
            start = column
            while stack and stack[-1][1] >= height:
                start, tall = stack.pop()
                wide = column - start
                if tall * wide > best_size and min(tall, wide) >= least_side:
                    best, best_size = (row - tall + 1, start, tall, wide), tall * wide
            stack.append((start, height))
    return best


ALIKE = 0.85
"""So similar (difflib's ratio) to a known name is what was meant to be it."""
_CAPITALISED = re.compile(r"\b[A-ZÀ-ÖØ-Þ][\w'-]*(?:\s+[A-ZÀ-ÖØ-Þ][\w'-]*)*(?:\s+\d+)?\b")
_ARROW = re.compile(r"→|->")


def unknown_areas(text: str, known: Sequence[str]) -> list[str]:
    """Return the names in a text that look like those of areas and are none of the known ones, in no order.

    They stand at an end of an arrow, are of a known kind with another number (`Shelf 9` beside `Shelf 1`), or are
    capitalised and alike (`Wast Area`).
    """
    if _ARROW.search(text):
        sides = [side.strip(" .,;") for side in _ARROW.split(text)]
        return [side for side in dict.fromkeys(sides) if side and not any(_same(side, name) for name in known)]
    rest, unknown = text, []
    for name in sorted(known, key=len, reverse=True):
        rest = re.sub(_pattern(name), "\0", rest, flags=re.IGNORECASE)
    kinds = {match[1] for name in known if (match := re.fullmatch(r"(.*\S)\s*\d+", name))}
    for kind in sorted(kinds, key=len, reverse=True):
        numbered = re.compile(_pattern(kind).removesuffix(_END) + r"\s*\d+\b", re.IGNORECASE)
        unknown += numbered.findall(rest)
        rest = numbered.sub("\0", rest)
    folded = [name.casefold() for name in known]
    for phrase in _CAPITALISED.findall(rest):
        one_of = re.sub(r"s(\s+\d+)$", r"\1", phrase.casefold())  # "Areas 3 and 4" begins with a known name
        if one_of not in folded and difflib.get_close_matches(phrase.casefold(), folded, n=1, cutoff=ALIKE):
            unknown.append(phrase)
    return list(dict.fromkeys(unknown))


_END = r"(?!\w)"


def _pattern(name: str) -> str:
    """Return a name as a whole word, however its words are spaced."""
    return r"(?<!\w)" + r"\s+".join(re.escape(word) for word in name.split()) + _END


def _same(text: str, name: str) -> bool:
    return text.casefold().split() == name.casefold().split()
