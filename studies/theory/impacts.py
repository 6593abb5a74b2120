# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Motion types from the sequence of impacts (thesis sections 3.5.1 to 3.5.3).

The rule. Impacts on one wall that follow each other within a quarter of a period are one *visit*. The grain *sticks* to
a wall where at least half of the visits there have more than one impact: it bounces once or more, ever lower, and is
then pushed. Then, over the whole periods of a window:

- `no_ceiling`: the ceiling is never reached;
- `irregular`: in some period there is not exactly one visit to each wall;
- `sticking`, `mixed`, `optimal`: one visit to each wall in every period, sticking to both, one or none of them.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from atpid_sim.system import Array

FLOOR, CEILING = 1.0, -1.0

#: Impacts on one wall closer than this share of a period are one visit [-].
_VISIT = 0.25


class Visit(NamedTuple):
    """Impacts on one wall in quick succession."""

    begin: float  # the first impact [s]
    wall: float  # +1 floor, -1 ceiling
    impacts: int


def visits(impacts: Array, period: float) -> list[Visit]:
    """Return the visits of an impact log (k, 3): time [s], wall (+1 floor, -1 ceiling), closing speed [m/s]."""
    return list(_grouped(impacts, _VISIT * period))


def _grouped(impacts: Array, longest: float) -> Iterator[Visit]:
    present: Visit | None = None
    last = -np.inf
    for time, wall, _ in impacts:
        if present is not None and wall == present.wall and time - last <= longest:
            present = present._replace(impacts=present.impacts + 1)
        else:
            if present is not None:
                yield present
            present = Visit(float(time), float(wall), 1)
        last = time
    if present is not None:
        yield present


def sticks(found: list[Visit], wall: float) -> bool:
    """Return whether the grain sticks to a wall: at least half of its visits there have more than one impact."""
    there = [visit.impacts > 1 for visit in found if visit.wall == wall]
    return bool(there) and sum(there) >= 0.5 * len(there)


def motion_type(impacts: Array, begin: float, end: float, period: float) -> str:
    """Return the motion type in a window from `begin` to `end` [s] by the rule of this module; `period` [s].

    impacts: log (k, 3) as in `visits`, with at least a period before the window.
    """
    found = [visit for visit in visits(impacts, period) if begin <= visit.begin < end]
    floors, ceilings = (np.array([v.begin for v in found if v.wall == wall]) for wall in (FLOOR, CEILING))
    if not len(ceilings):
        return "no_ceiling"
    if not (_once_a_period(floors, begin, end, period) and _once_a_period(ceilings, begin, end, period)):
        return "irregular"
    return ("optimal", "mixed", "sticking")[sticks(found, FLOOR) + sticks(found, CEILING)]


def _once_a_period(times: Array, begin: float, end: float, period: float) -> bool:
    """Whether times (k,) [s] follow each other after a period, to a quarter of it, through the whole window."""
    padded = np.concatenate([[begin], times, [end]])
    gaps = np.diff(padded)
    inner = gaps[1:-1]
    return bool(np.all(np.abs(inner - period) < 0.25 * period) and max(gaps[0], gaps[-1]) < 1.25 * period)
