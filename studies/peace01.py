# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies peace01`: NLvib's benchmark PEACE01 by the return map, beside harmonic balance and scipy.

M. Krack, J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer 2019; NLvib 1.4, example PEACE01: two
masses of 1 in a chain, springs 0 (to the left), 1 and 1 (to the ground), dampers 0.06 of these, a force 0.1 cos(W t) on
mass 2, a unilateral spring of stiffness 200 at a gap of 1 on mass 1, W from 0.8 to 1.4 of the first mode. Shown is the
largest displacement of mass 2. Here mass 1 is the container, and the stop a grain too heavy to move, with the law
`linear`. Harmonic balance with alternating frequency and time (order 15 as there, and more) is written down once more,
and so are the equations of motion for scipy.
"""

import argparse
import json
import math
import time
from typing import Any, NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp

from atpid_common.arguments import whole
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
#: Samples of a period, tolerance of runs, and points at which scipy checks.
_SAMPLES, _RTOL, CHECKED = 1024, 1e-10, 12
#: Longest step along the curve of harmonic balance, and change of a Newton step below which it has converged.
STEP, _CONVERGED = 5e-3, 1e-9
#: Arguments of the example in the help.
EXAMPLE = "--order 63"


class FixedStop(Integration):
    """A scene whose grain stays where it is: a section state has the modes only."""

    def __init__(self, scene: Scene, fidelity: str, place: float) -> None:
        """Prepare the integration; place: displacement of the grain [m]."""
        super().__init__(scene, fidelity, _RTOL)
        self.system = self.system._replace(grain_mass=_IMMOVABLE)
        flight = self.sections.flight.copy()
        flight[columns.GRAIN] = place
        self.sections = Sections(self.sections.places[:-2], flight)


class Checked(NamedTuple):
    """A motion of the branch by scipy's integration of the equations."""

    apart: float  # distance of its state a period later, relative
    largest: float  # modulus of the multipliers


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


def second_mass(integration: Integration, motion: PeriodicMotion) -> float:
    """Return the largest displacement of mass 2 in a motion, either way."""
    state, ratio = integration.sections.flying(motion.section), modes()[1]
    row, step = np.zeros((1, columns.DRIVE_COLUMNS)), 1.0 / motion.conditions.frequency / _SAMPLES
    row[0, columns.A0], row[0, columns.OMEGA] = motion.conditions.amplitude, 2.0 * math.pi * motion.conditions.frequency
    row[0, columns.HEIGHT], row[0, columns.END], largest = _HEIGHT, step, 0.0
    for k in range(_SAMPLES):
        row[0, columns.PHASE] = 2.0 * math.pi * (motion.phase + k / _SAMPLES)
        state.y[columns.TIME] = 0.0
        integration.advance(state, row)
        largest = max(largest, abs(float(ratio @ state.y[columns.STATE_SIZE + columns.Q :: columns.MODE_COLUMNS])))
    return largest


def checked(motion: PeriodicMotion) -> Checked:
    """Return what scipy makes of a motion: its states a period later, of slightly different ones as well."""
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
    return Checked(apart, float(np.abs(np.linalg.eigvals(slope)).max()))


