"""Contacts, arrivals and clearance over repeated runs: reported beside every requirement, whatever it measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rvsg.core.records import Record

MEASURED = ("contacts", "contact_longest", "contact_speed", "min_distance", "completed")
"""The metrics from which the summary is made."""


class Contacts(Record):
    """Runs in which the robot touches a person."""

    runs: int
    """Number of runs with contact."""
    of: int
    """Number of runs in which people were measured."""
    longest_s: float | None
    """Duration of the longest contact; None if there is none."""
    worst_speed_m_s: float | None
    """Largest relative speed in contact; None if there is none."""
    which: tuple[int, ...] = ()
    """Indices of the runs with contact, in the order given."""


class Arrivals(Record):
    """Runs in which the robot reaches its goal in time."""

    runs: int
    of: int
    missed: tuple[int, ...] = ()
    """Indices of the runs that did not arrive."""


class SafetySummary(Record):
    """What is always reported beside a requirement."""

    contacts: Contacts
    arrived: Arrivals
    least_clearance_m: float | None
    """Smallest gap between the bodies of robot and a person over all runs; negative where they overlap."""
    closest_run: int | None = None
    """Index of the run with the smallest gap."""


def summarise_safety(measured: Sequence[Mapping[str, float | None]]) -> SafetySummary:
    """Sum up the metrics of repeated runs.

    Args:
        measured: The metrics of each run by id; at least `MEASURED`, as `measure` returns them.
    """
    touched = [k for k, values in enumerate(measured) if (values.get("contacts") or 0.0) > 0.0]
    arrived = [values["completed"] for values in measured if values.get("completed") is not None]
    gaps = {k: gap for k, values in enumerate(measured) if (gap := values.get("min_distance")) is not None}
    closest = min(gaps, key=lambda k: gaps[k], default=None)
    return SafetySummary(
        contacts=Contacts(
            runs=len(touched),
            of=sum(values.get("contacts") is not None for values in measured),
            longest_s=_largest(measured, touched, "contact_longest"),
            worst_speed_m_s=_largest(measured, touched, "contact_speed"),
            which=tuple(touched),
        ),
        arrived=Arrivals(
            runs=sum(value == 1.0 for value in arrived),
            of=len(arrived),
            missed=tuple(k for k, values in enumerate(measured) if values.get("completed") == 0.0),
        ),
        least_clearance_m=gaps[closest] if closest is not None else None,
        closest_run=closest,
    )


def _largest(measured: Sequence[Mapping[str, float | None]], rows: Sequence[int], name: str) -> float | None:
    known = [value for k in rows if (value := measured[k].get(name)) is not None]
    return max(known, default=None)
