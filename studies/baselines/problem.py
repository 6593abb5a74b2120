# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Problem and solution of a baseline."""

import math
from dataclasses import dataclass, replace

import numpy as np

from atpid_common.errors import InputError
from atpid_sim.contact.laws import HYSTERETIC, IMPACT
from atpid_sim.engine import columns, drive
from atpid_sim.kernel_inputs import Contact, contact_of, system_of
from atpid_sim.scene import Scene
from atpid_sim.simulation.excitation import support_rows
from atpid_sim.system import Array, System
from studies.baselines.rhs import BEAM, GRAIN, pack

#: Points a period at which a motion is kept in the window; see `peaks.between` for the error.
POINTS = 64


class BaselineError(InputError):
    """A scene a baseline cannot run."""


@dataclass
class Problem:
    """A scene as arrays; the rows end where the drive has a kink and where the window begins and ends."""

    rows: Array
    system: System
    contact: Contact
    window: tuple[float, float]
    start: Array
    period: float

    def packed(self, row: Array) -> Array:
        """Return the constants of the right-hand side in this row, (24,)."""
        return pack(row, self.system, self.contact)

    def instants(self, row: Array) -> Array:
        """Return the local times (n,) [s] at which a row in the window is sampled; none outside."""
        length = row[columns.END] - row[columns.START]
        return np.linspace(0.0, length, max(2, math.ceil(POINTS * length / self.period)) if self.inside(row) else 0)

    def inside(self, row: Array) -> bool:
        """Whether a row lies in the window."""
        middle = 0.5 * (row[columns.START] + row[columns.END])
        return bool(self.window[0] <= middle <= self.window[1])


@dataclass
class Solution:
    """Solution of a problem in its window."""

    points: list[Array]  # each (n, 5): time, x, v, a, grain
    final: Array
    steps: int = 0
    evaluations: int = 0
    message: str = ""
    escaped: bool = False

    def check_grain(self, problem: Problem, row: Array, tau: float, y: Array) -> None:
        """Check that the grain is between the walls at local time tau [s]."""
        centre = y[GRAIN] - y[BEAM] + problem.system.radius
        self.escaped |= bool(centre < 0.0 or centre > row[columns.HEIGHT] + row[columns.CEILING_VELOCITY] * tau)

    def keep(self, problem: Problem, row: Array, points: Array, inside: bool) -> None:
        """Keep points (n, 5) of a row that lies in the window; check the grain in all."""
        height = row[columns.HEIGHT] + row[columns.CEILING_VELOCITY] * (points[:, 0] - row[columns.START])
        centre = points[:, 4] - points[:, 1] + problem.system.radius
        self.escaped |= bool(np.any((centre < 0.0) | (centre > height)))
        if inside:
            self.points.append(points)


def problem_of(scene: Scene) -> Problem:
    """Return the scene as a problem. Raises BaselineError for a force of more than overlap and velocity."""
    contact = contact_of(scene)
    if contact.law == IMPACT or HYSTERETIC[contact.law]:
        raise BaselineError(f"contact.law: given {scene.contact.law!r}; allowed: a law whose force needs no memory")
    rows = drive.with_ceiling(support_rows(scene), scene.ceiling.heights)
    window = scene.steady_window
    rows = drive.cut(rows, [t for t in window if 0.0 < t < rows[-1, columns.END]])
    start = np.zeros(6)
    start[[BEAM, GRAIN]] = scene.excitation.deflection - scene.static_deflection
    fastest = max(2.0 * math.pi * scene.natural_frequency_hz, float(rows[:, columns.OMEGA].max()))
    return Problem(rows, system_of(scene), contact, window, start, 2.0 * math.pi / fastest)


def shortened(problem: Problem) -> Problem:
    """Return the first thousandth of a period of a problem, to compile a method with."""
    rows = problem.rows[:1].copy()
    rows[0, columns.END] = rows[0, columns.START] + 1e-3 * problem.period
    window = rows[0, columns.START], rows[0, columns.END]
    return replace(problem, rows=rows, window=window)
