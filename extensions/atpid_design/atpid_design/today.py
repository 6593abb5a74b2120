# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The structure of today, without the damper: its amplitude over the box of uncertainties, in closed form."""

import functools
import math

import numpy as np

from atpid_design.problem import Problem, Uncertainty, deviation, drawn_frequencies, modes_of, resonance
from atpid_sim.modal import bare_amplitude, phasors
from atpid_sim.robust import inside

#: Structures drawn for the amplitude of several modes without the damper, and their seed.
_DRAWN, _SEED = 512, 5


def bare_range(problem: Problem, fraction: float, amplitude: float) -> tuple[float, float]:
    """Return the least and largest amplitude [m] without the damper within the box, for an identified amplitude [m].

    Of one mass on its support it depends on frequency ratio and damping ratio only; all between the ends is looked at.
    Of several modes, and under a force, it is that of drawn structures, most of them at corners of the box.
    """
    u = problem.uncertainty
    if problem.is_modal:
        low, high = _bare_over_drive(problem, fraction)
        return amplitude * low, amplitude * high
    resonant = resonance(problem, fraction)
    low, high = problem.excitation_frequency or (resonant, resonant)
    # the grain's mass is known, so an error of the beam's moves the resonance
    moved = 0.5 * fraction * u.mass if problem.excitation_frequency is None else u.frequency
    ratios = np.linspace(low * (1.0 - u.detuning) / (1.0 + moved), high * (1.0 + u.detuning) / (1.0 - moved), 501)
    ratios = np.append(ratios / problem.frequency, np.clip(1.0, *ratios[[0, -1]] / problem.frequency))
    found = [
        bare_amplitude(1.0, 1.0, 2.0 * problem.damping * (1.0 + side * u.damping), amplitude, ratio / (2.0 * math.pi))
        for ratio in ratios
        for side in (-1.0, 1.0)
    ]
    return min(found) * (1.0 - u.amplitude), max(found) * (1.0 + u.amplitude)


@functools.lru_cache(maxsize=64)
def _bare_over_drive(problem: Problem, fraction: float) -> tuple[float, float]:
    """Return the least and largest amplitude without the damper over that of the drive, of several modes [m/m, m/N]."""
    points = inside(_DRAWN, problem.quantities, _SEED)
    names = list(Uncertainty.model_fields)
    # masses and dampings at their ends; frequencies anywhere, since a resonance may lie between
    between = [k for k in range(problem.quantities)
               if (names[k] in ("frequency", "detuning") if k < len(names) else (k - len(names)) % 3 == 1)]  # fmt: skip
    ends = np.sign(points)
    ends[:, between] = points[:, between]
    found = []
    for point, drawn in zip(ends, drawn_frequencies(problem, len(ends), _SEED), strict=True):
        off = deviation(problem, point)
        modes = modes_of(problem, fraction, off)
        assert modes is not None
        at = (modes.joined.frequencies[0] if drawn is None else drawn) * (1.0 + off.detuning)
        found.append((1.0 + off.amplitude) * abs(phasors(modes.free, at).sum()))
    return float(min(found)), float(max(found))
