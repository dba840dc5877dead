"""People of other sizes: children, wheelchairs, and trolleys that a person pushes."""

from __future__ import annotations

from enum import Enum
from typing import Annotated, NamedTuple

from pydantic import Field

from rvsg.core.records import Record

Outline = tuple[tuple[float, float], ...]

TROLLEY_GAP_M = 0.1
"""Between the body of a person and the trolley in front: the handle."""
TROLLEY_SPEEDS_M_S = (0.3, 1.5)
TROLLEY_LENGTHS_M, TROLLEY_WIDTHS_M = (0.3, 2.4), (0.3, 1.2)
WHEELCHAIR: Outline = ((-0.45, -0.33), (0.65, -0.33), (0.65, 0.33), (-0.45, 0.33))
"""1.1 x 0.66 m with the feet of who sits in it: ISO 7176-5 allows up to 1.3 x 0.7 m."""


class PersonKind(str, Enum):
    """Who a person is."""

    ADULT = "adult"
    CHILD = "child"
    WHEELCHAIR = "wheelchair"


class Trolley(Record):
    """What a person pushes: a trolley, a cart or a bed, as a rectangle ahead of the person. Metres."""

    length_m: Annotated[float, Field(ge=TROLLEY_LENGTHS_M[0], le=TROLLEY_LENGTHS_M[1])] = 0.9
    width_m: Annotated[float, Field(ge=TROLLEY_WIDTHS_M[0], le=TROLLEY_WIDTHS_M[1])] = 0.55


class Limits(NamedTuple):
    """Smallest and largest radius (m) and speed (m/s) of a kind of person, and what is taken where nothing is said."""

    radii_m: tuple[float, float]
    speeds_m_s: tuple[float, float]
    radius_m: float
    speed_m_s: float


LIMITS = {
    PersonKind.CHILD: Limits((0.15, 0.35), (0.3, 2.0), 0.25, 1.1),
    PersonKind.WHEELCHAIR: Limits((0.25, 0.4), (0.3, 1.7), 0.33, 0.9),
}
"""Of everybody but adults, who keep to the general limits."""


def outline_of(kind: PersonKind, trolley: Trolley | None, radius_m: float) -> Outline:
    """Return the corners of what a person sits in or pushes, in the person's frame (x ahead); empty for the body alone.

    The body itself is a disc of `radius_m` at the origin.
    """
    if kind is PersonKind.WHEELCHAIR:
        return WHEELCHAIR
    if trolley is None:
        return ()
    near, half = radius_m + TROLLEY_GAP_M, trolley.width_m / 2
    far = near + trolley.length_m
    return tuple((round(x, 4), round(y, 4)) for x, y in ((near, -half), (far, -half), (far, half), (near, half)))
