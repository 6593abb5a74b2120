# SPDX-License-Identifier: Apache-2.0
"""The efficiency so far: the beam's amplitude against that of the same beam with the damper closed."""

import math

from atpid_sim.scene import Scene
from atpid_sim.scene.plausibility import closed_amplitude
from atpid_sim.simulation.quantities import efficiency


class EfficiencySoFar:
    """The efficiency of each steady estimate and the mean of all so far."""

    def __init__(self, scene: Scene | None) -> None:
        """Take the scene, whose beam and grain the closed damper has; None: the efficiency is not known."""
        self._scene = scene
        self._sum, self._count = 0.0, 0

    @property
    def known(self) -> bool:
        """Whether there is a scene."""
        return self._scene is not None

    @property
    def mean(self) -> float:
        """Mean over the steady estimates so far [-]; NaN: none yet."""
        return self._sum / self._count if self._count else math.nan

    def add(self, amplitude: float, frequency: float, beam: float) -> float:
        """Return the efficiency [-] at a steady estimate: of the support [m, Hz], `beam` its amplitude [m]."""
        if self._scene is None or not all(map(math.isfinite, (amplitude, frequency, beam))):
            return math.nan
        closed = closed_amplitude(self._scene, amplitude, frequency)
        now = efficiency(beam, closed)
        if math.isnan(now):
            return math.nan
        self._sum, self._count = self._sum + now, self._count + 1
        return now

    def restart(self) -> None:
        """Begin again: another run."""
        self._sum, self._count = 0.0, 0
