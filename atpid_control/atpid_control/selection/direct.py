# SPDX-License-Identifier: Apache-2.0
"""Direct selection: the whole range of heights simulated, from the state the damper is in, in less than a period."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor

from atpid_control.selection.checks import check_excitation, response_at
from atpid_control.selection.margin import Uncertainty, robust_height
from atpid_control.selection.protocol import Selection, SelectionError
from atpid_sim.maps import FROM_CLOSED, Approach, Best, DamperResponse, Timing, best_height, travelled
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import cores

#: Tolerance of the runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-5

#: Speed of the ceiling where the scene gives none [m/s]: that of the thesis's bench in scenes/.
_SPEED = 0.3

#: A second travel starts this much later, in periods: what depends on the phase of the start is not reproducible.
_LATER = 0.37


class DirectSelector:
    """Computes the optimum on all cores; with a margin, the height that is best in the worst case."""

    method, simulates = "direct", True

    def __init__(self, scene: Scene, uncertainty: Uncertainty | None = None, workers: int | None = None) -> None:
        """Take the system of a scene, and the ceiling's range and speed where it is controlled."""
        self._scene, self._workers = scene, workers or cores()
        self._limits = getattr(scene.ceiling, "range", (2.0 * scene.grain.radius, math.inf))
        self._speed = float(getattr(scene.ceiling, "speed", _SPEED))
        self._uncertainty = uncertainty or Uncertainty()
        self._damper = DamperResponse(scene, _RTOL)
        # compiled now, or loaded from the cache, so that the first selection is as fast as the next
        self._damper.opened(1e-3, 4.0 * self._damper.diameter, Timing(1.0, 4.0))

    def select(
        self,
        amplitude: float,
        amplitude_std: float = 0.0,
        frequency: float = math.nan,
        *,
        margin: float = 0.0,
        height: float = math.nan,
    ) -> Selection:
        """Return the best height reached from `height` [m], or from closed; see `HeightSelector.select`."""
        check_excitation(amplitude, amplitude_std, frequency, margin)
        begun = time.perf_counter()
        damper = response_at(self._damper, self._scene, frequency, _RTOL)
        try:
            with ThreadPoolExecutor(self._workers) as pool:
                best = best_height(
                    damper, amplitude, limits=self._limits, approaches=self._approaches(damper, height), mapper=pool.map
                )
                if margin > 0.0:
                    return self._safe(damper, amplitude, margin * amplitude_std, best, pool, begun)
        except NumericalFailure as error:
            raise SelectionError(f"direct: {error}") from error
        wall = time.perf_counter() - begun
        return Selection(best.height, best.amplitude, best.efficiency, self.method, best.evaluations, wall)

    def _approaches(self, damper: DamperResponse, height: float) -> tuple[Approach, ...]:
        if not height > damper.diameter * (1.0 + 1e-6):
            return FROM_CLOSED
        return travelled(height, self._speed), travelled(height, self._speed, _LATER * damper.period)

    def _safe(
        self,
        damper: DamperResponse,
        amplitude: float,
        spread: float,
        best: Best,
        pool: ThreadPoolExecutor,
        begun: float,
    ) -> Selection:
        found = robust_height(self._scene, damper, amplitude, spread, best, self._uncertainty, self._limits, pool.map)
        efficiency = 1.0 - found.amplitude / damper.closed_amplitude(amplitude)
        return Selection(
            found.height, found.amplitude, efficiency, self.method, best.evaluations + found.evaluations,
            time.perf_counter() - begun, best.efficiency - efficiency,
        )  # fmt: skip