class HarmonicBalance:
    """The curve of the benchmark by harmonic balance of one order: mean, cosines and sines of both masses."""

    def __init__(self, order: int) -> None:
        """Prepare the transforms between coefficients and samples."""
        angle = 2.0 * math.pi * np.arange(_SAMPLES) / _SAMPLES
        self.order, harmonics = order, np.arange(1, order + 1)
        waves = np.outer(angle, harmonics)
        self.synthesis = np.column_stack((np.ones(_SAMPLES), np.cos(waves), np.sin(waves)))
        self.analysis = self.synthesis.T / _SAMPLES * np.array([1.0, *[2.0] * (2 * order)])[:, None]

    def linear(self, omega: float) -> tuple[Array, Array]:
        """Return the dynamic stiffness of all coefficients, (m, m), and its derivative by the frequency."""
        count, k = self.order, np.arange(1, self.order + 1)
        rate, square = np.zeros((2, 2 * count + 1, 2 * count + 1))
        rate[1 + k - 1, count + k], rate[count + k, 1 + k - 1] = k, -k
        square[range(1, 2 * count + 1), range(1, 2 * count + 1)] = np.concatenate((k, k)) ** 2
        unit = np.eye(2 * count + 1)
        whole = np.kron(STIFFNESS, unit) + omega * np.kron(DAMPING, rate) - omega**2 * np.kron(np.eye(2), square)
        return whole, np.kron(DAMPING, rate) - 2.0 * omega * np.kron(np.eye(2), square)

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return what is missing to balance, (m,), and its derivative (m, m + 1) by coefficients and frequency."""
        whole, by_frequency = self.linear(float(z[-1]))
        size = 2 * self.order + 1
        overlap = self.synthesis @ z[:size] - GAP
        missing = whole @ z[:-1]
        missing[:size] += self.analysis @ (STOP * np.maximum(overlap, 0.0))
        missing[size + 1] -= FORCE
        slope = np.column_stack((whole, by_frequency @ z[:-1]))
        slope[:size, :size] += self.analysis @ (STOP * (overlap > 0.0)[:, None] * self.synthesis)
        return missing, slope

    def curve(self) -> Array:
        """Return frequency over the first mode's, and largest displacement of mass 2 (points, 2)."""
        first, size = 2.0 * math.pi * FIRST, 2 * self.order + 1
        z, direction, step = np.append(np.zeros(2 * size), SPAN[0] * first), np.zeros(2 * size + 1), STEP
        z[:-1] = np.linalg.solve(self.linear(float(z[-1]))[0], FORCE * np.eye(2 * size)[size + 1])
        direction[-1], found = 1.0, []
        while True:  # to the first point beyond the span
            found.append((z[-1] / first, np.abs(self.synthesis @ z[size:-1]).max()))
            if z[-1] > SPAN[1] * first:
                return np.array(found)
            direction = np.linalg.solve(np.vstack((self.residual(z)[1], direction)), np.eye(len(z))[-1])
            direction /= np.linalg.norm(direction)
            z, step = self._corrected(z, direction, step)

    def _corrected(self, z: Array, tangent: Array, step: float) -> tuple[Array, float]:
        """Return the next point across the tangent, and the length for the one after it."""
        while True:
            tried = z + step * tangent
            for _ in range(12):
                missing, slope = self.residual(tried)
                change = np.linalg.solve(np.vstack((slope, tangent)), -np.append(missing, (tried - z) @ tangent - step))
                tried = tried + change
                if np.abs(change).max() < _CONVERGED:
                    return tried, min(1.3 * step, STEP)
            step *= 0.5


def distance(points: Array, curve: Array) -> Array:
    """Return how far points (k, 2) are from a curve (n, 2) of straight lines, in amplitude or frequency (k,)."""
    begins, ways = curve[:-1], np.diff(curve, axis=0)
    off = points[:, None] - begins
    share = np.clip((off * ways).sum(axis=2) / (ways**2).sum(axis=1), 0.0, 1.0)
    apart: Array = np.linalg.norm(off - share[..., None] * ways, axis=2).min(axis=1)
    return apart


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--order", type=whole(15, 400), default=63, help="of harmonic balance beside 15; default 63")
    parser.add_argument("--json", action="store_true", help="print every point as JSON instead of the tables")


def run(args: argparse.Namespace) -> int:
    """Follow the curve by each method, print them beside each other."""
    integration = stopped()
    integration.warm_up()
    branch(integration)
    begun = time.perf_counter()
    found = branch(integration)
    took = time.perf_counter() - begun
    points = np.array([[m.conditions.frequency / FIRST, second_mass(integration, m)] for m in found.motions])
    rows: list[list[Any]] = [["return map", len(points), 1e3 * took / len(points), points[:, 1].max(), 0.0, 0.0]]
    for order in (15, args.order):
        begun = time.perf_counter()
        curve = HarmonicBalance(order).curve()
        each, apart = 1e3 * (time.perf_counter() - begun) / len(curve), distance(points, curve)
        rows.append([f"harmonic balance, {order}", len(curve), each, curve[:, 1].max(), np.median(apart), apart.max()])
    chosen = [found.motions[k] for k in np.linspace(0, len(points) - 1, CHECKED).astype(int)]
    checks = [(motion, checked(motion)) for motion in chosen]
    losses = [
        (each.loss.name.lower(), each.motion.conditions.frequency / FIRST, second_mass(integration, each.motion),
         each.ends_stability) for each in found.bifurcations
    ]  # fmt: skip
    if args.json:
        stable = [motion.stability_margin > 0.0 for motion in found.motions]
        print(json.dumps({"points": points.tolist(), "stable": stable, "bifurcations": losses, "methods": rows}))
        return 0
    console = Console(width=100, highlight=False)
    _print(console, ["method", "points", "ms a point", "largest q2", "apart, median", "worst"], rows)
    _print(console, ["bifurcation", "W / W1", "q2", "ends stability"], [list(each) for each in losses])
    _print(
        console, ["W / W1", "q2", "largest multiplier", "by scipy", "a period later"],
        [[m.conditions.frequency / FIRST, second_mass(integration, m), m.largest_multiplier, c.largest, c.apart]
         for m, c in checks],
    )  # fmt: skip
    return 0


def _print(console: Console, names: list[str], rows: list[list[Any]]) -> None:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in names:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*(f"{value:.5g}" if isinstance(value, float) else str(value) for value in row))
    console.print(table)
