# SPDX-License-Identifier: Apache-2.0
"""Direct selection: the whole range of heights simulated, from the state the damper is in, in less than a period."""

import math
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

from atpid_control.selection.checks import check_excitation, response_at
from atpid_control.selection.protocol import Selection, SelectionError
from atpid_sim.maps import FROM_CLOSED, Best, DamperResponse, Response, Timing, best_height, travelled
from atpid_sim.maps.best import FLAT, Mapper
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import cores

#: Shares of the bare optimum's clearance that are tried, batch by batch, until the best lies inside.
_BATCH, _STEP, _LEAST = 9, 0.025, 0.2
#: An irregular motion in any case counts as this many times as large: the margin is to avoid it.
_RUMBLE = 1.5
#: Tolerance of the runs for a margin, and for the bare optimum: 0.2 % of an amplitude is resolved.
_MARGIN_RTOL, _RTOL = 1e-4, 1e-5


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainties apart from that of the amplitude."""

    stiffness: float = 0.05  # relative, of the beam: the model's own uncertainty [-]
    resolution: float = 5e-4  # of the ceiling's position [m]


@dataclass(frozen=True)
class Robust:
    """A safe height, and the amplitudes there."""

    height: float  # [m]
    amplitude: float  # of the beam where everything is as expected [m]
    worst: float  # of the beam in the worst case [m]
    evaluations: int


@dataclass(frozen=True)
class _Case:
    damper: DamperResponse
    amplitude: float  # of the support [m]
    offset: float  # of the ceiling [m]
    travel: float  # time in which the ceiling opens [s]


def robust_height(
    scene: Scene, damper: DamperResponse, amplitude: float, spread: float, best: Best, uncertainty: Uncertainty,
    limits: tuple[float, float], mapper: Mapper = map,
) -> Robust:  # fmt: skip
    """Return the height whose largest amplitude over all cases is least.

    amplitude, spread: of the support [m]; best: the bare optimum; cases: the ends of the amplitude's error bar, of the
    stiffness's and of the ceiling's position, and the expectation. The excitation's frequency stays what it is.
    Raises NumericalFailure.
    """
    cases = _cases(scene, damper, amplitude, spread, uncertainty)
    clearance, timing = best.height - damper.diameter, Timing(damper.settling(), 12.0)

    def run(job: tuple[float, _Case]) -> Response:
        height, case = job
        return case.damper.opened(case.amplitude, max(height + case.offset, damper.diameter), timing, case.travel)

    rated: list[tuple[float, list[Response]]] = []
    share = 1.0
    while share > _LEAST and (not rated or worst_of(rated[-1]) <= min(map(worst_of, rated)) * (1.0 + FLAT)):
        heights = [damper.diameter + clearance * (share - _STEP * k) for k in range(_BATCH)]
        heights = [height for height in heights if limits[0] <= height <= limits[1]]
        answers = list(mapper(run, product(heights, cases)))
        rated += [(h, answers[k * len(cases) : (k + 1) * len(cases)]) for k, h in enumerate(heights)]
        share -= _STEP * _BATCH
    worst = min(map(worst_of, rated))
    height, responses = min(item for item in rated if worst_of(item) <= worst * (1.0 + FLAT))
    return Robust(
        height=height,
        amplitude=responses[0].amplitude,
        worst=max(response.amplitude for response in responses),
        evaluations=len(rated) * len(cases),
    )


def worst_of(rated: tuple[float, list[Response]]) -> float:
    """Return the largest amplitude [m] at a height over all cases, raised where one of them rumbles."""
    return max(r.amplitude * (1.0 if r.regular else _RUMBLE) for r in rated[1])


def with_stiffness(scene: Scene, damper: DamperResponse, factor: float) -> DamperResponse:
    """Return the response of a beam whose stiffness is `factor` times as large, driven at the same frequency."""
    beam = scene.beam.model_dump()
    beam["stiffness"] *= factor
    return DamperResponse(scene.with_(beam=beam, frequency=damper.frequency), _MARGIN_RTOL)


def _cases(
    scene: Scene, damper: DamperResponse, amplitude: float, spread: float, uncertainty: Uncertainty
) -> list[_Case]:
    """The expectation first, then the corners; each of them opened at once and slowly: near the cliff that differs."""
    soft, stiff = (with_stiffness(scene, damper, 1.0 + side * uncertainty.stiffness) for side in (-1.0, 1.0))
    amplitudes = dict.fromkeys((max(amplitude - spread, 0.05 * amplitude), amplitude + spread))
    corners = product((soft, stiff), amplitudes, (uncertainty.resolution,), (0.0, 1.0))
    return [_Case(damper, amplitude, 0.0, 0.0), *(_Case(*corner) for corner in corners)]


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
        self, amplitude: float, amplitude_std: float = 0.0, frequency: float = math.nan, *, margin: float = 0.0,
        height: float = math.nan,
    ) -> Selection:  # fmt: skip
        """Return the best height reached from `height` [m], or from closed; see `HeightSelector.select`."""
        check_excitation(amplitude, amplitude_std, frequency, margin)
        begun = time.perf_counter()
        damper = response_at(self._damper, self._scene, frequency, _RTOL)
        approaches = FROM_CLOSED
        if height > damper.diameter * (1.0 + 1e-6):
            approaches = travelled(height, self._speed), travelled(height, self._speed, _LATER * damper.period)
        try:
            with ThreadPoolExecutor(self._workers) as pool:
                best = best_height(damper, amplitude, limits=self._limits, approaches=approaches, mapper=pool.map)
                if margin > 0.0:
                    return self._safe(damper, amplitude, margin * amplitude_std, best, pool, begun)
        except NumericalFailure as error:
            raise SelectionError(f"direct: {error}") from error
        wall = time.perf_counter() - begun
        return Selection(best.height, best.amplitude, best.efficiency, self.method, best.evaluations, wall)

    def _safe(
        self, damper: DamperResponse, amplitude: float, spread: float, best: Best, pool: ThreadPoolExecutor,
        begun: float,
    ) -> Selection:  # fmt: skip
        found = robust_height(self._scene, damper, amplitude, spread, best, self._uncertainty, self._limits, pool.map)
        efficiency = 1.0 - found.amplitude / damper.closed_amplitude(amplitude)
        return Selection(
            found.height, found.amplitude, efficiency, self.method, best.evaluations + found.evaluations,
            time.perf_counter() - begun, best.efficiency - efficiency,
        )  # fmt: skip
