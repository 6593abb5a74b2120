# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions, branches and cliffs: closed forms, multipliers, simulation, and what cannot be found."""

import math

import numpy as np
import pytest
from bench_motions import bench, motion_of, settled

from atpid_dynamics.continuation import Branch, follow_branch, follow_cliff
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import restitution_of
from atpid_sim.periodic import (
    Conditions,
    Loss,
    PeriodicMotion,
    ReturnMap,
    SearchEnding,
    find_cliff,
    periodic_motion,
    raised,
    solve,
)
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array, reduced_mass
from studies.theory.closed_forms import ShakingTable, doubling, onset
from studies.theory.peace01 import FIRST, branch, checked, stopped
from studies.theory.two_impacts import Symmetric, TwoImpacts, longest_clearance, return_map_slope, symmetric_motions

DAMPING_RATIO = 0.01
#: A support of amplitude 1 pushes the mass through spring and damper: force, and by how much it leads [rad].
FORCE, LEAD = math.hypot(1.0, 2.0 * DAMPING_RATIO), math.atan(2.0 * DAMPING_RATIO)


# --- Masri and Caughey: two impacts a cycle, gravity left out
def two_impacts_scene(mass_ratio: float, restitution: float) -> Scene:
    return standard_bench(
        beam={"mass": 1.0, "stiffness": 1.0, "damping": 2.0 * DAMPING_RATIO},
        grain={"mass_fraction": mass_ratio / (1.0 + mass_ratio), "radius": 0.5},
        contact={"law": "impact", "restitution": restitution},
        excitation={"amplitude": 1.0, "frequency": 0.5 / math.pi},
        ceiling={"height": 21.0},
        gravity=0.0,
    )


def section_in_flight(system: TwoImpacts, motion: Symmetric) -> tuple[float, Array]:
    """Phase and section state a quarter of a period after the impact on the floor, by the closed form."""
    t = 0.5 * system.half_period
    beam, velocity = system.motion(t, motion.phase, motion.start)
    phase = (motion.phase - LEAD + t) / (2.0 * math.pi)
    return phase % 1.0, FORCE * np.array([beam, velocity, motion.start[0] + motion.grain * t, motion.grain])


@pytest.mark.parametrize(
    ("mass_ratio", "restitution", "clearance"), [(0.1, 0.5, 20.0), (0.1, 0.5, 30.0), (0.2, 0.3, 12.0), (0.1, 0.5, 10.0)]
)
def test_multipliers_of_two_impacts_a_cycle(mass_ratio: float, restitution: float, clearance: float) -> None:
    system = TwoImpacts(mass_ratio, restitution, clearance / FORCE)
    integration = Integration(two_impacts_scene(mass_ratio, restitution), "impact")
    for closed in symmetric_motions(system):
        phase, section = section_in_flight(system, closed)
        returns = ReturnMap(integration, Conditions(1.0, 0.5 / math.pi, 1.0 + clearance), phase)
        assert returns(section) == pytest.approx(section, abs=1e-10)  # the closed form repeats itself in the engine
        found = solve(returns, section + 1e-4).motion
        assert found is not None
        assert found.section == pytest.approx(section, abs=1e-9)
        assert found.amplitude == pytest.approx(FORCE * closed.peak, rel=1e-9)
        assert found.walls == (-1, 1)
        # the return map is the closed form's half return map twice, in other coordinates
        half = np.linalg.eigvals(return_map_slope(system, closed.phase, closed.start, closed.grain))
        assert np.sort(np.abs(found.multipliers)) == pytest.approx(np.sort(np.abs(half) ** 2), rel=1e-5, abs=1e-6)
        assert found.multiplier_error < 1e-6


# --- a ball on a vibrating table
RESTITUTION = 0.5
FREQUENCY = 5.0
#: Heaviest, stiffest, most damped beam a scene takes: a table that nothing moves but the support.
TABLE = {"mass": 1e6, "stiffness": 1e12, "damping": 1e9}
GRAVITY = 9.81
ONSET, DOUBLING = onset(RESTITUTION), doubling(RESTITUTION)


