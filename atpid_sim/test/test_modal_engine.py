# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Structures of several modes, and forces: against scipy's integration of the same equations, and closed forms."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from atpid_sim.kernel_inputs import contact_of
from atpid_sim.maps.response import DamperResponse, Timing
from atpid_sim.modal import phasors
from atpid_sim.scene import Scene, SceneError, standard_bench
from atpid_sim.simulation.energy import mode_residuals
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.simulate import simulate, trajectory
from atpid_sim.system import Array

TSUJI = {"law": "tsuji", "young_modulus": 2.1e7, "poisson_ratio": 0.2, "damping_ratio": 0.3}
FURTHER = [
    {"mass": 0.9, "frequency": 31.0, "damping_ratio": 0.01, "drive_factor": -0.4},
    {"mass": 2.4, "frequency": 17.0, "damping_ratio": 0.02, "drive_factor": 0.3},
]


def scene_of(drive: str = "support", modes: int = 2, amplitude: float = 0.02, **changes: Any) -> Scene:
    """A structure of some modes whose beam is that of the standard bench."""
    given: dict[str, Any] = {
        "further_modes": FURTHER[: modes - 1], "drive": drive, "duration": 1.5, "contact": TSUJI, "tolerance": 1e-7,
        "excitation": {"amplitude": amplitude, "frequency": 5.2}, "ceiling": {"height": 0.12},
    }  # fmt: skip
    return standard_bench(**(given | changes))


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
    scene = scene_of(drive, modes, 0.02 if drive == "support" else 4.0)
    own = trajectory(scene, 500.0, "soft")
    equations = Equations(scene)
    motion = solve_ivp(
        equations.derivative, (0.0, scene.duration), equations.start, "DOP853", own.time, rtol=1e-9, atol=1e-12,
        max_step=5e-4,
    )  # fmt: skip
    beam = motion.y[:modes].sum(axis=0)
    assert len(own.impacts) > 5
    assert np.abs(own.beam - beam).max() < 1e-4 * np.ptp(beam)
    assert np.abs(own.grain - motion.y[-2]).max() < 1e-4 * np.ptp(motion.y[-2])


@pytest.mark.parametrize("drive", ["support", "force"])
def test_instantaneous_impacts(drive: str) -> None:
    restitution, lifted = 0.7, 0.03
    scene = scene_of(
        drive, 3, 0.05 if drive == "support" else 20.0, contact={"law": "impact", "restitution": restitution},
        duration=0.8, ceiling={"height": 0.08}, initial={"grain_height": lifted, "grain_velocity": 0.5},
    )  # fmt: skip
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
        motion = solve_ivp(
            equations.derivative, (t, scene.duration), z, "DOP853", args=(False,), rtol=1e-11, atol=1e-13,
            dense_output=True, events=(above_floor, below_ceiling), max_step=1e-3,
        )  # fmt: skip
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


def test_a_mode_that_nothing_moves_changes_nothing() -> None:
    still = {"mass": 1e6, "frequency": 5.0, "damping_ratio": 0.01}
    one, two = (simulate(standard_bench(further_modes=modes), "soft", check=False) for modes in ([], [still]))
    assert two.amplitude == pytest.approx(one.amplitude, rel=1e-6)
    assert two.impacts == one.impacts


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


def test_the_ledger_of_each_mode_closes() -> None:
    scene = scene_of(modes=3, duration=4.0)
    integration = Integration(scene, "soft", 1e-8)
    first, state = integration.initial_state(), integration.initial_state()
    integration.advance(state, integration.table)
    assert scene.modes is not None
    assert np.abs(mode_residuals(scene.modes.free, first, state)).max() < 1e-6
    assert abs(integration.ledger(first, state, integration.table).residual) < 1e-6
    assert state.y[1:3] == pytest.approx(state.y[16:].reshape(3, -1)[:, :2].sum(axis=0), rel=1e-9)


def test_coordinates_lead_to_joined_ones_and_back() -> None:
    modes = scene_of(modes=3).modes
    assert modes is not None
    assert modes.to_joined @ modes.from_joined == pytest.approx(np.eye(3), abs=1e-12)
    assert modes.from_joined.sum(axis=0) == pytest.approx(np.ones(3))  # their sum stays the container's displacement


def test_the_response_starts_in_the_closed_damper_s_steady_motion() -> None:
    scene = scene_of(modes=3, ceiling={"height": 0.017}, contact={"law": "impact", "restitution": 0.3})
    response = DamperResponse(scene)
    followed = response.follow(0.02, ((0.0, 0.017),), Timing(4, 8))
    assert followed.amplitude == pytest.approx(response.closed_amplitude(0.02), rel=1e-9)
    assert followed.regular
    opened = response.opened(0.02, 0.1, Timing(60, 8))
    longer = simulate(scene.with_(height=0.1, duration=60.0, steady_window=[58.0, 60.0], excitation={
        "amplitude": 0.02, "frequency": 5.2}), "impact", check=False)  # fmt: skip
    assert opened.amplitude == pytest.approx(longer.amplitude, rel=0.05)


def test_modes_of_one_frequency_are_those_of_their_sum() -> None:
    # two modes that only differ in mass move as one whose compliance is the sum of theirs
    def run(*modes: dict[str, float]) -> float:
        first, *further = [{"frequency": 5.5, "damping_ratio": 0.02} | mode for mode in modes]
        grain = {"mass_fraction": 0.04 / (0.04 + first["mass"]), "radius": 0.0085}
        scene = scene_of(beam=first, further_modes=further, grain=grain, duration=3.0)
        return simulate(scene, "soft", check=False).amplitude

    both = run({"mass": 0.6}, {"mass": 1.2, "drive_factor": 1.0 / 3.0})
    assert both == pytest.approx(run({"mass": 0.4}), rel=1e-4)


def test_a_force_is_no_unusual_displacement() -> None:
    lines = scene_of("force", 2, 100.0, beam={"mass": 2.0, "frequency": 31.0, "damping_ratio": 0.05}).warnings()
    assert [line for line in lines if line.startswith("excitation, ")] == []


def test_a_mode_without_mass_is_refused() -> None:
    with pytest.raises(SceneError, match=r"further_modes\[0\].mass"):
        scene_of(further_modes=[{"mass": 0.0, "frequency": 1.0, "damping_ratio": 0.0}])
