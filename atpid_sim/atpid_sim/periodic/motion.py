# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A steady motion, how a search for one ends, and by which way it was found."""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_sim.results import Labelled, in_unit
from atpid_sim.system import Array

#: Least multiplier of which a logarithm is taken.
_LEAST = 1e-12


class SteadyEnding(Enum):
    """How a search for a steady motion ended."""

    FOUND = "the steady motion was found, and one more period verified it"
    CHANGING = "excitation or ceiling change until the end: there is no steady motion"
    IRREGULAR = "the motion does not come to repeat itself, after up to 8 periods of the support: run it as it is"
    BY_CHANCE = "runs that differ slightly end in different motions: run the scene as it is"


class Method(Enum):
    """How a steady motion was found."""

    SHORT = "the transient followed with tabulated contacts until it contracted, the rest solved for"
    LONG = "the transient run at this fidelity until it drew together, the rest solved for"
    WAITED = "run at this fidelity until it repeated itself"


@dataclass(frozen=True, repr=False)
class SteadyState(Labelled):
    """A stable periodic motion that a scene ends in."""

    amplitude: float  # half peak-to-peak of the beam [m]
    error_estimate: float  # relative, of the amplitude: what is left of the way, tolerance, and model error
    periods: int  # of the drive after which it repeats itself
    multipliers: NDArray[np.complex128]  # (n,), the largest modulus first; of a grain that never flies two are 0
    followed: float  # how much was run, beyond the scene's end where it took that [s]
    section: Array  # (n,), see `periodic.return_map`
    phase: float  # of the section, as a share of a period
    impacts: NDArray[Any]  # (k,) with the columns of `results.IMPACT`, times after the section
    fidelity: str
    method: Method = Method.SHORT

    labels = (
        in_unit("m", "amplitude") | in_unit("s", "followed") | in_unit("1", "multipliers", "multiplier")
        | in_unit("", "section", "place") | in_unit("", "impacts", "impact")
        | in_unit("1", "stability_margin settling_periods")
    )  # fmt: skip

    @property
    def stability_margin(self) -> float:
        """Distance to instability, 1 - largest modulus of the multipliers [-]."""
        return 1.0 - float(abs(self.multipliers[0]))

    @property
    def settling_periods(self) -> float:
        """Periods of the drive in which a small disturbance falls to 1/e in the end."""
        return -self.periods / math.log(max(float(abs(self.multipliers[0])), _LEAST))


@dataclass(frozen=True, repr=False)
class SteadySearch(Labelled):
    """How a search ended, and the steady motion where one was found."""

    ending: SteadyEnding
    state: SteadyState | None = None
