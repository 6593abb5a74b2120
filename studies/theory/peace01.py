# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""NLvib's benchmark PEACE01 by the return map, and its equations of motion once more, for scipy.

M. Krack, J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer 2019; NLvib 1.4, example PEACE01: two
masses of 1 in a chain, springs 0 (to the left), 1 and 1 (to the ground), dampers 0.06 of these, a force 0.1 cos(W t) on
mass 2, a unilateral spring of stiffness 200 at a gap of 1 on mass 1, W from 0.8 to 1.4 of the first mode. Here mass 1
is the container, and the stop a grain too heavy to move, with the law `linear`.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp

from atpid_dynamics.continuation import Branch, follow_branch
from atpid_sim.engine import columns
from atpid_sim.engine.sections import Sections
from atpid_sim.modal import phasors
from atpid_sim.periodic import Conditions, PeriodicMotion, ReturnMap, solve
from atpid_sim.periodic.cliff import changed
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

#: The benchmark; radius and height only have to be out of the way.
STIFFNESS = np.array([[1.0, -1.0], [-1.0, 2.0]])
DAMPING, FORCE, STOP, GAP, SPAN = 0.06 * STIFFNESS, 0.1, 200.0, 1.0, (0.8, 1.4)
FIRST = math.sqrt(float(np.linalg.eigvalsh(STIFFNESS)[0])) / (2.0 * math.pi)  # frequency of the first mode
_RADIUS, _HEIGHT, _IMMOVABLE = 10.0, 1e3, 1e15
#: How far beyond the first touch the motions begin that strike the stop, over the first mode's frequency.
_BEYOND = 1e-4
#: Tolerance of runs.
_RTOL = 1e-10


class FixedStop(Integration):
    """A scene whose grain stays where it is: a section state has the modes only."""

    def __init__(self, scene: Scene, fidelity: str, place: float) -> None:
        """Prepare the integration; place: displacement of the grain [m]."""
        super().__init__(scene, fidelity, _RTOL)
        self.system = self.system._replace(grain_mass=_IMMOVABLE)
        flight = self.sections.flight.copy()
        flight[columns.GRAIN] = place
        self.sections = Sections(self.sections.places[:-2], flight)


def modes() -> tuple[Array, Array]:
    """Return the undamped angular frequencies (2,), and mass 2's displacement over mass 1's in each mode (2,)."""
    squares, shapes = np.linalg.eigh(STIFFNESS)
    return np.sqrt(squares), shapes[1] / shapes[0]


def stopped() -> FixedStop:
    """Return the benchmark's integration."""
    return FixedStop(benchmark(), "soft", GAP)


def benchmark() -> Scene:
    """Return the benchmark as a scene, at the lowest frequency."""
    omega, ratio = modes()
    mass = 1.0 + ratio**2  # that an impulse at mass 1 meets
    parts = [
        {"mass": m, "stiffness": m * w**2, "damping": DAMPING[0, 0] * m * w**2}
        for m, w in zip(mass.tolist(), omega.tolist(), strict=True)
    ]
    return scene_from_mapping({
        "beam": parts[0], "further_modes": [parts[1] | {"drive_factor": float(ratio[1] / ratio[0])}], "drive": "force",
        "grain": {"mass_fraction": 1.0 - 1e-6, "radius": _RADIUS}, "gravity": 0.0,
        "contact": {"law": "linear", "stiffness": STOP, "damping": 0.0},
        "excitation": {"amplitude": FORCE * float(ratio[0]), "frequency": SPAN[0] * FIRST},
        "ceiling": {"height": _HEIGHT}, "initial": {"grain_height": GAP}, "duration": 1e3, "tolerance": 1e-9,
    })  # fmt: skip


def branch(integration: Integration) -> Branch:
    """Return the motions from the lowest frequency to the highest.

    At a touch the curve has a corner, at which `follow_branch` ends: behind it follow the motions that strike the stop,
    then those beyond resonance that do not.
    """
    span = SPAN[0] * FIRST, SPAN[1] * FIRST
    rising = follow_branch(integration, linear(integration, span[0]), {"frequency": span})
    touch = rising.motions[-1]
    beyond = touch.conditions._replace(frequency=touch.conditions.frequency + _BEYOND * FIRST)
    struck = changed(integration, touch, beyond)
    assert struck is not None
    striking = follow_branch(integration, struck, {"frequency": span})
    falling = follow_branch(
        integration, linear(integration, striking.motions[-1].conditions.frequency), {"frequency": span}
    )
    kept = tuple(motion for motion in striking.motions if len(motion.impacts))
    return Branch(
        (*rising.motions, *kept, *falling.motions),
        (*rising.bifurcations, *striking.bifurcations, *falling.bifurcations),
    )


def linear(integration: Integration, frequency: float) -> PeriodicMotion:
    """Return the motion at a frequency at which the stop is not struck."""
    scene = integration.scene
    amplitude, free = scene.excitation.amplitude_points[0][1], scene.modes
    assert free is not None
    phasor = amplitude * phasors(free.free, frequency)
    section = np.column_stack((phasor.imag, 2.0 * math.pi * frequency * phasor.real)).ravel()
    motion = solve(ReturnMap(integration, Conditions(amplitude, frequency, _HEIGHT), 0.0), section).motion
    assert motion is not None
    return motion


def checked(motion: PeriodicMotion) -> tuple[float, float]:
    """Return by scipy how far a motion's state is off a period later, relative, and its largest multiplier."""
    omega, ratio = 2.0 * math.pi * motion.conditions.frequency, modes()[1]
    to_masses = np.vstack((np.ones(2), ratio))

    def derivative(t: float, z: Array) -> Array:
        x, v = z[:2], z[2:]
        force = np.array([-STOP * max(x[0] - GAP, 0.0), FORCE * math.sin(omega * t + 2.0 * math.pi * motion.phase)])
        return np.concatenate((v, force - STIFFNESS @ x - DAMPING @ v))

    def passed(z: Array) -> Array:
        period = 2.0 * math.pi / omega
        ran = solve_ivp(derivative, (0.0, period), z, "DOP853", rtol=1e-11, atol=1e-12, max_step=period / 400.0)
        end: Array = ran.y[:, -1]
        return end

    start = np.concatenate((to_masses @ motion.section[::2], to_masses @ motion.section[1::2]))
    slope = np.array([(passed(start + dz) - passed(start - dz)) / 2e-5 for dz in 1e-5 * np.eye(4)]).T
    apart = float(np.abs(passed(start) - start).max() / np.abs(start).max())
    return apart, float(np.abs(np.linalg.eigvals(slope)).max())
