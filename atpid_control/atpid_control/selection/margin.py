# SPDX-License-Identifier: Apache-2.0
"""The margin: the height that is best in the worst case of what is not known exactly."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from atpid_sim.maps import Best, DamperResponse, Response, Timing
from atpid_sim.maps.best import FLAT, Mapper
from atpid_sim.scene import Scene

#: Shares of the bare optimum's clearance that are tried, batch by batch, until the best lies inside.
_BATCH, _STEP, _LEAST = 9, 0.025, 0.2

#: An irregular motion in any case counts as this many times as large: the margin is there to keep out of it.
_RUMBLE = 1.5

#: Tolerance of the runs.
_RTOL = 1e-4


@dataclass(frozen=True)
class Uncertainty:
    """What is not known exactly, apart from the amplitude."""

    stiffness: float = 0.05  # relative, of the beam: the model's own uncertainty [-]
    resolution: float = 5e-4  # of the ceiling's position [m]


@dataclass(frozen=True)
class Robust:
    """A height that is safe, and what it is worth."""

    height: float  # [m]
    amplitude: float  # of the beam where everything is as expected [m]
    worst: float  # of the beam in the worst case [m]
    bare_worst: float  # of the beam in the worst case at the bare optimum [m]
    evaluations: int


@dataclass(frozen=True)
class _Case:
    damper: DamperResponse
    amplitude: float  # of the support [m]
    offset: float  # of the ceiling [m]
    travel: float  # time in which the ceiling opens [s]


def robust_height(
    scene: Scene,
    damper: DamperResponse,
    amplitude: float,
    spread: float,
    best: Best,
    uncertainty: Uncertainty,
    limits: tuple[float, float],
    mapper: Mapper = map,
) -> Robust:
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
        bare_worst=max(response.amplitude for response in rated[0][1]),
        evaluations=len(rated) * len(cases),
    )


def worst_of(rated: tuple[float, list[Response]]) -> float:
    """Return the largest amplitude [m] at a height over all cases, raised where one of them rumbles."""
    return max(r.amplitude * (1.0 if r.regular else _RUMBLE) for r in rated[1])


def with_stiffness(scene: Scene, damper: DamperResponse, factor: float) -> DamperResponse:
    """Return the response of a beam whose stiffness is `factor` times as large, driven at the same frequency."""
    beam = scene.beam.model_dump()
    beam["stiffness"] *= factor
    return DamperResponse(scene.with_(beam=beam, frequency=damper.frequency), _RTOL)


def _cases(
    scene: Scene, damper: DamperResponse, amplitude: float, spread: float, uncertainty: Uncertainty
) -> list[_Case]:
    """The expectation first, then the corners; each of them opened at once and slowly: near the cliff that differs."""
    soft, stiff = (with_stiffness(scene, damper, 1.0 + side * uncertainty.stiffness) for side in (-1.0, 1.0))
    amplitudes = dict.fromkeys((max(amplitude - spread, 0.05 * amplitude), amplitude + spread))
    corners = product((soft, stiff), amplitudes, (uncertainty.resolution,), (0.0, 1.0))
    return [_Case(damper, amplitude, 0.0, 0.0), *(_Case(*corner) for corner in corners)]
