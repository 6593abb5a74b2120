# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Passive dampers designed from a model: fixed heights, Masri's gap and tuned masses as heavy as the grain."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from atpid_design.tuned_mass import TunedBeam, Tuning, den_hartog, optimised
from atpid_sim.maps import DamperResponse, Timing
from atpid_sim.robust import restitution
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import on_all_cores
from studies.theory.two_impacts import MasriGap, masri_gap
from studies.thorough_search import thorough_best

#: Heights tried for one that serves all amplitudes: from this share of the ballistic clearance of the smallest
#: amplitude to this share of the largest's.
_LOWEST, _HIGHEST, _COUNT = 0.35, 0.9, 48
#: Tolerance of the runs.
RTOL = 1e-5


@dataclass(frozen=True)
class Fixed:
    """Heights that stay [m]; NaN: there is none."""

    whole_range: float  # least largest amplitude, over that of the closed damper, for all amplitudes of the support
    first: float  # best at the first amplitude
    masri: float  # of Masri's theory at the first amplitude
    theory: MasriGap | None


@dataclass(frozen=True)
class Tuned:
    """A tuned mass as heavy as the grain, fixed to the beam in place of the container's grain."""

    frequency: float  # natural frequency [Hz]
    damping: float  # [N s/m]

    def on(self, scene: Scene) -> TunedBeam:
        """Return a structure with this tuned mass."""
        beam, mass = scene.beam, scene.grain_mass
        own = math.sqrt(beam.stiffness / beam.mass)
        tuning = Tuning(2.0 * math.pi * self.frequency / own, self.damping / (2.0 * mass * own))
        return TunedBeam(mass / beam.mass, beam.damping / (2.0 * beam.mass * own), tuning)

    def remaining(self, scene: Scene) -> float:
        """Return the beam's amplitude over that with the closed damper [-], at the resonance of the latter."""
        ratio = scene.natural_frequency_hz * 2.0 * math.pi / math.sqrt(scene.beam.stiffness / scene.beam.mass)
        return float(self.on(scene).beam(ratio)) / DamperResponse(scene).closed_amplitude(1.0)

    def worst(self, scene: Scene) -> float:
        """Return the largest amplitude at any frequency over that of the closed damper at its resonance [-]."""
        return self.on(scene).peak() / DamperResponse(scene).closed_amplitude(1.0)

    def stroke(self, scene: Scene) -> float:
        """Return the amplitude of the tuned mass against the beam over the support's [-], at the same resonance."""
        ratio = scene.natural_frequency_hz * 2.0 * math.pi / math.sqrt(scene.beam.stiffness / scene.beam.mass)
        return float(self.on(scene).stroke(ratio))


def tuned_masses(model: Scene) -> tuple[Tuned, Tuned]:
    """Return the tuned masses by Den Hartog's rule and by optimisation, for the model's beam."""
    beam, mass = model.beam, model.grain_mass
    own, ratio = math.sqrt(beam.stiffness / beam.mass), mass / beam.mass
    rules = den_hartog(ratio), optimised(ratio, beam.damping / (2.0 * beam.mass * own))
    first, second = (Tuned(rule.frequency * own / (2.0 * math.pi), 2.0 * mass * own * rule.damping) for rule in rules)
    return first, second


def fixed_heights(model: Scene, amplitudes: Sequence[float]) -> Fixed:
    """Return the fixed heights for a model and support amplitudes (n,) [m]. Raises NumericalFailure."""
    damper = DamperResponse(model, RTOL)
    theory = masri_gap(damper.system, damper.frequency, restitution(model))
    masri = math.nan if theory is None else damper.diameter + theory.clearance * amplitudes[0]
    first = thorough_best(damper, amplitudes[0]).height
    return Fixed(_for_all(damper, amplitudes), first, masri, theory)


def remaining(damper: DamperResponse, amplitude: float, height: float) -> float:
    """Return the beam's amplitude over the closed damper's [-] at a height [m]: opened in 1 s or at once, the worse."""
    timing = Timing(1.5 * damper.settling(), 16.0)
    worst = max(damper.opened(amplitude, height, timing, travel).amplitude for travel in (1.0, 0.0))
    return worst / damper.closed_amplitude(amplitude)


def _for_all(damper: DamperResponse, amplitudes: Sequence[float]) -> float:
    low, high = _LOWEST * min(amplitudes), _HIGHEST * max(amplitudes)
    clearances = np.geomspace(low, high, _COUNT) * damper.ballistic_clearance(1.0)
    heights = [damper.diameter + float(clearance) for clearance in clearances]

    def worst(height: float) -> float:
        return max(remaining(damper, amplitude, height) for amplitude in amplitudes)

    return min((value, height) for height, value in on_all_cores(worst, heights))[1]
