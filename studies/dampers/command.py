# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies dampers`: several dampers against two references, outcomes of wild scenes, and cells for one mass.

Random structures of 1 to 4 modes with 2 to 5 grains run once more by `naive`: with impacts that scipy finds, and with
stiff linear contacts in place of impacts, which is what the level `impact` leaves out.
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from atpid_common.arguments import whole
from atpid_sim.kernel_inputs import dampers_of
from atpid_sim.outcome import Outcome
from atpid_sim.scene import Scene, SceneError, standard_bench
from atpid_sim.simulation.integration import SUPPORT, Integration, Observation, amplitude_without_damper
from atpid_sim.simulation.quantities import efficiency, half_peak_to_peak
from atpid_sim.system import Array
from studies.dampers.naive import with_contacts, with_impacts
from studies.modal import further_modes, table

#: Arguments of the example in the help.
EXAMPLE = "--systems 40 --wild 3000 --seed 7"
#: Relative change of the drive, and of the amplitude up to which it is reproducible.
_DISTURBANCE, _REPRODUCIBLE = 1e-6, 1e-4
#: Stiffness of the reference's contacts [N/m], and its step [s].
_STIFFNESS, _STEP = 1e8, 5e-7
#: Steps that a wild scene may take.
_STEPS = 100_000
#: Samples a second of the amplitude found by scipy.
_RATE = 4000.0
#: Cells of one mass, scatters of their start, amplitudes of the support [m], heights [m] and spreads of heights.
_CELLS, _SCATTERS = (1, 2, 3, 5, 10, 20), (1e-3, 1.7e-3, 3e-3)
_AMPLITUDE, _AMPLITUDES = 0.01, (0.006, 0.01, 0.014)
_HEIGHTS, _SPREADS = np.arange(0.06, 0.42, 0.01), (0.0, 0.02, 0.2, 0.5, 0.8)


@dataclass(frozen=True)
class Compared:
    """One random structure, by the engine and by the references."""

    modes: int
    grains: int
    drive: str
    impacts: int
    by_impacts: float  # difference of the amplitude from scipy's, relative; NaN where its bounces do not end [-]
    impacts_spread: float  # of the amplitude where the drive changes, relative [-]
    by_contacts: float  # difference from the amplitude with stiff linear contacts [-]
    contacts_spread: float  # of these, the larger one [-]
    residual: float  # of the ledgers [-]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--systems", type=whole(0, 10_000), default=40, help="random structures beside references")
    parser.add_argument("--wild", type=whole(0, 1_000_000), default=3000, help="scenes far outside the usual range")
    parser.add_argument("--cells", action="store_true", help="also the table of one mass in several cells")
    parser.add_argument("--seed", type=whole(0, 2**31), default=7, help="seed of what is drawn")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")


def run(args: argparse.Namespace) -> int:
    """Compare, count outcomes, and divide a mass into cells."""
    rng = np.random.default_rng(args.seed)
    compared = [compare(drawn(rng)) for _ in range(args.systems)]
    outcomes = Counter(outcome(wild(rng)) for _ in range(args.wild))
    cells = [divided(count) for count in _CELLS] if args.cells else []
    if args.json:
        print(json.dumps({"compared": [asdict(one) for one in compared], "outcomes": outcomes, "cells": cells}))
        return 0
    console = Console(width=100, highlight=False)
    if compared:
        console.print(
            table("structures with several dampers", ["", "impacts by scipy", "stiff contacts"], _rows(compared))
        )
    if outcomes:
        console.print(
            table(
                "wild scenes", ["outcome of a wild scene", ""], [[name, str(n)] for name, n in outcomes.most_common()]
            )
        )
    if cells:
        names = [
            "cells",
            *(f"{what} [{unit}]" for what in ("equal:", "made:", "wide:") for unit in ("m", "-", "red.")),
        ]
        rows = [[f"{each:.3g}" for each in row.values()] for row in cells]
        console.print(table("one mass in several cells: height, spread, reduction", names, rows))
    return 0


def drawn(rng: np.random.Generator) -> Scene:
    """Return a random scene of 2 s: 1 to 4 modes, 2 to 5 grains, support or force, ceilings closed, low or high."""
    drive = str(rng.choice(["support", "force"]))
    further = further_modes(rng, int(rng.integers(0, 4)), 10.0)
    dampers = [
        {
            "mass_fraction": float(10.0 ** rng.uniform(-2.0, -0.8)), "height": _height(rng),
            "shapes": [float(rng.choice([1.0, rng.uniform(-1.5, 1.5)])) for _ in range(1 + len(further))],
        }
        for _ in range(rng.integers(1, 5))
    ]  # fmt: skip
    return standard_bench(
        further_modes=further, further_dampers=dampers, drive=drive, duration=2.0, steady_window=[1.2, 2.0],
        gravity=float(rng.choice([0.0, 9.81])), ceiling={"height": _height(rng)},
        excitation={
            "amplitude": float(rng.uniform(0.01, 0.04) if drive == "support" else rng.uniform(1.0, 6.0)),
            "frequency": float(rng.uniform(3.5, 7.0)),
        },
        grain={"mass_fraction": float(10.0 ** rng.uniform(-2.0, -0.8)), "radius": 0.0085},
        contact={"law": "linear", "stiffness": _STIFFNESS, "restitution": float(rng.uniform(0.1, 0.8))},
    )  # fmt: skip


