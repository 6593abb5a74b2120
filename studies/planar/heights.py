# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What friction on the side wall takes at the height that is best without it, and at the one that is best with it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from atpid_sim.system import Array
from studies.planar.measure import BANDS, System
from studies.planar.motion import Planar, seen

#: Friction coefficients [-].
_FRICTION = 0.1, 0.5
#: Clearances tried, over that of the system; an irregular motion counts so many times as large; steps a period.
_CLEARANCES, _IRREGULAR, _STEPS = np.linspace(0.5, 1.5, 26), 1.15, 1000


class Best(NamedTuple):
    """The best heights of a system without and with friction; amplitudes over that of the closed damper."""

    ratio: float  # of the friction over its limit [-]
    same: float  # amplitude added by friction at the height that is best without it [-]
    own: float  # and at the one that is best with it [-]
    clearance: float  # of the latter over that of the former [-]


def best(system: System, seed: Sequence[int]) -> Best:
    """Return the best heights of a system with a friction coefficient drawn by the seed."""
    friction = float(np.exp(np.random.default_rng(seed).uniform(*np.log(_FRICTION))))
    smooth = _amplitudes(system, system.planar)
    rough = _amplitudes(system, system.planar._replace(friction=friction, side_gravity=system.side_gravity))
    first, second = int(np.argmin(smooth)), int(np.argmin(rough))
    return Best(
        system.friction_ratio(friction), float(rough[first] - smooth[first]), float(rough[second] - smooth[first]),
        float(_CLEARANCES[second] / _CLEARANCES[first]),
    )  # fmt: skip


def _amplitudes(system: System, p: Planar) -> Array:
    found = [seen(p._replace(clearance=p.clearance * float(c)), system.settle, _STEPS) for c in _CLEARANCES]
    return np.array([one.amplitude * (1.0 if one.regular else _IRREGULAR) for one in found]) / system.closed


def table(found: Sequence[Best]) -> str:
    """Return the table, as Markdown."""
    lines = [
        "| friction over its limit | systems | lost at the height best without it: median, 95 % [points] | lost at the "
        "height best with it | its clearance over the other's |",
        "|---|---|---|---|---|",
    ]
    least = 0.0
    for most, name in BANDS:
        band = np.array([one[1:] for one in found if least <= one.ratio < most]).reshape(-1, 3)
        cells = ["-"] * 3
        if len(band):
            (same, own, clearance), (most_same, most_own, _) = np.quantile(band, (0.5, 0.95), axis=0)
            cells = [f"{100 * same:.1f}, {100 * most_same:.1f}", f"{100 * own:.1f}, {100 * most_own:.1f}"]
            cells.append(f"{clearance:.2f}")
        lines.append(f"| {name} | {len(band)} | {' | '.join(cells)} |")
        least = most
    return "\n".join(lines)