def ball(gamma: float) -> PeriodicMotion | None:
    """Return period one of the ball; gamma: largest acceleration of the table over gravity."""
    omega = 2.0 * math.pi * FREQUENCY
    light, law = {"mass_fraction": 1e-6, "radius": 0.0085}, {"law": "impact", "restitution": RESTITUTION}
    tone = {"amplitude": 0.01, "frequency": FREQUENCY}
    scene = standard_bench(beam=TABLE, grain=light, contact=law, excitation=tone, ceiling={"height": 100.0})
    spring = complex(TABLE["stiffness"], TABLE["damping"] * omega)
    table = gamma * GRAVITY / omega**2
    amplitude = table * abs((spring - TABLE["mass"] * omega**2) / spring)
    struck = ShakingTable(RESTITUTION, gamma).phase
    period = 1.0 / FREQUENCY
    launch = 0.5 * GRAVITY * period
    highest = table * math.sin(struck) + launch * 0.5 * period - 0.5 * GRAVITY * (0.5 * period) ** 2
    section = [-table * math.sin(struck), -table * omega * math.cos(struck), highest, 0.0]
    conditions = Conditions(amplitude, FREQUENCY, 100.0)
    returns = ReturnMap(Integration(scene, "impact"), conditions, struck / (2.0 * math.pi) + 0.5)
    return solve(returns, np.array(section) - np.array([1.0, 0.0, 1.0, 0.0]) * scene.static_deflection).motion


@pytest.mark.parametrize("gamma", [1.02 * ONSET, 1.2, 0.98 * DOUBLING, 1.1 * DOUBLING])
def test_multipliers_of_a_ball_on_a_vibrating_table(gamma: float) -> None:
    found = ball(gamma)
    assert found is not None
    closed = ShakingTable(RESTITUTION, gamma).multipliers
    assert np.sort(np.abs(found.multipliers))[-2:] == pytest.approx(np.sort(np.abs(closed)), rel=1e-4)
    assert (found.stability_margin > 0.0) == (gamma < DOUBLING)


# --- the bench
@pytest.mark.parametrize(("height", "impacts"), [(0.2, 2), (0.17, 3), (0.195, 2)])
def test_the_product_of_the_multipliers_is_what_impacts_and_damper_contract(height: float, impacts: int) -> None:
    integration = bench(fidelity="impact")
    found = motion_of(integration, 0.01, height)
    assert len(found.impacts) == impacts
    system = integration.system
    e = restitution_of(integration.contact, 1.0, reduced_mass(system))
    damper = math.exp(-system.damping / system.beam_mass / found.conditions.frequency)
    assert np.prod(found.multipliers).real == pytest.approx(e ** (2 * impacts) * damper, rel=1e-4)


@pytest.mark.parametrize("fidelity", ["impact", "soft"])
@pytest.mark.parametrize(("height", "contracting"), [(0.08, 2), (0.14, 2), (0.2, 0)])
def test_sticking_takes_two_dimensions_away(fidelity: str, height: float, contracting: int) -> None:
    found = motion_of(bench(fidelity=fidelity), 0.01, height)
    assert 0.0 < found.stability_margin < 1.0
    assert np.count_nonzero(np.abs(found.multipliers) < 1e-4) == contracting


def test_a_doubled_motion_is_stable_where_period_one_is_not() -> None:
    once, twice = (motion_of(bench(), 0.01, 0.1825, periods) for periods in (1, 2))
    assert once.multipliers[0].real < -1.0
    assert once.settling_periods == math.inf
    assert twice.stability_margin > 0.0
    assert len(twice.impacts) == 4


def test_the_cliff_of_the_standard_task_is_where_the_simulated_motion_leaves() -> None:
    integration = bench()
    start = motion_of(integration, 0.01, 0.2)
    cliff = find_cliff(integration, start, 0.4, 0.002, 1e-6)
    assert cliff.loss is Loss.BEATING
    assert cliff.height == pytest.approx(0.20528, abs=1e-4)
    assert (np.diff(cliff.heights) > 0.0).all()
    assert (cliff.largest < 1.0).all()
    for share, unstable in ((0.995, False), (1.005, True)):
        motion = raised(integration, cliff.last, share * cliff.height)
        assert motion is not None
        assert (motion.stability_margin < 0.0) == unstable
    stable = find_cliff(integration, motion_of(integration, 0.01, 0.1), 0.12, 0.005, 1e-5)
    assert stable.loss is Loss.NONE  # it ends with the range
    assert stable.height == pytest.approx(0.12)


def test_in_a_closed_damper_and_in_irregular_motion_nothing_stable_is_found() -> None:
    integration = bench()
    closed = periodic_motion(integration, *settled(integration, 0.01, 0.017))
    assert (closed.ending, closed.motion) == (SearchEnding.NO_SECTION, None)
    searches = [periodic_motion(integration, *settled(integration, 0.01, h)) for h in np.linspace(0.22, 0.3, 9)]
    endings = [search.ending for search in searches]
    assert SearchEnding.NOT_CONVERGED in endings
    assert all((search.motion is None) == (search.ending is not SearchEnding.FOUND) for search in searches)
    assert all(search.motion is None or search.motion.stability_margin < 0.0 for search in searches)