def _height(rng: np.random.Generator) -> float:
    kind = rng.choice(["closed", "low", "high", "high"])
    return {"closed": 0.017, "low": float(rng.uniform(0.0175, 0.04)), "high": float(rng.uniform(0.05, 0.3))}[str(kind)]


def compare(scene: Scene) -> Compared:
    """Return what the engine and the references make of a scene with linear contacts, and of one with impacts."""
    e: float = scene.contact.restitution  # type: ignore[attr-defined]
    begin, end = scene.steady_window
    of_impacts, of_contacts = _twice(scene.with_(contact={"law": "impact", "restitution": e})), _twice(scene)
    times = np.arange(begin, end, 1.0 / _RATE)
    found = with_impacts(scene, e, times)
    damping = dampers_of(scene).parameters[:, 1]
    contacts = [
        half_peak_to_peak(with_contacts(scene, _STIFFNESS, damping, _STEP, by)[round(begin / _STEP) :])
        for by in (0.0, _DISTURBANCE)
    ]
    by_impacts = math.nan if found is None else half_peak_to_peak(found)
    return Compared(
        1 + len(scene.further_modes), len(scene.dampers), scene.drive, of_impacts.impacts,
        abs(of_impacts.amplitude / by_impacts - 1.0), of_impacts.spread,
        abs(of_contacts.amplitude / contacts[0] - 1.0), max(of_contacts.spread, abs(contacts[1] / contacts[0] - 1.0)),
        max(of_impacts.residual, of_contacts.residual),
    )  # fmt: skip


class _Run(NamedTuple):
    """A run of the engine."""

    amplitude: float  # in the steady window [m]
    spread: float  # of it where the drive changes, relative [-]
    impacts: int
    residual: float  # of the ledger [-]


def _twice(scene: Scene) -> _Run:
    integration = Integration(scene, "impact")
    tables = [integration.table, integration.table.copy()]
    tables[1][:, SUPPORT] *= 1.0 + _DISTURBANCE
    run, disturbed = (integration.run(Observation(scene.steady_window), table=table) for table in tables)
    amplitude, impacts = run.last.amplitude, run.last.floor_impacts + run.last.ceiling_impacts
    return _Run(amplitude, abs(disturbed.last.amplitude / amplitude - 1.0), impacts, abs(run.ledger.residual))


def wild(rng: np.random.Generator) -> Scene:
    """Return a random scene of a few periods whose numbers are spread over decades."""

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(low, high))

    mass, radius, frequency = decades(-3.0, 1.5), decades(-3.5, -1.0), decades(-1.0, 2.0)
    laws: list[dict[str, Any]] = [
        {"law": "impact", "restitution": float(rng.choice([0.0, 1.0, rng.uniform(0.0, 1.0)]))},
        {"law": "tsuji", "young_modulus": decades(5.0, 11.5), "poisson_ratio": 0.3,
         "damping_ratio": decades(-2.0, 0.0)},
        {"law": "linear", "stiffness": decades(2.0, 9.0), "restitution": float(rng.uniform(0.01, 1.0))},
    ]  # fmt: skip
    further = [
        {"mass": mass * decades(-1.5, 1.5), "frequency": frequency * decades(-1.0, 1.5),
         "damping_ratio": float(rng.choice([0.0, decades(-3.0, 1.0)])), "drive_factor": float(rng.normal())}
        for _ in range(rng.integers(0, 4))
    ]  # fmt: skip
    size = float(rng.choice([0.0, decades(-6.0, 0.0)]))

    def height() -> float:
        return 2.0 * radius + float(rng.choice([0.0, radius * decades(-7.0, 2.0), size * decades(-1.0, 1.5)]))

    dampers = [
        {"mass_fraction": decades(-5.0, -0.01), "height": height(), "count": int(rng.choice([1, 1, 1, 4])),
         "shapes": [float(rng.choice([0.0, 1.0, rng.normal()])) for _ in range(1 + len(further))]}
        for _ in range(rng.integers(1, 5))
    ]  # fmt: skip
    start, end = rng.uniform(0.0, 5.0 / frequency, 2)
    ceiling: dict[str, float] = {"height": height()}
    if rng.random() < 0.3:
        low, high = sorted((height(), height() + radius))
        ceiling = {"closed": low, "open": high, "start": float(min(start, end)), "end": float(max(start, end) + 1e-3)}
    duration = 10.0 / frequency
    try:
        return standard_bench(
            beam={"mass": mass, "frequency": frequency, "damping_ratio": float(rng.choice([0.0, decades(-3.0, 1.0)]))},
            further_modes=further, further_dampers=dampers, drive=str(rng.choice(["support", "force"])),
            ceiling=ceiling,
            grain={"mass_fraction": decades(-5.0, -0.01), "radius": radius}, contact=laws[rng.integers(0, 3)],
            gravity=float(rng.choice([0.0, 9.81, decades(-2.0, 3.0)])), duration=duration,
            steady_window=[0.5 * duration, duration],
            excitation={"amplitude": size, "frequency": "resonance" if rng.random() < 0.3 else
                        frequency * decades(-1.0, 1.0)},
        )  # fmt: skip
    except SceneError:  # beyond what a scene allows
        return wild(rng)


