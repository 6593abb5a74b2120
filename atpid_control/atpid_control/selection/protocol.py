# SPDX-License-Identifier: Apache-2.0
"""The role of a height selector: from an excitation to the best ceiling height."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from atpid_common.errors import InputError


class SelectionError(InputError):
    """No height can be selected for this excitation; the ceiling should stay where it is."""


@dataclass(frozen=True)
class Stage:
    """One step of a selection."""

    name: str  # as the thesis calls it: SM, PM1, CM1, ..., tuning 1, ...
    height: float  # [m], NaN: none yet
    amplitude: float  # of the beam there [m], NaN: not computed
    note: str  # the result of the step


@dataclass(frozen=True)
class Selection:
    """A height, and what is expected there."""

    height: float  # [m]
    beam_amplitude: float  # half peak-to-peak expected there [m], NaN: unknown
    efficiency: float  # 1 - amplitude / amplitude of the closed damper [-], NaN: unknown
    method: str
    evaluations: int = 0  # simulations it took
    wall_s: float = 0.0  # [s]
    price: float = 0.0  # efficiency given up for the margin [-], NaN: unknown
    stages: tuple[Stage, ...] = ()  # every iteration, where the method has any


class HeightSelector(Protocol):
    """One method of selection."""

    @property
    def method(self) -> str:
        """Name in the registry, or of the entry point."""
        ...

    @property
    def simulates(self) -> bool:
        """Whether a selection is computed by simulation, which takes longer than the loop can wait."""
        ...

    def select(
        self,
        amplitude: float,
        amplitude_std: float = 0.0,
        frequency: float = math.nan,
        *,
        margin: float = 0.0,
        height: float = math.nan,
    ) -> Selection:
        """Return the best height for an excitation.

        amplitude, amplitude_std: of the support [m]; frequency [Hz], NaN: resonance of the closed damper;
        margin: standard deviations of the amplitude the height must be safe for [-]; height: where the ceiling is [m],
        NaN: unknown. Raises SelectionError, in one line, where no height can be given.
        """
        ...
