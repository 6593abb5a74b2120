# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Closed forms and quantities of the thesis on motions whose answer is known."""

import numpy as np
import pytest

from atpid_sim.scene import standard_bench
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.simulate import trajectory
from studies.theory import closed_forms, energy, impacts, two_impacts


def test_mass_modification_and_pseudo_inertial_force() -> None:
    beam = np.array([30.0, -20.0, 5.0])
    assert energy.mass_modification(0.036, beam, np.full(3, -9.81), 9.81) == pytest.approx(-0.036)
    assert energy.mass_modification(0.036, beam, beam, 9.81) == pytest.approx(0.0)
    assert energy.pseudo_inertial_force(0.036, beam, np.full(3, -9.81)) == pytest.approx(-0.036 * (beam + 9.81))
    assert energy.natural_frequency(0.362, 427.6) == pytest.approx(5.47, abs=1e-3)


def log(*rows: tuple[float, float]) -> np.ndarray:
    """Return an impact log of (time, wall)."""
    return np.array([(time, wall, 1.0) for time, wall in rows]).reshape(-1, 3)


def periodic(*one: tuple[float, float]) -> np.ndarray:
    """Return ten periods of 1 s of the impacts of one."""
    return log(*[(number + time, wall) for number in range(10) for time, wall in one])


@pytest.mark.parametrize(
    ("sequence", "kind"),
    [
        (periodic((0.1, 1), (0.6, -1)), "optimal"),
        (periodic((0.1, 1), (0.2, 1), (0.6, -1)), "mixed"),
        (periodic((0.1, 1), (0.2, 1), (0.6, -1), (0.65, -1), (0.66, -1)), "sticking"),
        (periodic((0.1, 1), (0.5, 1)), "no_ceiling"),
        (log(), "no_ceiling"),
        (periodic((0.1, 1), (0.6, -1))[:13], "irregular"),
        (log(*[(t, -1 if k % 3 == 2 else 1) for k, t in enumerate(np.arange(0.0, 10.0, 0.7))]), "irregular"),
        (periodic((0.1, 1), (0.4, -1), (0.6, 1), (0.9, -1)), "irregular"),
    ],
)
def test_the_motion_type_follows_from_the_impacts(sequence: np.ndarray, kind: str) -> None:
    assert impacts.motion_type(sequence, 2.0, 9.0, 1.0) == kind


def test_the_walls_the_grain_sticks_to() -> None:
    found = impacts.visits(periodic((0.1, 1), (0.2, 1), (0.6, -1)), 1.0)
    assert [visit.impacts for visit in found[:2]] == [2, 1]
    assert impacts.sticks(found, impacts.FLOOR)
    assert not impacts.sticks(found, impacts.CEILING)


def beam_motion(height: float) -> tuple[energy.Structure, energy.BeamMotion]:
    """Return beam and motion of the standard bench with the ceiling at a height, 2 s of it."""
    scene = standard_bench(duration=2.0).with_(height=height)
    motion = trajectory(scene, 50_000.0, "soft")
    beam = energy.Structure(0.3258, 427.6, 0.56, 9.81, -scene.static_deflection)
    series = (motion.time, motion.support, motion.beam, motion.beam_velocity, motion.beam_acceleration)
    return beam, energy.BeamMotion(*series)


def test_the_balance_of_the_beam_closes_and_its_work_is_that_of_the_ledger() -> None:
    beam, motion = beam_motion(0.2)
    assert energy.balance_residual(beam, motion) < 2e-3
    assert (energy.contact_force(beam, motion).max(), energy.contact_force(beam, motion).min()) > (100.0, -100.0)
    ledger = Integration(standard_bench(duration=2.0).with_(height=0.2), "soft").run().ledger
    damper = 0.56 * np.gradient(motion.displacement - motion.support, motion.time) ** 2
    assert np.trapezoid(damper, motion.time) == pytest.approx(ledger.beam_loss, rel=1e-3)


def test_in_flight_no_force_acts_on_the_beam() -> None:
    beam, motion = beam_motion(0.2)
    force = energy.contact_force(beam, motion)
    assert np.median(np.abs(force[motion.time > 1.0])) < 1e-3
    start = int(np.argmax(force))
    begin, end = energy.impact_span(force, start - 20, 500)
    assert begin < start < end
    assert abs(force[end]) < 0.02 * force[start]


def test_masri_and_caughey_two_impacts_a_cycle() -> None:
    # the support moves with amplitude 1, so the force is larger than 1 by the damper's share
    force = np.hypot(1.0, 0.02)
    (motion,) = two_impacts.symmetric_motions(two_impacts.TwoImpacts(0.1, 0.5, 20.0 / force))
    assert force * motion.peak == pytest.approx(3.42057194227, abs=5e-12)
    assert motion.multiplier < 1.0
    state = np.array([motion.phase, *motion.start, motion.grain])
    system = two_impacts.TwoImpacts(0.1, 0.5, 20.0 / force)
    assert two_impacts.half_return(system, state) == pytest.approx(state, abs=1e-12)


def test_a_narrow_clearance_makes_two_impacts_a_cycle_unstable() -> None:
    found = two_impacts.symmetric_motions(two_impacts.TwoImpacts(0.1, 0.5, 10.0))
    assert [motion.multiplier > 1.0 for motion in found] == [True]


def test_closed_forms_of_impacts() -> None:
    mass = 2699.0 * 4.0 / 3.0 * np.pi * 0.1**3
    stiffness = 4.0 / 3.0 * 7e10 / (1.0 - 0.3**2) * np.sqrt(0.1)
    found = closed_forms.hertz_impact(stiffness, mass, 0.2)
    assert found.force == pytest.approx(11369.9, abs=0.05)
    assert 1e6 * found.overlap == pytest.approx(49.717, abs=5e-4)
    assert 1e6 * found.duration == pytest.approx(731.66, abs=5e-3)
    assert closed_forms.bouncing_time(9.81, 0.5, 9.81) == pytest.approx(4.0)
