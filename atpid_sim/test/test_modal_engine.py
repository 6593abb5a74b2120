# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Several modes, forces, their periodic motions: against scipy, closed forms, the engine of one mode."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sim_refusals import refused

from atpid_sim.kernel_inputs import contact_of
from atpid_sim.maps.response import DamperResponse, Timing
from atpid_sim.modal import phasors
from atpid_sim.periodic import SteadyState, steady_state
from atpid_sim.scene import Scene, SceneError, standard_bench
from atpid_sim.simulation.integration import Integration, Observation
from atpid_sim.simulation.simulate import simulate, trajectory
from atpid_sim.system import Array

TSUJI = {"law": "tsuji", "young_modulus": 2.1e7, "poisson_ratio": 0.2, "damping_ratio": 0.3}
FURTHER = [
    {"mass": 0.9, "frequency": 31.0, "damping_ratio": 0.01, "drive_factor": -0.4},
    {"mass": 2.4, "frequency": 17.0, "damping_ratio": 0.02, "drive_factor": 0.3},
]


def forced(scene: Scene) -> Scene:
    """The same with the force that the support's motion exerts through spring and damper."""
    beam, amplitude = scene.beam, scene.excitation.amplitude_points[-1][1]
    force = amplitude * abs(complex(beam.stiffness, 2.0 * math.pi * scene.frequency_hz * beam.damping))
    return scene.with_(drive="force", amplitude=force)


def scene_of(drive: str = "support", modes: int = 2, amplitude: float = 0.02, **changes: Any) -> Scene:
    """A structure of some modes whose beam is that of the standard bench."""
    tone, common = {"amplitude": amplitude, "frequency": 5.2}, {"duration": 1.5, "contact": TSUJI, "tolerance": 1e-7}
    given = {"further_modes": FURTHER[: modes - 1], "drive": drive, "excitation": tone, "ceiling": {"height": 0.12}}
    return standard_bench(**(given | common | changes))


class Equations:
    """The equations of motion written down once more, for scipy: modes and grain, (2 modes + 2,)."""

    def __init__(self, scene: Scene) -> None:
        modes = [scene.beam, *scene.further_modes]
        self.mass, self.stiffness, self.damping = (
            np.array([getattr(mode, name) for mode in modes]) for name in ("mass", "stiffness", "damping")
        )
        factors = np.array([1.0, *(mode.drive_factor for mode in scene.further_modes)])
        if scene.drive == "support":
            factors[0] -= factors[1:].sum()
            self.direct, self.rate = factors * self.stiffness, factors * self.damping
        else:
            self.direct, self.rate = factors, 0.0 * factors
        self.grain, self.gravity, self.count = scene.grain_mass, scene.gravity, len(modes)
        self.omega, self.size = 2.0 * math.pi * scene.frequency_hz, scene.excitation.amplitude_points[0][1]
        self.clearance = scene.ceiling.heights[0][1] - 2.0 * scene.grain.radius
        self.contact = contact_of(scene).parameters
        rest = -np.full(self.count, self.grain * self.gravity) / self.stiffness
        rest[0] -= self.mass[0] * self.gravity / self.stiffness[0]
        self.start = np.concatenate((rest, np.zeros(self.count), [rest.sum(), 0.0]))

    def push(self, overlap: float, closing: float) -> float:
        """Tsuji's force [N]."""
        if overlap <= 0.0:
            return 0.0
        return max(0.0, float(self.contact[0] * overlap**1.5 + self.contact[1] * closing * overlap**0.25))

    def derivative(self, t: float, z: Array, contacts: bool = True) -> Array:
        """Derivative of the state."""
        n = self.count
        q, rate, x, v = z[:n], z[n : 2 * n], z[:n].sum(), z[n : 2 * n].sum()
        push = 0.0
        if contacts:
            push = self.push(x - z[-2], v - z[-1]) - self.push(z[-2] - x - self.clearance, z[-1] - v)
        u, w = self.size * math.sin(self.omega * t), self.size * self.omega * math.cos(self.omega * t)
        a = (self.direct * u + self.rate * w - self.stiffness * q - self.damping * rate - push) / self.mass
        a[0] -= self.gravity
        return np.concatenate((rate, a, [z[-1], push / self.grain - self.gravity]))