def test_a_cliff_needs_a_stable_motion_to_start_from() -> None:
    integration = bench(fidelity="impact")
    unstable = motion_of(integration, 0.01, 0.18)
    with pytest.raises(ValueError, match=r"multiplier.*1\.19.*1"):
        find_cliff(integration, unstable, 0.3, 0.001, 1e-5)
    with pytest.raises(ValueError, match=r"resolution.*0 m.*0\.001 m"):
        find_cliff(integration, unstable, 0.3, 0.001, 0.0)
    with pytest.raises(ValueError, match=r"periods.*0.*1"):
        periodic_motion(integration, unstable.conditions, State.resting(0.0, 0.0), periods=0)


MASS_RATIO = 0.1
HEIGHTS = {"height": (5.0, 140.0)}


@pytest.fixture(scope="module")
def masri() -> tuple[Integration, Branch]:
    """Two impacts a cycle without gravity, at resonance: the symmetric motion through its fold."""
    system = TwoImpacts(MASS_RATIO, RESTITUTION, 20.0 / FORCE)
    phase, section = section_in_flight(system, symmetric_motions(system)[-1])
    integration = Integration(two_impacts_scene(MASS_RATIO, RESTITUTION), "impact")
    motion = solve(ReturnMap(integration, Conditions(1.0, 0.5 / math.pi, 21.0), phase), section).motion
    assert motion is not None
    return integration, follow_branch(integration, motion, HEIGHTS)


def test_the_branch_turns_at_the_longest_clearance(masri: tuple[Integration, Branch]) -> None:
    _, branch = masri
    fold = next(each for each in branch.bifurcations if each.loss is Loss.FOLD)
    longest = FORCE * longest_clearance(TwoImpacts(MASS_RATIO, RESTITUTION, 1.0, DAMPING_RATIO))
    assert fold.motion.conditions.height == pytest.approx(1.0 + longest, rel=1e-7)
    assert not fold.ends_stability
    heights = [each.conditions.height for each in branch.motions]
    highest = int(np.argmax(heights))
    assert 0 < highest < len(heights) - 1  # it comes back
    assert all(each.stability_margin <= 0.0 for each in branch.motions[highest:])


def test_the_cliff_over_the_frequency_is_that_of_the_closed_form(masri: tuple[Integration, Branch]) -> None:
    integration, branch = masri
    assert branch.cliff is not None
    ratios = 0.963, 1.035
    span = ratios[0] * 0.5 / math.pi, ratios[1] * 0.5 / math.pi
    curve = follow_cliff(integration, branch.cliff, HEIGHTS | {"frequency": span})
    conditions = [each.motion.conditions for each in curve]
    assert [conditions[0].frequency, conditions[-1].frequency] == pytest.approx(span)
    assert len(curve) > 20
    for each in conditions:
        ratio = 2.0 * math.pi * each.frequency

        def largest(clearance: float, ratio: float = ratio) -> float:
            force = math.hypot(1.0, 2.0 * DAMPING_RATIO * ratio)
            system = TwoImpacts(MASS_RATIO, RESTITUTION, clearance / force, DAMPING_RATIO, ratio)
            return symmetric_motions(system)[-1].multiplier

        clearance = each.height - 1.0
        slope = (largest(1.0005 * clearance) - largest(0.9995 * clearance)) / (1e-3 * clearance)
        assert abs((largest(clearance) - 1.0) / slope) < 1e-6  # distance from the boundary of the closed form
    assert {each.loss for each in curve} == {Loss.BEATING}


def test_without_gravity_the_cliff_is_in_proportion_to_the_amplitude(masri: tuple[Integration, Branch]) -> None:
    integration, branch = masri
    assert branch.cliff is not None
    curve = follow_cliff(integration, branch.cliff, {"height": (1.5, 100.0), "amplitude": (0.5, 2.0)})
    amplitudes, _, heights = np.array([each.motion.conditions[:3] for each in curve]).T
    assert amplitudes[[0, -1]] == pytest.approx([0.5, 2.0])
    assert (heights - 1.0) / amplitudes == pytest.approx(branch.cliff.motion.conditions.height - 1.0, rel=1e-7)


def test_published_benchmark() -> None:
    """NLvib's PEACE01 against scipy's integration, and its fold, which harmonic balance of high order has as well."""
    curve = branch(stopped())
    assert Loss.GRAZING in {each.loss for each in curve.bifurcations}
    fold = next(each.motion for each in curve.bifurcations if each.loss is Loss.FOLD)
    assert fold.conditions.frequency / FIRST == pytest.approx(1.1977, abs=3e-4)
    ends = [curve.motions[k].conditions.frequency / FIRST for k in (0, -1)]
    assert ends == pytest.approx([0.8, 1.4], rel=1e-9)
    for motion in curve.motions[10::50]:
        apart, multiplier = checked(motion)
        assert apart < 1e-8
        assert multiplier == pytest.approx(motion.largest_multiplier, rel=1e-3)
