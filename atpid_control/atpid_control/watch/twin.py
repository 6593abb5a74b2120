# SPDX-License-Identifier: Apache-2.0
"""The running twin: what the beam should do now, simulated for the present excitation and height."""

from __future__ import annotations

import math

from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulate import simulate

#: Periods simulated and, of these, looked at.
PERIODS, LOOKED_AT = 80, 16
#: The last answer holds until amplitude, frequency or height has moved by more than this share [-].
SAME = 0.003


class SteadyTwin:
    """Simulates the steady state of a scene's beam and damper, again only when something has changed."""

    def __init__(self, scene: Scene) -> None:
        """Take the beam, damper and contact from `scene`."""
        self._scene = scene
        self._asked = (math.nan, math.nan, math.nan)
        self._answer = math.nan
        # warm-up call: the kernels are loaded, or compiled, before the first settled period
        self._simulated(scene.grain.radius, scene.frequency_hz, 4.0 * scene.grain.radius)

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        """Return the beam's steady half peak-to-peak [m]; NaN where the motion is irregular or cannot be simulated.

        `amplitude` [m] and `frequency` [Hz] of the excitation, `height` [m] of the ceiling. A new answer takes about
        10 ms.
        """
        asked = (amplitude, frequency, height)
        if not all(abs(new - old) <= SAME * abs(old) for new, old in zip(asked, self._asked, strict=True)):
            self._asked, self._answer = asked, self._simulated(*asked)
        return self._answer

    def _simulated(self, amplitude: float, frequency: float, height: float) -> float:
        if not all(map(math.isfinite, (amplitude, frequency, height))) or amplitude <= 0.0 or frequency <= 0.0:
            return math.nan
        duration = PERIODS / frequency
        scene = self._scene.with_(
            height=max(height, 2.0 * self._scene.grain.radius), amplitude=amplitude, frequency=frequency,
            duration=duration, steady_window=(duration - LOOKED_AT / frequency, duration),
        )  # fmt: skip
        try:
            result = simulate(scene, check=False)
        except NumericalFailure:
            return math.nan
        return math.nan if result.motion == "irregular" else result.amplitude
