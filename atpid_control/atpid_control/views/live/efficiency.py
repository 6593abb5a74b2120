# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The share by which the beam's amplitude lies below a reference: the damper closed, or none at all."""

import math

from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import efficiency


class ShareSoFar:
    """The share at the latest steady estimate, and the mean of all so far."""

    def __init__(self, scene: Scene, *, grain: bool) -> None:
        """Take the scene, and whether the reference is its structure with the grain held, or without the damper."""
        self._scene, self._grain = scene, grain
        self.restart()

    def restart(self) -> None:
        """Begin again: another run."""
        self.now = self.reference = math.nan  # share [-], and steady amplitude of the reference [m]
        self._sum, self._count = 0.0, 0

    @property
    def mean(self) -> float:
        """Mean over the steady estimates so far [-]; NaN: none yet."""
        return self._sum / self._count if self._count else math.nan

    def add(self, amplitude: float, frequency: float, beam: float) -> None:
        """Take a steady estimate: of the support [m, Hz], `beam` its amplitude [m]; NaN: not known, nor the share."""
        self.reference = self._scene.linear_amplitude(amplitude, frequency, grain=self._grain)
        self.now = efficiency(beam, self.reference)
        if math.isfinite(self.now):
            self._sum, self._count = self._sum + self.now, self._count + 1


def shares_of(scene: Scene | None) -> dict[str, ShareSoFar]:
    """Return efficiency, against the closed damper, and reduction, against the structure without it; none of None."""
    if scene is None:
        return {}
    return {"efficiency": ShareSoFar(scene, grain=True), "reduction": ShareSoFar(scene, grain=False)}
