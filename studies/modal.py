# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies modes`: random structures of several modes against scipy, and what a mode costs.

The equations of motion are written down once more, with Tsuji's force (Eqs 3.12 and 3.24), and integrated by scipy's
DOP853 without any event, so that the two share the scene's numbers and the contact's two parameters only.
"""

import argparse
import json
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp

from atpid_common.arguments import whole
from atpid_sim.kernel_inputs import contact_of
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.energy import mode_residuals
from atpid_sim.simulation.integration import Integration, Observation
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.system import Array
from studies.dampers.naive import Structure

#: Arguments of the example in the help.
EXAMPLE = "--systems 40 --seed 7"
#: Runs of the cost's table, of which the fastest counts, and the modes in its rows.
REPEATS, _COUNTS = 7, (1, 2, 4, 8)
#: Relative change of the start, and of the amplitude up to which it is reproducible.
_DISTURBANCE, _REPRODUCIBLE = 1e-6, 5e-4
#: Relative tolerance and longest step [s] of scipy's run; samples a second of its amplitude.
_RTOL, LONGEST, _RATE = 1e-11, 5e-5, 4000.0


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
    residual = float(np.abs(mode_residuals(modes.free, first, last)).max())
    impacts = last.floor_impacts + last.ceiling_impacts
    other = integration.at_level("soft", 0.01 * integration.rtol)
    disturbed = other.initial_state(_DISTURBANCE)
    other.advance(disturbed, other.table, Observation(scene.steady_window))
    spread = abs(disturbed.amplitude / last.amplitude - 1.0)
    naive = naive_amplitude(scene)
    return Compared(len(modes.free.mass), scene.drive, impacts, last.amplitude, naive, residual, spread)


def naive_amplitude(scene: Scene) -> float:
    """Return the half peak-to-peak of the container in the steady window by scipy [m]."""
    one = Structure.of(scene)
    n, gravity, grain, clearance = len(one.mass), one.gravity, one.grains[0], one.clearance[0]
    none_held = np.zeros(1, bool)
    elastic, damped = contact_of(scene).parameters[:2]

    def push(overlap: float, closing: float) -> float:
        return max(0.0, elastic * overlap**1.5 + damped * closing * overlap**0.25) if overlap > 0.0 else 0.0

    def derivative(t: float, z: Array) -> Array:
        q, speed, x, v = z[:n], z[n : 2 * n], z[:n].sum(), z[n : 2 * n].sum()
        force = push(x - z[-2], v - z[-1]) - push(z[-2] - x - clearance, z[-1] - v)
        a = one.accelerations(t, q, speed, none_held) - force / one.mass
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
