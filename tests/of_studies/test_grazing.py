# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Grazing of random linear oscillators at a stop: where it is, its square-root term, and the fold that comes from it.

The container strikes a grain that does not move with its ceiling, so that the height sets the gap; the closed forms
bound x above, hence x is the container's displacement downward.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest

from atpid_sim.periodic import Conditions, Loss, PeriodicMotion, ReturnMap, find_cliff, follow_branch, solve
from atpid_sim.scene import scene_from_mapping
from atpid_sim.system import Array
from studies.peace01 import FixedStop
from studies.theory.impact_oscillator import OneImpact, flow, square_root_term

PLACE, RADIUS = 20.0, 0.5


class Oscillator(NamedTuple):
    """A structure of one mode on a moving support, or of several under a force, with an immovable stop."""

    masses: Array
    omegas: Array
    ratios: Array
    factors: Array
    restitution: float
    drive: float

    @property
    def integration(self) -> FixedStop:
        names = ("mass", "frequency", "damping_ratio", "drive_factor")
        rows = zip(self.masses, self.omegas / (2.0 * math.pi), self.ratios, self.factors, strict=True)
        first, *further = [dict(zip(names, map(float, row), strict=True)) for row in rows]
        del first["drive_factor"]
        scene = scene_from_mapping({
            "beam": first, "further_modes": further, "drive": "force",
            "grain": {"mass_fraction": 0.5, "radius": RADIUS}, "gravity": 0.0, "ceiling": {"height": 100.0},
            "contact": {"law": "impact", "restitution": self.restitution},
            "excitation": {"amplitude": 1.0, "frequency": self.drive / (2.0 * math.pi)},
            "initial": {"grain_height": PLACE}, "duration": 1e3, "tolerance": 1e-6,
        })  # fmt: skip
        return FixedStop(scene, "impact", PLACE)

    @property
    def phasors(self) -> Array:
        """Of each mode's displacement upward without stop, for an amplitude of 1."""
        spring, damper = self.masses * self.omegas**2, 2.0 * self.masses * self.ratios * self.omegas * 1j * self.drive
        found: Array = self.factors / (spring - self.masses * self.drive**2 + damper)
        return found

    def linear(self, angle: float) -> tuple[float, Array]:
        """Phase of the drive and section state where x without stop is at an angle from its rise through zero."""
        turned = angle + math.pi - np.angle(self.phasors.sum())
        state = self.phasors * np.exp(1j * turned)
        return turned / (2.0 * math.pi) % 1.0, np.column_stack((state.imag, self.drive * state.real)).ravel()

    def conditions(self, gap: float) -> Conditions:
        """At an amplitude of 1; gap: over the amplitude without stop."""
        height = gap * abs(self.phasors.sum()) + PLACE + 2.0 * RADIUS
        return Conditions(1.0, self.drive / (2.0 * math.pi), height)

    def gap(self, motion: PeriodicMotion) -> float:
        reach = motion.conditions.amplitude * abs(self.phasors.sum())
        return float((motion.conditions.height - PLACE - 2.0 * RADIUS) / reach)


def drawn(seed: int) -> Oscillator:
    draw, count = np.random.default_rng(seed), 1 + seed % 3
    masses, omegas = draw.uniform(0.5, 4.0, count), np.cumsum(draw.uniform(1.0, 6.0, count))
    ratios, factors = np.exp(draw.uniform(np.log(1e-3), np.log(0.1), count)), draw.uniform(-1.0, 1.0, count)
    factors[0] = 1.0
    return Oscillator(masses, omegas, ratios, factors, draw.uniform(0.1, 0.95), omegas[0] * draw.uniform(0.6, 1.6))


