# SPDX-License-Identifier: Apache-2.0
"""The margin: the height that is best in the worst case of what is not known exactly."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from atpid_sim.maps import Best, Rig, Timing
from atpid_sim.maps.best import FLAT, Mapper
from atpid_sim.scene import Scene

#: Shares of the bare optimum's clearance that are tried: above it lies the cliff.
_SHARES = tuple(round(float(share), 4) for share in np.arange(1.02, 0.599, -0.02))

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
    rig: Rig
    amplitude: float  # of the support [m]
    offset: float  # of the ceiling [m]


def robust_height(
    scene: Scene,
    rig: Rig,
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
    cases = _cases(scene, rig, amplitude, spread, uncertainty)
    clearance = best.height - rig.diameter
    heights = sorted({float(np.clip(rig.diameter + share * clearance, *limits)) for share in _SHARES} | {best.height})
    timing = Timing(rig.settling(), 12.0)

    def run(job: tuple[float, _Case]) -> float:
        height, case = job
        return case.rig.opened(case.amplitude, max(height + case.offset, rig.diameter), timing).amplitude

    jobs = list(product(heights, cases))
    values = np.array(list(mapper(run, jobs))).reshape(len(heights), len(cases))
    worst = values.max(axis=1)
    chosen = int(np.argmax(worst <= worst.min() * (1.0 + FLAT)))
    return Robust(
        height=heights[chosen],
        amplitude=float(values[chosen, 0]),
        worst=float(worst[chosen]),
        bare_worst=float(worst[heights.index(best.height)]),
        evaluations=len(jobs),
    )


def with_stiffness(scene: Scene, rig: Rig, factor: float) -> Rig:
    """Return the rig of a beam whose stiffness is `factor` times as large, driven at the same frequency."""
    beam = scene.beam.model_dump()
    beam["stiffness"] *= factor
    return Rig(scene.with_(beam=beam, frequency=rig.frequency), _RTOL)


def _cases(scene: Scene, rig: Rig, amplitude: float, spread: float, uncertainty: Uncertainty) -> list[_Case]:
    """The expectation first, then the corners that count: what brings the cliff nearer is a larger ceiling."""
    soft, stiff = (with_stiffness(scene, rig, 1.0 + side * uncertainty.stiffness) for side in (-1.0, 1.0))
    lower, upper = max(amplitude - spread, 0.05 * amplitude), amplitude + spread
    corners = product((soft, stiff), dict.fromkeys((lower, upper)), (-uncertainty.resolution, uncertainty.resolution))
    return [_Case(rig, amplitude, 0.0), *(_Case(*corner) for corner in corners)]
