# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions: closed forms first, then what every multiplier obeys, then what cannot be found."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import restitution_of
from atpid_sim.maps import DamperResponse
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
from atpid_sim.simulation.integration import Integration, Observation
from atpid_sim.system import Array, reduced_mass
from studies.theory.closed_forms import ShakingTable, doubling, onset
from studies.theory.two_impacts import Symmetric, TwoImpacts, return_map_slope, symmetric_motions

DAMPING_RATIO = 0.01
#: A support of amplitude 1 pushes the mass through spring and damper: force, and by how much it leads [rad].
FORCE, LEAD = math.hypot(1.0, 2.0 * DAMPING_RATIO), math.atan(2.0 * DAMPING_RATIO)


# --- Masri and Caughey: two impacts a cycle, gravity left out


def two_impacts_scene(mass_ratio: float, restitution: float) -> Scene:
    return standard_bench(
        beam={"mass": 1.0, "stiffness": 1.0, "damping": 2.0 * DAMPING_RATIO},
        grain={"mass_fraction": mass_ratio / (1.0 + mass_ratio), "radius": 0.5},
        contact={"law": "impact", "restitution": restitution},
        excitation={"amplitude": 1.0, "frequency": 0.5 / math.pi}, ceiling={"height": 21.0}, gravity=0.0,
    )  # fmt: skip


def section_in_flight(system: TwoImpacts, motion: Symmetric) -> tuple[float, Array]:
    """Phase and section state a quarter of a period after the impact on the floor, by the closed form."""
    t = 0.5 * system.half_period
    beam, velocity = system.motion(t, motion.phase, motion.start)
    phase = (motion.phase - LEAD + t) / (2.0 * math.pi)
    return phase % 1.0, FORCE * np.array([beam, velocity, motion.start[0] + motion.grain * t, motion.grain])