@pytest.mark.parametrize("drive", ["support", "force"])
@pytest.mark.parametrize("modes", [1, 2, 3])
def test_contacts_of_finite_duration(drive: str, modes: int) -> None:
    scene = scene_of(drive, modes, 0.02 if drive == "support" else 4.0, duration=0.9)
    own = trajectory(scene, 500.0, "soft")
    equations = Equations(scene)
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "max_step": 5e-4}
    motion = solve_ivp(equations.derivative, (0.0, scene.duration), equations.start, t_eval=own.time, **options)
    beam = motion.y[:modes].sum(axis=0)
    assert len(own.impacts) > 5
    assert np.abs(own.beam - beam).max() < 1e-4 * np.ptp(beam)
    assert np.abs(own.grain - motion.y[-2]).max() < 1e-4 * np.ptp(motion.y[-2])


@pytest.mark.parametrize("drive", ["support", "force"])
def test_instantaneous_impacts(drive: str) -> None:
    restitution, lifted = 0.7, 0.03
    thrown = {"grain_height": lifted, "grain_velocity": 0.5}
    law, size = {"law": "impact", "restitution": restitution}, 0.05 if drive == "support" else 20.0
    scene = scene_of(drive, 3, size, contact=law, duration=0.8, ceiling={"height": 0.08}, initial=thrown)
    own, equations = trajectory(scene, 500.0, "impact"), Equations(scene)
    n, t, z, beam = equations.count, 0.0, equations.start.copy(), np.zeros(len(own.time))
    z[-2:] += lifted, 0.5

    def above_floor(_t: float, z: Array, _contacts: bool) -> float:
        return float(z[-2] - z[:n].sum())

    def below_ceiling(_t: float, z: Array, _contacts: bool) -> float:
        return float(z[:n].sum() + equations.clearance - z[-2])

    for event in (above_floor, below_ceiling):
        vars(event).update(terminal=True, direction=-1)
    effective = 1.0 / np.sum(1.0 / equations.mass)
    while True:
        options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "max_step": 1e-3, "dense_output": True}
        events = {"args": (False,), "events": (above_floor, below_ceiling)}
        motion = solve_ivp(equations.derivative, (t, scene.duration), z, **options, **events)
        inside = (own.time >= t) & (own.time <= motion.t[-1])
        beam[inside] = motion.sol(own.time[inside])[:n].sum(axis=0)
        t, z = float(motion.t[-1]), motion.y[:, -1].copy()
        closing = z[n : 2 * n].sum() - z[-1]
        if motion.status == 0 or abs(closing) < 0.3:  # the bounces that lead to sticking are another matter
            break
        impulse = (1.0 + restitution) * effective * equations.grain / (effective + equations.grain) * closing
        z[n : 2 * n] -= impulse / equations.mass
        z[-1] += impulse / equations.grain
        z[-2] += math.copysign(1e-12, closing)  # off the wall: the next event is another one
    known = own.time <= t
    assert np.sum(own.impacts["time"] < t) > 6
    assert np.abs(own.beam - beam)[known].max() < 1e-6 * np.ptp(beam[known])


@pytest.mark.parametrize("drive", ["support", "force"])
def test_the_closed_damper_and_the_bare_structure_in_closed_form(drive: str) -> None:
    scene = scene_of(drive, 3, 0.01, ceiling={"height": 0.017}, duration=120.0, steady_window=[119.0, 120.0])
    result, modes = simulate(scene, "simplified", check=False), scene.modes
    assert modes is not None
    omega = 2.0 * math.pi * scene.frequency_hz
    free = modes.free
    # dynamic compliance of the container and what the drive alone moves there; the grain is a mass at the container
    compliance = np.sum(1.0 / (free.stiffness - free.mass * omega**2 + 1j * omega * free.damping))
    alone = phasors(free, scene.frequency_hz).sum()
    together = alone / (1.0 - scene.grain_mass * omega**2 * compliance)
    assert result.bare_amplitude == pytest.approx(0.01 * abs(alone), rel=1e-9)
    assert result.amplitude == pytest.approx(0.01 * abs(together), rel=2e-3)  # what couples joined modes is left out
    assert abs(result.energy_residual) < 2e-3  # by the same


def test_the_ledger_of_several_modes_closes() -> None:
    scene = scene_of(modes=3, duration=4.0)
    integration = Integration(scene, "soft", 1e-8)
    first, state = integration.initial_state(), integration.initial_state()
    integration.advance(state, integration.table)
    assert abs(integration.ledger(first, state, integration.table).residual) < 1e-6
    assert state.y[1:3] == pytest.approx(state.y[16:].reshape(3, -1)[:, :2].sum(axis=0), rel=1e-9)


