# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Newton's steps to the fixed point near which a transient draws together."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic.approach import Approach
from atpid_sim.system import Array

#: How far steps may lead, in the distances that are left to go at the rate of contraction.
_FARTHEST = 5.0
#: Passages from which the end is extrapolated, and relative size of a part of their moves that depends on the others.
_MIXED, _DEPENDENT = 5, 1e-6


class Newton:
    """Newton's steps to a fixed point near where a transient draws together, from a section state (n,)."""

    def __init__(self, approach: Approach, known: float, section: Array) -> None:
        """Begin; known: relative error that steps do not remove."""
        self.section, self.left, self.slope = section, math.inf, np.eye(len(section))
        self.improved = False  # whether steps had to improve the derivative
        self._inverse: NDArray[np.floating[Any]] = self.slope
        self._last, self._scale, self._known = approach.passages[-1], approach.scale, known
        self._farthest = _FARTHEST * approach.remaining + known
        self._before: tuple[Array, Array] | None = None  # last section state and what is missing to its image

    def derive(self, slope: Array) -> None:
        """Take another derivative of the return map (n, n)."""
        self.slope, self._inverse, self._before = slope, np.linalg.inv(np.eye(len(slope)) - slope), None

    def step(self, after: Array, alike: bool = False) -> None:
        """Step from the section state (n,) to which `after` is the next passage; raises NumericalFailure if too far.

        alike: whether the last step was by the same map, so that it improves the derivative.
        """
        missing = after - self.section
        step = np.asarray(self._inverse @ missing, dtype=float)
        if alike and self._before is not None and size(step, self._scale) > self._known:
            self._improve(self.section - self._before[0], self._before[1] - missing)
            step = np.asarray(self._inverse @ missing, dtype=float)
        self._before = self.section, missing
        self.left, self.section = size(step, self._scale), self.section + step
        if not size(self.section - self._last, self._scale) <= self._farthest:
            raise NumericalFailure("no fixed point near the transient")

    def derive_again(self, slope: Array, after: Array) -> None:
        """Make the last step, from a section state to which `after` is the next passage, with another derivative."""
        if self._before is not None:
            self.section = self._before[0]
        self.derive(slope)
        self.step(after)

    @property
    def leading(self) -> float:
        """Largest modulus of the derivative's eigenvalues: the factor by which disturbances shrink in the end."""
        return float(np.abs(np.linalg.eigvals(self.slope)).max())

    def _improve(self, moved: Array, closed: Array) -> None:
        """Broyden's update: a move (n,) has closed so much (n,) of what was missing."""
        row = (moved / self._scale**2) @ self._inverse
        share, self.improved = float(row @ closed), True
        if share != 0.0:
            self._inverse = self._inverse + np.outer(moved - self._inverse @ closed, row) / share


def size(step: Array, scale: Array) -> float:
    """Return the largest part of a step (n,), relative to the motion's size."""
    return float(max(map(abs, (step / scale).tolist())))


def extrapolated(passages: Array, scale: Array) -> Array:
    """Return the section state (n,) to which passages (k, n) of a linear map would draw together: Anderson's mixing."""
    recent = passages[-_MIXED:] / scale
    moves = recent[1:] - recent[:-1]
    weights = np.linalg.lstsq((moves[1:] - moves[:-1]).T, moves[-1], rcond=_DEPENDENT)[0]
    end: Array = (recent[-1] - weights @ moves[1:]) * scale
    return end
