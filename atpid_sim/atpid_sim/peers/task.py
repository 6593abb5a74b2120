# SPDX-License-Identifier: Apache-2.0
"""What a peer is given and what it leaves behind."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_common.errors import InputError
from atpid_sim.contact import Contact, contact_of
from atpid_sim.contact.ids import IMPACT, WALTON_BRAUN
from atpid_sim.engine import columns, drive
from atpid_sim.excitation import support_rows
from atpid_sim.peers.rhs import pack
from atpid_sim.scene import FreeExcitation, Scene
from atpid_sim.system import System, system_of

Array = NDArray[np.float64]

#: Points a period at which a motion is kept in the window; see `peaks.between` for the error that leaves.
POINTS = 64


class PeerError(InputError):
    """A scene a peer cannot run."""


@dataclass
class Task:
    """A scene as arrays; the rows end where the drive has a kink and where the window begins and ends."""

    rows: Array
    system: System
    contact: Contact
    window: tuple[float, float]
    start: Array
    period: float

    def packed(self, row: Array) -> Array:
        """Return what the right-hand side needs in this row, (24,)."""
        return pack(row, self.system, self.contact)

    def instants(self, row: Array) -> Array:
        """Return the local times (n,) [s] at which a row in the window is looked at; none outside."""
        length = row[columns.END] - row[columns.START]
        return np.linspace(0.0, length, max(2, math.ceil(POINTS * length / self.period)) if self.inside(row) else 0)

    def inside(self, row: Array) -> bool:
        """Whether a row lies in the window."""
        middle = 0.5 * (row[columns.START] + row[columns.END])
        return bool(self.window[0] <= middle <= self.window[1])


@dataclass
class Track:
    """What a method leaves behind."""

    points: list[Array]  # each (n, 5): time, x, v, a, grain
    final: Array
    steps: int = 0
    evaluations: int = 0
    message: str = ""
    escaped: bool = False

    def watch(self, task: Task, row: Array, tau: float, y: Array) -> None:
        """See whether the grain is still between the walls at local time tau [s]."""
        centre = y[2] - y[0] + task.system.radius
        self.escaped |= bool(centre < 0.0 or centre > row[columns.HEIGHT] + row[columns.CEILING_VELOCITY] * tau)

    def keep(self, task: Task, row: Array, points: Array, inside: bool) -> None:
        """Keep points (n, 5) of a row that lies in the window; watch the grain in all."""
        height = row[columns.HEIGHT] + row[columns.CEILING_VELOCITY] * (points[:, 0] - row[columns.START])
        centre = points[:, 4] - points[:, 1] + task.system.radius
        self.escaped |= bool(np.any((centre < 0.0) | (centre > height)))
        if inside:
            self.points.append(points)


def task_of(scene: Scene) -> Task:
    """Return the scene as a task. Raises PeerError for a law whose force needs more than overlap and rate."""
    contact = contact_of(scene)
    if contact.law in (IMPACT, WALTON_BRAUN):
        raise PeerError(f"contact.law: given {scene.contact.law!r}; allowed: a law whose force needs no memory")
    rows = drive.with_ceiling(support_rows(scene), scene.ceiling.heights)
    window = scene.steady_window
    rows = drive.cut(rows, [t for t in window if 0.0 < t < rows[-1, columns.END]])
    start = np.zeros(6)
    released = scene.excitation.free.deflection if isinstance(scene.excitation, FreeExcitation) else 0.0
    start[[0, 2]] = released - scene.static_deflection
    fastest = max(2.0 * math.pi * scene.natural_frequency_hz, float(rows[:, columns.OMEGA].max()))
    return Task(rows, system_of(scene), contact, window, start, 2.0 * math.pi / fastest)


def brief(task: Task) -> Task:
    """Return the first thousandth of a period of a task, to compile a method with."""
    rows = task.rows[:1].copy()
    rows[0, columns.END] = rows[0, columns.START] + 1e-3 * task.period
    return Task(rows, task.system, task.contact, (rows[0, 0], rows[0, 1]), task.start, task.period)
