# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies modes`: random structures of several modes against scipy, and what a mode costs.

The equations of motion are written down once more, with Tsuji's force (Eqs 3.12 and 3.24), and integrated by scipy's
DOP853 without any event, so that the two share the scene's numbers and the contact's two parameters only.
"""

import argparse
import json
import math
import time
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp

from atpid_common.arguments import whole
from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import contact_of
from atpid_sim.modal import ModeSet
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.energy import relative_residual
from atpid_sim.simulation.integration import Integration, Observation
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.system import Array

#: Arguments of the example in the help.
EXAMPLE = "--systems 40 --seed 7"
#: Runs of the cost's table, of which the fastest counts, and the modes in its rows.
REPEATS, _COUNTS = 7, (1, 2, 4, 8)
#: Relative change of the start, and of the amplitude up to which it is reproducible.
_DISTURBANCE, _REPRODUCIBLE = 1e-6, 5e-4
#: Relative tolerance and longest step [s] of scipy's run; samples a second of its amplitude.
_RTOL, LONGEST, _RATE = 1e-11, 5e-5, 4000.0


class Structure(NamedTuple):
    """The scene's numbers."""

    mass: Array  # (modes,) each
    stiffness: Array
    damping: Array
    direct: Array
    rate: Array
    grain: float
    clearance: float
    gravity: float
    omega: float
    size: float

    @classmethod
    def of(cls, scene: Scene) -> "Structure":
        """Return those of a scene with a constant tone and a fixed ceiling."""
        modes = [scene.beam, *scene.further_modes]
        mass, stiffness, damping = (
            np.array([getattr(mode, name) for mode in modes]) for name in ("mass", "stiffness", "damping")
        )
        factors = np.array([1.0, *(mode.drive_factor for mode in scene.further_modes)])
        direct, rate = factors, 0.0 * factors
        if scene.drive == "support":
            factors[0] -= factors[1:].sum()
            direct, rate = factors * stiffness, factors * damping
        fraction, clearance = scene.grain.mass_fraction, scene.ceiling.heights[0][1] - 2.0 * scene.grain.radius
        return cls(
            mass,
            stiffness,
            damping,
            direct,
            rate,
            scene.beam.mass * fraction / (1.0 - fraction),
            clearance,
            scene.gravity,
            2.0 * math.pi * scene.frequency_hz,
            scene.excitation.amplitude_points[0][1],
        )

    def start(self) -> Array:
        """Return the state at rest: modes, their rates, the grain and its velocity."""
        weight = np.full(len(self.mass), self.grain * self.gravity)
        weight[0] += self.mass[0] * self.gravity
        q = -weight / self.stiffness
        return np.concatenate((q, 0.0 * q, [q.sum(), 0.0]))

    def accelerations(self, t: float, q: Array, rate: Array) -> Array:
        """Return those of the modes (modes,) without the grain."""
        u, w = self.size * math.sin(self.omega * t), self.size * self.omega * math.cos(self.omega * t)
        force = self.direct * u + self.rate * w - self.stiffness * q - self.damping * rate
        force[0] -= self.mass[0] * self.gravity
        return np.asarray(force / self.mass)