def test_the_response_starts_in_the_closed_damper_s_steady_motion() -> None:
    scene = scene_of(modes=3, ceiling={"height": 0.017}, contact={"law": "impact", "restitution": 0.3})
    response = DamperResponse(scene)
    followed = response.follow(0.02, ((0.0, 0.017),), Timing(4, 8))
    assert followed.amplitude == pytest.approx(response.closed_amplitude(0.02), rel=1e-9)
    assert followed.regular
    opened = response.opened(0.02, 0.1, Timing(60, 8))
    longer = simulate(scene.with_(height=0.1, duration=60.0, steady_window=[58.0, 60.0]), "impact", check=False)
    assert opened.amplitude == pytest.approx(longer.amplitude, rel=0.05)


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"further_dampers": [{"mass_fraction": 0.1, "height": 0.1}]}, "further_dampers 'height': one damper grain"),
        ({"grain": {"mass_fraction": 0.1, "radius": 0.0085, "count": 3}}, "grain.count 3 one grain"),
    ],
)
def test_one_damper_with_one_grain_is_simulated(changes: dict[str, Any], parts: str) -> None:
    with refused(SceneError, *parts.split()):
        scene_of(**changes)


IMPACT = {"law": "impact", "restitution": 0.3}
#: A mode so heavy that nothing moves it.
STILL = {"mass": 1e6, "frequency": 5.5, "damping_ratio": 0.05}


def found(scene: Scene, fidelity: str = "auto", rtol: float = 1e-8) -> SteadyState:
    state = steady_state(scene, fidelity, rtol).state
    assert state is not None
    return state


def settled(scene: Scene, fidelity: str) -> float:
    """Amplitude after 300 s [m]."""
    longer = scene.with_(duration=300.0, steady_window=[298.0, 300.0])
    return Integration(longer, fidelity, 1e-9).run(Observation(longer.steady_window)).last.amplitude


@pytest.mark.parametrize(
    ("drive", "modes", "law", "fidelity"),
    [
        ("support", 3, TSUJI, "finite"),
        ("support", 3, IMPACT, "impact"),
        ("force", 1, TSUJI, "soft"),
        ("force", 2, IMPACT, "impact"),
        ("force", 3, TSUJI, "soft"),
    ],
)
def test_it_is_what_the_run_settles_to(drive: str, modes: int, law: dict[str, Any], fidelity: str) -> None:
    scene = scene_of(drive, modes, 0.02 if drive == "support" else 4.0, contact=law, duration=20.0)
    state = found(scene, fidelity)
    assert len(state.impacts) > 1
    assert len(state.section) == len(state.multipliers) == 2 * modes + 2
    left_out = state.error_estimate if fidelity == "finite" else 0.0
    assert state.amplitude == pytest.approx(settled(scene, fidelity), rel=3e-8 + left_out)


def test_a_held_grain_leaves_the_joined_modes_which_decay_as_they_do() -> None:
    scene = scene_of(modes=3, ceiling={"height": 0.017}, contact=IMPACT, duration=20.0)
    state, modes = found(scene, "impact"), scene.modes
    assert modes is not None
    decay = np.exp(-0.5 * modes.joined.damping / modes.joined.mass * state.periods / scene.frequency_hz)
    assert sorted(np.abs(state.multipliers)) == pytest.approx([0.0, 0.0, *sorted(np.repeat(decay, 2))], rel=1e-6)


@pytest.mark.parametrize("fidelity", ["impact", "soft"])
def test_a_force_that_is_the_support_s_gives_the_same_motion(fidelity: str) -> None:
    law = IMPACT if fidelity == "impact" else TSUJI
    scene = standard_bench(contact=law, ceiling={"height": 0.1}, duration=20.0)
    own, same = (found(one, fidelity) for one in (scene, forced(scene)))
    assert same.amplitude == pytest.approx(own.amplitude, rel=1e-8)
    assert abs(same.multipliers[0]) == pytest.approx(abs(own.multipliers[0]), rel=1e-4)


def test_a_mode_that_nothing_moves_leaves_the_motion_as_it_is() -> None:
    scene = standard_bench(contact=IMPACT, ceiling={"height": 0.15}, duration=20.0)
    own, same = found(scene, "impact"), found(scene.with_(further_modes=[STILL]), "impact")
    assert same.amplitude == pytest.approx(own.amplitude, rel=1e-5)
    decay = math.exp(-2.0 * math.pi * 0.05 * 5.5 / scene.frequency_hz)
    assert np.sort(np.abs(same.multipliers)) == pytest.approx(
        np.sort([*np.abs(own.multipliers), decay, decay]), rel=1e-4, abs=1e-6
    )