def outcome(scene: Scene) -> str:
    """Return how the run of a scene ends, and whether its ledger closes."""
    integration = Integration(scene, "impact")
    state = integration.initial_state()
    first = state.copy()
    ended = integration.advance(state, integration.table, Observation(scene.steady_window), _STEPS)
    if ended != Outcome.DONE:
        return ended.name
    residual = abs(integration.ledger(first, state, integration.table).residual)
    return "DONE" if residual <= 1e-6 else "DONE, ledger open by more than 1e-6"


def divided(count: int) -> dict[str, float]:
    """Return the best reductions of a tenth of all mass in so many cells, with their heights and spreads of heights.

    With equal heights, where grains that start alike move as one; with heights as alike as they are made; and the worst
    of several excitation amplitudes, at any spread.
    """
    heights = [(float(height), spread) for spread in _SPREADS[: None if count > 1 else 1] for height in _HEIGHTS]
    alone = {one: _reduction(count, *one, _SCATTERS, (_AMPLITUDE,)) for one in heights if one[1] <= _SPREADS[1]}
    wide = {one: _reduction(count, *one, _SCATTERS[:1], _AMPLITUDES) for one in heights}
    made = {one: value for one, value in alone.items() if one[1] > 0.0 or count == 1}
    found: dict[str, float] = {"cells": count}
    for name, trials in (
        ("equal", {one: alone[one] for one in alone if one[1] == 0.0}),
        ("made", made),
        ("wide", wide),
    ):
        best = max(trials, key=trials.__getitem__)
        found |= {f"{name}_height": best[0], f"{name}_spread": best[1], name: trials[best]}
    return found


def _reduction(
    count: int, height: float, spread: float, scatters: Sequence[float], amplitudes: Sequence[float]
) -> float:
    """Return the reduction [-] at the resonance without damper, the worst of some starts and amplitudes [m]."""
    mass = 0.3258
    each = mass / 9.0 / count
    own = {"mass_fraction": each / (each + mass)}
    heights = height * (1.0 + spread * np.linspace(-0.5, 0.5, count)) if count > 1 else np.array([height])
    worst = 1.0
    for amplitude in amplitudes:
        scene = standard_bench(
            grain=own | {"radius": 0.0085}, gravity=0.0, duration=24.0, steady_window=[16.0, 24.0],
            contact={"law": "impact", "restitution": 0.5}, ceiling={"height": float(heights[0])},
            further_dampers=[own | {"height": float(each)} for each in heights[1:]],
            excitation={"amplitude": amplitude, "frequency": math.sqrt(427.6 / mass) / (2.0 * math.pi)},
        )  # fmt: skip
        integration, bare = Integration(scene, "impact"), amplitude_without_damper(scene)
        for by in scatters:
            run = integration.run(Observation(scene.steady_window), disturbance=by)
            worst = min(worst, efficiency(run.last.amplitude, bare))
    return worst


def _rows(compared: list[Compared]) -> list[list[str]]:
    def column(apart: Array, spread: Array) -> list[str]:
        same = apart[np.isfinite(apart) & (spread <= _REPRODUCIBLE)]
        return [
            f"{len(apart)}", f"{np.sum(~np.isfinite(apart))}", f"{len(same)}", f"{np.sum(same <= 2e-3)}",
            f"{np.median(same):.1e}, {same.max():.1e}",
        ]  # fmt: skip

    names = ["structures", "not ended by the reference", "others whose amplitude is reproducible",
             "of these within 0.2 %", "difference, median and worst"]  # fmt: skip
    impacts, contacts = (
        column(np.array([getattr(one, f"by_{name}") for one in compared]),
               np.array([getattr(one, f"{name}_spread") for one in compared]))
        for name in ("impacts", "contacts")
    )  # fmt: skip
    common = [
        ["impacts, median", f"{np.median([one.impacts for one in compared]):.0f}", ""],
        ["ledger, worst", f"{max(one.residual for one in compared):.1e}", ""],
    ]
    return [*(list(row) for row in zip(names, impacts, contacts, strict=True)), *common]