@dataclass(frozen=True)
class Compared:
    """One random structure, by the engine and by scipy."""

    modes: int
    drive: str
    impacts: int
    amplitude: float  # in the last second of the run [m]
    naive: float  # the same by scipy [m]
    residual: float  # largest of the modes' ledgers [-]
    spread: float  # of the amplitude where start and tolerance change, relative [-]

    @property
    def apart(self) -> float:
        """Difference over the amplitude [-]."""
        return abs(self.amplitude / self.naive - 1.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--systems", type=whole(1, 10_000), default=40, help="random structures")
    parser.add_argument("--seed", type=whole(0, 2**31), default=7, help="seed of what is drawn")
    parser.add_argument("--json", action="store_true", help="print every system as JSON instead of the tables")


def run(args: argparse.Namespace) -> int:
    """Compare random structures, time one of more and more modes, print both."""
    rng = np.random.default_rng(args.seed)
    compared = [compare(drawn(rng)) for _ in range(args.systems)]
    if args.json:
        print(json.dumps([asdict(one) for one in compared]))
        return 0
    console = Console(width=100, highlight=False)
    console.print(table("structures of 2 to 8 modes against scipy", *_rows(compared)))
    console.print(table("cost of a run of 80 s", *_costs()))
    return 0


def further_modes(rng: np.random.Generator, count: int, highest: float) -> list[dict[str, float]]:
    """Return random modes above the first one, up to `highest` times its frequency."""
    return [
        {
            "mass": float(0.3 * 10.0 ** rng.uniform(-0.3, 1.3)), "frequency": float(5.5 * rng.uniform(1.3, highest)),
            "damping_ratio": float(10.0 ** rng.uniform(-2.5, -1.0)), "drive_factor": float(rng.uniform(-0.4, 0.4)),
        }
        for _ in range(count)
    ]  # fmt: skip


def drawn(rng: np.random.Generator) -> Scene:
    """Return a random scene of 3 s: 2 to 8 modes, driven at the support or by a force, below or above resonance."""
    drive = str(rng.choice(["support", "force"]))
    further = further_modes(rng, int(rng.integers(1, 8)), 20.0)
    return standard_bench(
        further_modes=further, drive=drive, duration=3.0, steady_window=[2.0, 3.0], tolerance=1e-7,
        gravity=float(rng.choice([0.0, 9.81])),
        excitation={
            "amplitude": float(rng.uniform(0.01, 0.04) if drive == "support" else rng.uniform(1.0, 6.0)),
            "frequency": float(rng.uniform(3.5, 7.0)),
        },
        ceiling={"height": float(rng.uniform(0.05, 0.3))},
        grain={"mass_fraction": float(rng.uniform(0.03, 0.2)), "radius": 0.0085},
        contact={"law": "tsuji", "young_modulus": float(10.0 ** rng.uniform(6.5, 8.5)), "poisson_ratio": 0.2,
                 "damping_ratio": float(rng.uniform(0.1, 1.0))},
    )  # fmt: skip


def compare(scene: Scene) -> Compared:
    """Return what the engine and scipy make of a scene."""
    integration = Integration(scene, "soft")
    first, last = integration.initial_state(), integration.initial_state()
    integration.advance(last, integration.table, Observation(scene.steady_window))
    modes = scene.modes
    assert modes is not None
    residual = max(map(abs, _mode_residuals(modes.free, first, last)))
    impacts = last.floor_impacts + last.ceiling_impacts
    other = integration.at_level("soft", 0.01 * integration.rtol)
    disturbed = other.initial_state(_DISTURBANCE)
    other.advance(disturbed, other.table, Observation(scene.steady_window))
    spread = abs(disturbed.amplitude / last.amplitude - 1.0)
    naive = naive_amplitude(scene)
    return Compared(len(modes.free.mass), scene.drive, impacts, last.amplitude, naive, residual, spread)


def _mode_residuals(modes: ModeSet, first: State, last: State) -> list[float]:
    """Return what does not add up in each mode's ledger, relative to its flows and its largest energy."""
    begun, ended = (
        state.y[columns.STATE_SIZE :].reshape(-1, columns.MODE_COLUMNS)[: len(modes.mass)] for state in (first, last)
    )
    added = ended - begun
    work, lost, contact = (added[:, k] for k in (columns.Q_INPUT, columns.Q_LOSS, columns.Q_CONTACT))
    stored = _stored_by_mode(modes, ended) - _stored_by_mode(modes, begun)
    sprung = 0.5 * modes.stiffness * np.maximum(begun[:, columns.Q], ended[:, columns.Q]) ** 2
    flows = zip(work.tolist(), lost.tolist(), contact.tolist(), stored.tolist(), sprung.tolist(), strict=True)
    return [
        relative_residual(work, lost, -contact, 0.0, stored, sprung) for work, lost, contact, stored, sprung in flows
    ]


def _stored_by_mode(modes: ModeSet, states: Array) -> Array:
    """Return kinetic, elastic and potential energy of each mode (modes,) [J]."""
    q, rate = states[:, columns.Q], states[:, columns.Q_RATE]
    stored: Array = 0.5 * modes.mass * rate**2 + 0.5 * modes.stiffness * q**2 + modes.mass * modes.gravity * q
    return stored


def naive_amplitude(scene: Scene) -> float:
    """Return the half peak-to-peak of the container in the steady window by scipy [m]."""
    one = Structure.of(scene)
    n, gravity, grain, clearance = len(one.mass), one.gravity, one.grain, one.clearance
    elastic, damped = contact_of(scene).parameters[:2]

    def push(overlap: float, closing: float) -> float:
        return max(0.0, elastic * overlap**1.5 + damped * closing * overlap**0.25) if overlap > 0.0 else 0.0

    def derivative(t: float, z: Array) -> Array:
        q, speed, x, v = z[:n], z[n : 2 * n], z[:n].sum(), z[n : 2 * n].sum()
        force = push(x - z[-2], v - z[-1]) - push(z[-2] - x - clearance, z[-1] - v)
        a = one.accelerations(t, q, speed) - force / one.mass
        return np.concatenate((speed, a, [z[-1], force / grain - gravity]))

    begin, end = scene.steady_window
    motion = solve_ivp(
        derivative, (0.0, end), one.start(), "DOP853",
        np.arange(begin, end, 1.0 / _RATE), rtol=_RTOL, atol=1e-12, max_step=LONGEST,
    )  # fmt: skip
    return half_peak_to_peak(motion.y[:n].sum(axis=0))


def _rows(compared: list[Compared]) -> tuple[list[str], list[list[str]]]:
    same = [one for one in compared if one.spread <= _REPRODUCIBLE]
    apart = np.array([one.apart for one in same])
    rows = [
        ["structures", f"{len(compared)}"],
        ["impacts, median", f"{np.median([one.impacts for one in compared]):.0f}"],
        ["amplitude reproducible", f"{len(same)}"],
        ["of these within 0.2 % of scipy's", f"{np.sum(apart <= 2e-3)}"],
        ["difference, median and worst", f"{np.median(apart):.1e}, {apart.max():.1e}"],
        ["ledger of a mode, worst", f"{max(one.residual for one in compared):.1e}"],
    ]
    return ["", ""], rows


def _costs() -> tuple[list[str], list[list[str]]]:
    further = [
        {"mass": 0.3 * 3.0**k, "frequency": 6.0 * (k + 2) ** 1.2, "damping_ratio": 0.01, "drive_factor": (-0.3) ** k}
        for k in range(1, _COUNTS[-1])
    ]
    rows = []
    for count in _COUNTS:
        scene = standard_bench(duration=80.0, further_modes=further[: count - 1])
        cells: list[Any] = [str(count)]
        for fidelity in ("impact", "soft"):
            integration = Integration(scene, fidelity)
            integration.warm_up()
            times = []
            for _ in range(REPEATS):
                state, begun = integration.initial_state(), time.perf_counter()
                integration.advance(state, integration.table)
                times.append(time.perf_counter() - begun)
            impacts = state.floor_impacts + state.ceiling_impacts
            cells += [f"{1e3 * min(times):.1f}", f"{state.steps}", f"{impacts}"]
        rows.append(cells)
    names = [f"{fidelity}\n{name}" for fidelity in ("impact", "soft") for name in ("[ms]", "steps", "impacts")]
    return ["modes", *names], rows


def table(title: str, names: list[str], rows: list[list[str]]) -> Table:
    """Return a table for the terminal, its first column to the left."""
    made = Table(box=SIMPLE_HEAD, pad_edge=False, title=title, title_justify="left")
    for number, name in enumerate(names):
        made.add_column(name, justify="left" if number == 0 else "right", no_wrap=True)
    for row in rows:
        made.add_row(*row)
    return made