@pytest.mark.parametrize("seed", range(12))
def test_the_motion_without_impact_ends_by_grazing_where_it_reaches_the_stop(seed: int) -> None:
    one = drawn(seed)
    integration, reach = one.integration, abs(one.phasors.sum())
    phase, section = one.linear(-0.5 * math.pi)
    motion = solve(ReturnMap(integration, one.conditions(1.2), phase), section).motion
    assert motion is not None
    cliff = find_cliff(integration, motion, one.conditions(0.7).height, 0.05 * reach, 1e-9 * reach)
    assert cliff.loss is Loss.GRAZING
    assert one.gap(cliff.last) == pytest.approx(1.0, abs=1e-6)
    bifurcations = follow_branch(integration, motion, {"amplitude": (0.5, 1.5)}).bifurcations
    assert [(each.loss, each.ends_stability) for each in bifurcations] == [(Loss.GRAZING, True)]
    assert one.gap(bifurcations[0].motion) == pytest.approx(1.0, abs=2e-6)


@pytest.mark.parametrize("seed", range(12))
def test_just_beyond_grazing_the_map_has_the_square_root_term(seed: int) -> None:
    """Its error is of the order of the root, as the next term is in proportion to the distance itself."""
    one = drawn(seed)
    (phase, section), reach = one.linear(0.0), abs(one.phasors.sum())
    to_section = flow(one.omegas, one.ratios, 1.5 * math.pi / one.drive)
    errors = []
    for passed in (1e-6, 1e-8):
        after = ReturnMap(one.integration, one.conditions(1.0 - passed), phase)(section)
        term = -square_root_term(one.masses, to_section, one.restitution, one.drive * reach * math.sqrt(2.0 * passed))
        errors.append(float(np.linalg.norm(after - section - term) / np.linalg.norm(term)))
    assert errors[1] < 1e-3
    assert errors[1] < 0.2 * errors[0]


@pytest.mark.parametrize("seed", range(12))
def test_the_fold_of_the_motion_with_one_impact_is_tangent_to_grazing(seed: int) -> None:
    draw = np.random.default_rng(100 + seed)
    omega, ratio, restitution = draw.uniform(1.0, 30.0), draw.uniform(0.03, 0.12), draw.uniform(0.1, 0.9)
    damped, unit = omega * math.sqrt(1.0 - ratio**2), np.ones(1)
    # so far above resonance that free flight would pass the stop by this share of the amplitude at the fold
    passed, resonant = 10.0 ** draw.uniform(-3.5, -2.5), OneImpact(omega, ratio, restitution, damped)
    away = abs(resonant.deviation[1]) * math.sqrt(passed / resonant.tangency)
    drive = damped * (1.0 + away)
    closed = OneImpact(omega, ratio, restitution, drive)
    one = Oscillator(draw.uniform(0.5, 4.0) * unit, omega * unit, ratio * unit, unit, restitution, drive)
    integration, reach = one.integration, abs(one.phasors.sum())
    largest, speed = closed.fold
    angle, state = closed.section(1.5 * speed)
    returns = ReturnMap(integration, one.conditions(closed.gap(1.5 * speed)), one.linear(angle)[0])
    motion = solve(returns, -reach * state).motion
    assert motion is not None
    assert motion.section == pytest.approx(-reach * state, abs=1e-8 * reach * drive)
    assert np.sort_complex(motion.multipliers) == pytest.approx(
        np.sort_complex(closed.multipliers(1.5 * speed)), abs=1e-2
    )
    ranges = {"height": (one.conditions(closed.gap(2.0 * speed)).height, one.conditions(2.0 * largest - 1.0).height)}
    branch = follow_branch(integration, motion, ranges)
    assert branch.cliff is not None
    assert branch.cliff.loss is Loss.FOLD
    above = one.gap(branch.cliff.motion) - 1.0
    assert above == pytest.approx(largest - 1.0, rel=1e-6)
    assert above / away**2 == pytest.approx(closed.tangency, rel=5.0 * away)
    # beyond the fold: the multiplier grows as one over the speed of the impact
    unstable = [each for each in branch.motions if len(each.impacts) and each.multiplier_error < 1e-4]
    assert min(each.impacts[0, 2] for each in unstable) < reach * speed
    for each in unstable:
        assert each.largest_multiplier == pytest.approx(
            abs(closed.multipliers(each.impacts[0, 2] / reach)[0]), rel=1e-3
        )
    coefficient = -(1.0 + restitution) * drive**2 * closed.period_flow[0, 1]
    slow = 1e-4 * speed
    assert closed.multipliers(slow)[0] * slow == pytest.approx(coefficient, rel=1e-3)
