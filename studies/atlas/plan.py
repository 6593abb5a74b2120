# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The points of the atlas: columns of heights over amplitude and mass fraction, and over amplitude and frequency."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Place(NamedTuple):
    """Where a column of heights stands."""

    mass_fraction: float  # [-]
    amplitude: float  # of the support [m]
    frequency_ratio: float  # frequency over resonance [-]


#: Names of the blocks.
MASS, FREQUENCY = "mass", "frequency"


@dataclass(frozen=True)
class Plan:
    """Two blocks of columns with the same heights, as shares of the ballistic clearance at resonance (Eq. 4.30)."""

    mass_fractions: tuple[float, ...]  # of the block over the mass, at resonance
    amplitudes: tuple[float, ...]  # its amplitudes [m]
    slices: tuple[float, ...]  # amplitudes of the block over the frequency [m]
    frequency_ratios: tuple[float, ...]
    shares: tuple[float, ...]  # clearance over ballistic clearance, rising
    slice_fraction: float = 0.1  # mass fraction of the block over the frequency

    def block(self, name: str) -> list[list[Place]]:
        """Return the columns of a block by rows: of one mass fraction, or of one amplitude."""
        if name == MASS:
            return [[Place(fraction, a, 1.0) for a in self.amplitudes] for fraction in self.mass_fractions]
        return [[Place(self.slice_fraction, a, ratio) for ratio in self.frequency_ratios] for a in self.slices]

    @property
    def places(self) -> list[Place]:
        """All columns, each once."""
        return list(dict.fromkeys(place for name in (MASS, FREQUENCY) for row in self.block(name) for place in row))


def plan_of(lowest: float, highest: float, quick: bool = False) -> Plan:
    """Return the plan for support amplitudes from `lowest` to `highest` [m]; `quick`: a coarse one."""
    amplitudes, ratios, clearances = (5, 3, 14) if quick else (61, 61, 96)
    quarters = lowest * (highest / lowest) ** np.array([0.25, 0.5, 0.75])
    return Plan(
        mass_fractions=(0.1, 0.3) if quick else (0.05, 0.1, 0.2, 0.3),
        amplitudes=_rounded(np.geomspace(lowest, highest, amplitudes)),
        slices=_rounded(quarters[1:2] if quick else quarters),
        frequency_ratios=_rounded(np.linspace(0.85, 1.15, ratios)),
        shares=_rounded(np.linspace(1.05 / clearances, 1.05, clearances)),
    )


def _rounded(values: np.ndarray) -> tuple[float, ...]:
    """Return values to 1e-9, so that the same plan finds its columns in the journal."""
    return tuple(float(value) for value in np.round(values, 9))