@pytest.mark.parametrize(
    ("mass_ratio", "restitution", "clearance"),
    [(0.1, 0.5, 20.0), (0.1, 0.5, 30.0), (0.2, 0.3, 12.0), (0.1, 0.5, 10.0)],
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


def test_two_impacts_a_cycle_lose_stability_where_the_closed_form_does() -> None:
    def largest(clearance: float) -> float:
        return symmetric_motions(TwoImpacts(0.1, 0.5, clearance / FORCE))[-1].multiplier

    clearances = np.linspace(20.0, 60.0, 81)
    stable = [largest(c) < 1.0 for c in clearances]
    assert stable[0]
    first = stable.index(False)
    edge = brentq(lambda c: largest(c) - 1.0, clearances[first - 1], clearances[first], xtol=1e-10)
    system = TwoImpacts(0.1, 0.5, 20.0 / FORCE)
    phase, section = section_in_flight(system, symmetric_motions(system)[-1])
    integration = Integration(two_impacts_scene(0.1, 0.5), "impact")
    motion = solve(ReturnMap(integration, Conditions(1.0, 0.5 / math.pi, 21.0), phase), section).motion
    assert motion is not None
    cliff = find_cliff(integration, motion, 80.0, 0.5, 1e-6)
    assert cliff.height == pytest.approx(1.0 + edge, abs=2e-6)


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
    scene = standard_bench(
        beam=TABLE, grain={"mass_fraction": 1e-6, "radius": 0.0085},
        contact={"law": "impact", "restitution": RESTITUTION},
        excitation={"amplitude": 0.01, "frequency": FREQUENCY}, ceiling={"height": 100.0},
    )  # fmt: skip
    spring = complex(TABLE["stiffness"], TABLE["damping"] * omega)
    table = gamma * GRAVITY / omega**2
    amplitude = table * abs((spring - TABLE["mass"] * omega**2) / spring)
    struck = ShakingTable(RESTITUTION, gamma).phase
    period = 1.0 / FREQUENCY
    launch = 0.5 * GRAVITY * period
    highest = table * math.sin(struck) + launch * 0.5 * period - 0.5 * GRAVITY * (0.5 * period) ** 2
    section = [-table * math.sin(struck), -table * omega * math.cos(struck), highest, 0.0]
    returns = ReturnMap(
        Integration(scene, "impact"), Conditions(amplitude, FREQUENCY, 100.0), struck / (2.0 * math.pi) + 0.5
    )
    return solve(returns, np.array(section) - np.array([1.0, 0.0, 1.0, 0.0]) * scene.static_deflection).motion


@pytest.mark.parametrize("gamma", [1.02 * ONSET, 1.2, 0.98 * DOUBLING, 1.1 * DOUBLING])
def test_multipliers_of_a_ball_on_a_vibrating_table(gamma: float) -> None:
    found = ball(gamma)
    assert found is not None
    closed = ShakingTable(RESTITUTION, gamma).multipliers
    assert np.sort(np.abs(found.multipliers))[-2:] == pytest.approx(np.sort(np.abs(closed)), rel=1e-4)
    assert (found.stability_margin > 0.0) == (gamma < DOUBLING)


def test_a_ball_doubles_its_period_where_the_closed_form_has_it() -> None:
    def leading(gamma: float) -> float:
        found = ball(gamma)
        assert found is not None
        return float(found.multipliers[0].real) + 1.0

    assert brentq(leading, 1.2, 1.6, xtol=1e-8) == pytest.approx(DOUBLING, rel=1e-5)


# --- the bench


def bench(mass_fraction: float = 0.1, fidelity: str = "soft") -> Integration:
    return Integration(standard_bench(grain={"mass_fraction": mass_fraction, "radius": 0.0085}), fidelity, 1e-10)


def settled(integration: Integration, amplitude: float, height: float) -> tuple[Conditions, State]:
    """Conditions, and the state at phase zero after the closed damper was opened and 50 periods have passed."""
    damper = DamperResponse(integration.scene)
    state, end = damper.closed_state(amplitude), 56.0 * damper.period
    path = (0.0, damper.diameter), (6.0 * damper.period, height)
    damper.advance(amplitude, state, path, Observation((end, end)))
    return Conditions(amplitude, damper.frequency, height), state


def motion_of(integration: Integration, amplitude: float, height: float, periods: int = 1) -> PeriodicMotion:
    found = periodic_motion(integration, *settled(integration, amplitude, height), periods=periods)
    assert found.ending is SearchEnding.FOUND
    assert found.motion is not None
    return found.motion


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


@pytest.mark.parametrize("height", [0.1, 0.19, 0.2])
def test_a_disturbance_decays_by_the_largest_multiplier(height: float) -> None:
    integration = bench()
    found = motion_of(integration, 0.01, height)
    returns = ReturnMap(integration, found.conditions, found.phase)
    values, vectors = np.linalg.eig(found.slope)
    leading = vectors[:, int(np.argmax(np.abs(values)))]
    size = np.array([1.0, 34.0, 1.0, 34.0]) * found.amplitude
    disturbed = found.section + 1e-3 * found.amplitude * leading.real / np.abs(leading / size * found.amplitude).max()
    distances = []
    for _ in range(13):
        distances.append(np.abs((disturbed - found.section) / size).max())
        disturbed = returns(disturbed)
    decay = (distances[12] / distances[2]) ** 0.1
    assert decay == pytest.approx(found.largest_multiplier, rel=0.01)


def test_a_motion_found_repeats_itself_for_ten_periods() -> None:
    integration = bench(fidelity="impact")
    found = motion_of(integration, 0.01, 0.2)
    again = ReturnMap(integration, found.conditions, found.phase, periods=10)
    assert again(found.section) == pytest.approx(found.section, abs=1e-11)
    assert found.residual <= 1e-11
    assert found.settling_periods == pytest.approx(-1.0 / math.log(found.largest_multiplier))


def test_a_doubled_motion_is_stable_where_period_one_is_not() -> None:
    integration = bench()
    conditions, state = settled(integration, 0.01, 0.1825)
    once = periodic_motion(integration, conditions, state).motion
    twice = periodic_motion(integration, conditions, state, periods=2).motion
    assert once is not None
    assert once.multipliers[0].real < -1.0
    assert once.settling_periods == math.inf
    assert twice is not None
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
    for share, grows in ((0.995, False), (1.005, True)):
        motion = raised(integration, cliff.last, share * cliff.height)
        assert motion is not None
        assert (motion.stability_margin < 0.0) == grows
        returns = ReturnMap(integration, motion.conditions, motion.phase)
        disturbed = motion.section * (1.0 + 1e-5)
        first = np.abs(disturbed - motion.section).max()
        for _ in range(60):
            disturbed = returns(disturbed)
        assert (np.abs(disturbed - motion.section).max() > 10.0 * first) == grows


def test_a_branch_that_stays_stable_ends_with_the_range() -> None:
    integration = bench()
    cliff = find_cliff(integration, motion_of(integration, 0.01, 0.1), 0.12, 0.005, 1e-5)
    assert cliff.loss is Loss.NONE
    assert cliff.height == pytest.approx(0.12)


# --- what cannot be found


def test_a_closed_damper_has_no_section() -> None:
    integration = bench()
    conditions, state = settled(integration, 0.01, 0.017)
    found = periodic_motion(integration, conditions, state)
    assert found.ending is SearchEnding.NO_SECTION
    assert found.motion is None


def test_in_irregular_motion_nothing_stable_is_found() -> None:
    integration = bench()
    searches = [periodic_motion(integration, *settled(integration, 0.01, h)) for h in np.linspace(0.22, 0.3, 9)]
    endings = [search.ending for search in searches]
    assert SearchEnding.NOT_CONVERGED in endings
    assert all((search.motion is None) == (search.ending is not SearchEnding.FOUND) for search in searches)
    assert all(search.motion is None or search.motion.stability_margin < 0.0 for search in searches)


def test_a_cliff_needs_a_stable_motion_to_start_from() -> None:
    integration = bench(fidelity="impact")
    unstable = motion_of(integration, 0.01, 0.18)
    with pytest.raises(ValueError, match=r"largest multiplier of 1\.19.*; allowed: below 1"):
        find_cliff(integration, unstable, 0.3, 0.001, 1e-5)
    with pytest.raises(ValueError, match=r"resolution: given 0 m; allowed: above 0 and at most the step, 0\.001 m"):
        find_cliff(integration, unstable, 0.3, 0.001, 0.0)
    with pytest.raises(ValueError, match="periods: given 0; allowed: at least 1"):
        periodic_motion(integration, unstable.conditions, State.resting(0.0, 0.0), periods=0)


def test_a_grain_in_contact_at_the_section_is_no_section_state() -> None:
    integration = bench()
    found = motion_of(integration, 0.01, 0.1)
    at_contact = (found.phase + found.impacts[0, columns.E_TIME] * found.conditions.frequency + 0.01) % 1.0
    ended = solve(ReturnMap(integration, found.conditions, at_contact), found.section)
    assert ended.ending in (SearchEnding.NO_SECTION, SearchEnding.NOT_CONVERGED)
    assert ended.motion is None
