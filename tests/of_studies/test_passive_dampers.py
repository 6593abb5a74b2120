# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuned masses against published optima and an integration; Masri's gap against its theory and the simulated best."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from atpid_control.design.tuned_mass import TunedBeam, Tuning, den_hartog, optimised
from atpid_sim.kernel_inputs import contact_of, restitution_of
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.system import reduced_mass
from studies.theory.tuned_mass import exact_undamped
from studies.theory.two_impacts import TwoImpacts, longest_clearance, masri_gap, symmetric_motions
from studies.thorough_search import thorough_best


@pytest.mark.parametrize("mu", [0.01, 0.05, 0.1, 0.25])
def test_den_hartog(mu: float) -> None:
    tuning = den_hartog(mu)
    assert tuning.frequency == pytest.approx(1.0 / (1.0 + mu))
    assert tuning.damping**2 == pytest.approx(3.0 * mu / (8.0 * (1.0 + mu) ** 3))
    tuned = TunedBeam(mu, 0.0, tuning)
    # both fixed points, which no damping moves, are as high as his sqrt(1 + 2 / mu)
    spread = math.sqrt(mu / (2.0 + mu))
    points = np.sqrt((1.0 + np.array([-spread, spread])) / (1.0 + mu))
    assert tuned.beam(points) == pytest.approx(math.sqrt(1.0 + 2.0 / mu), rel=1e-12)
    assert tuned.peak() == pytest.approx(math.sqrt(1.0 + 2.0 / mu), rel=5e-3)
    # without damping the tuned mass stands the beam still at its own frequency
    assert TunedBeam(mu, 0.0, Tuning(tuning.frequency, 1e-12)).beam(tuning.frequency) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("mu", [0.02, 0.1, 3.0 / 7.0])
def test_the_optimum_on_an_undamped_beam_is_the_exact_one(mu: float) -> None:
    exact, peak = exact_undamped(mu)
    found = optimised(mu, 0.0)
    assert found.frequency == pytest.approx(exact.frequency, rel=1e-7)
    assert found.damping == pytest.approx(exact.damping, rel=1e-6)
    assert TunedBeam(mu, 0.0, found).peak() == pytest.approx(peak, rel=1e-9)


@settings(deadline=None, max_examples=20)
@given(mu=st.floats(0.02, 0.5), zeta=st.floats(0.0, 0.1), f=st.floats(-0.02, 0.02), z=st.floats(-0.1, 0.1))
def test_no_tuning_near_the_optimum_is_better(mu: float, zeta: float, f: float, z: float) -> None:
    best = optimised(mu, zeta)
    other = Tuning(best.frequency * (1.0 + f), best.damping * (1.0 + z))
    least = TunedBeam(mu, zeta, best).peak()
    assert least <= TunedBeam(mu, zeta, other).peak() * (1.0 + 1e-9)
    assert least <= TunedBeam(mu, zeta, den_hartog(mu)).peak() * (1.0 + 1e-9)


def test_a_tuned_mass_without_mass_leaves_the_damped_beam() -> None:
    ratios, zeta = np.linspace(0.5, 1.5, 7), 0.02
    support = 1.0 + 2j * zeta * ratios
    alone = np.abs(support / (support - ratios**2))
    assert TunedBeam(0.0, zeta, Tuning(1.0, 0.1)).beam(ratios) == pytest.approx(alone, rel=1e-12)


def test_beam_and_stroke_are_those_of_an_integration() -> None:
    mu, zeta, tuning, ratio = 1.0 / 9.0, 0.0237, den_hartog(1.0 / 9.0), 0.95

    def slope(t: float, y: np.ndarray) -> list[float]:
        beam, beam_velocity, mass, mass_velocity = y
        coupling = tuning.frequency**2 * (mass - beam) + 2.0 * tuning.damping * (mass_velocity - beam_velocity)
        support, support_velocity = math.sin(ratio * t), ratio * math.cos(ratio * t)
        own = support - beam + 2.0 * zeta * (support_velocity - beam_velocity)
        return [beam_velocity, own + mu * coupling, mass_velocity, -coupling]

    end = 120.0 * 2.0 * math.pi / ratio
    last = np.linspace(end - 2.0 * math.pi / ratio, end, 721)
    y = solve_ivp(slope, (0.0, end), np.zeros(4), t_eval=last, rtol=1e-9, atol=1e-11).y
    tuned = TunedBeam(mu, zeta, tuning)
    assert 0.5 * np.ptp(y[0]) == pytest.approx(float(tuned.beam(ratio)), rel=1e-4)
    assert 0.5 * np.ptp(y[2] - y[0]) == pytest.approx(float(tuned.stroke(ratio)), rel=1e-4)


def bench(fraction: float) -> tuple[Scene, DamperResponse, float]:
    scene = standard_bench(gravity=0.0).with_(mass_fraction=fraction)
    damper = DamperResponse(scene, 1e-5)
    return scene, damper, restitution_of(contact_of(scene), 1.0, reduced_mass(damper.system))


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.1, 0.2, 0.3])
def test_masri_s_gap_is_the_best_without_gravity(fraction: float) -> None:
    _, damper, e = bench(fraction)
    gap = masri_gap(damper.system, damper.frequency, e)
    assert gap is not None
    assert gap.multiplier < 1.0
    best = thorough_best(damper, 0.015)
    assert gap.clearance == pytest.approx((best.height - damper.diameter) / 0.015, rel=0.02)
    assert gap.peak == pytest.approx(best.amplitude / 0.015, rel=0.05)


def test_no_symmetric_motion_exists_beyond_the_longest_clearance() -> None:
    for mu, e, damping, ratio in ((1.0 / 9.0, 0.146, 0.0237, 0.9487), (3.0 / 7.0, 0.124, 0.0237, 0.8367)):
        longest = longest_clearance(TwoImpacts(mu, e, 1.0, damping, ratio))
        assert symmetric_motions(TwoImpacts(mu, e, longest * (1.0 + 1e-6), damping, ratio)) == []
        two = symmetric_motions(TwoImpacts(mu, e, longest * (1.0 - 1e-6), damping, ratio))
        # where they meet both have the same grain speed
        assert two[0].grain == pytest.approx(two[1].grain, rel=1e-2)


def test_where_no_motion_is_stable_there_is_no_gap() -> None:
    scene, damper, _ = bench(0.3)
    assert scene.grain.mass_fraction == 0.3
    assert masri_gap(damper.system, damper.frequency, 0.4) is None
