# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How fast `direct` is and how good: systems held out, each against a fine scan rated the same way, and by a deadline.

`python -m studies selection-speed --page docs/research/selection.md` measures and puts the table into that page.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from atpid_common.arguments import file_path, whole
from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.protocol import Excitation, Selection
from atpid_sim.maps import FROM_CLOSED, Approach, DamperResponse, Timing
from atpid_sim.maps.ratings import REPRODUCIBLE
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.system import Array

#: Range of the support's amplitude [m] and of the mass fraction [-], both evenly in their logarithms; the seed.
_AMPLITUDES, _FRACTIONS, _SEED = (0.002, 0.08), (0.025, 0.3), 2026
#: Clearances of the fine scan, as shares of the ballistic clearance.
_SHARES = np.arange(0.3, 1.2, 0.012)
#: The scan counts an irregular motion, and one that depends on the approach, this many times as large, as the searches
#: do: in a window it shows less than the worst, and of many such heights a scan would choose the luckiest.
_IRREGULAR = 1.15
#: Two more approaches: raised at once, so much later than a whole period [periods].
_LATER = (0.37, 0.71)
#: By which of the ways a height is measured: the worst of all, or one of them.
_MEASURES = {"": slice(None), " (opened at once)": slice(2, 3), " (raised in 1 s)": slice(0, 1)}
#: Time for a selection with a margin [s]: that of selector.yaml.
_DEADLINE = 0.15
#: Standard deviations of the amplitude, and the deviation, where a margin is asked for.
_MARGIN, _DEVIATION = 3.0, 0.01
#: Lines of the page between which the table stands.
_BEGIN, _END = "<!-- made by python -m studies selection-speed -->", "<!-- end -->"
#: Arguments of the example in the help.
EXAMPLE = "--systems 10"


@dataclass(frozen=True)
class Held:
    """A system held out."""

    scene: Scene
    amplitude: float  # of the support [m]


@dataclass(frozen=True)
class Measured:
    """What selections took, and how far above the fine scan's best amplitude they are."""

    wall: Array  # (n,) [s]
    processor: Array  # (n,) all threads [s]
    excess: Array  # (n, measures) relative [-]


def population(count: int, seed: int = _SEED) -> list[Held]:
    """Return `count` systems of the thesis's bench with other grains and amplitudes."""
    rng = np.random.default_rng(seed)
    low, high = np.log(np.array([_AMPLITUDES, _FRACTIONS])).T
    drawn = np.exp(rng.uniform(low, high, (count, 2)))
    return [Held(standard_bench(grain={"mass_fraction": f, "radius": 0.0085}), a) for a, f in drawn.tolist()]


def rated(damper: DamperResponse, amplitude: float, height: float) -> Array:
    """Return amplitude [m] and whether it is irregular (5, 2) at a height [m], once transients are over, by each way.

    A run settles three times as long as the transient of a change of height lasts, and is watched for 30 periods.
    """
    settle = 3.0 * damper.settling()
    approaches: list[Approach] = [*FROM_CLOSED, *map(_later, _LATER)]
    found = []
    for approach in approaches:
        path = approach(damper, height, 0.5 * damper.settling() * damper.period)
        state = damper.closed_state(amplitude)
        response = damper.follow_on(amplitude, state, path, Timing(settle, 30.0))
        found.append((response.amplitude, not response.regular))
    return np.array(found, dtype=float)


def objective(ways: Array) -> tuple[float, float]:
    """Return the objective of a height [m], and the worst amplitude over its approach paths [m].

    ways: (n, 2), see `rated`; the objective is that amplitude, with a surcharge where the motion is irregular.
    """
    sizes = ways[:, 0]
    irregular = ways[:, 1].any() or np.ptp(sizes) > REPRODUCIBLE * sizes.max()
    return sizes.max() * (_IRREGULAR if irregular else 1.0), sizes.max()


def _later(periods: float) -> Approach:
    """Raise the ceiling from half the clearance at once, so much later."""

    def approach(damper: DamperResponse, height: float, rest: float) -> tuple[tuple[float, float], ...]:
        below, begin = 0.5 * (damper.diameter + height), rest + periods * damper.period
        return (0.0, below), (begin, below), (begin + 1e-6, height)

    return approach


def brute_force(held: Held) -> Array:
    """Return the amplitude [m] (measures,) at the height of a fine scan of all that counts least in each measure."""
    damper = DamperResponse(held.scene, 1e-5)
    unit = damper.ballistic_clearance(held.amplitude)
    scan = [rated(damper, held.amplitude, damper.diameter + float(share) * unit) for share in _SHARES]
    return np.array([min(objective(ways[measure]) for ways in scan)[1] for measure in _MEASURES.values()])


def measure(systems: list[Held]) -> Measured:
    """Measure `direct` on each system, one after another, and compare with the fine scan, on all cores."""
    wall, processor, chosen = [], [], []
    for held in systems:
        selector = DirectSelector(held.scene)
        begun, used = time.monotonic(), time.process_time()
        selection = selector.select(Excitation(held.amplitude))
        wall.append(time.monotonic() - begun)
        processor.append(time.process_time() - used)
        chosen.append(selection.height)
    compared = dict(on_all_cores(lambda k: _excess(systems[k], chosen[k]), range(len(systems))))
    return Measured(np.array(wall), np.array(processor), np.array([compared[k] for k in range(len(systems))]))


def _excess(held: Held, height: float) -> Array:
    there = rated(DamperResponse(held.scene, 1e-5), held.amplitude, height)
    return np.array([objective(there[measure])[1] for measure in _MEASURES.values()]) / brute_force(held) - 1.0


def with_margin(systems: list[Held], deadline: float = _DEADLINE) -> tuple[Array, list[Selection]]:
    """Return the time [s] (n,) of a selection with a margin in each system, and the selections."""
    wall, chosen = [], []
    for held in systems:
        selector = DirectSelector(held.scene, deadline=deadline)
        selector.prepare()
        begun = time.monotonic()
        chosen.append(selector.select(Excitation(held.amplitude, _DEVIATION * held.amplitude), _MARGIN))
        wall.append(time.monotonic() - begun)
    return np.array(wall), chosen


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep `count` processes busy meanwhile."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def table(measured: Measured, margin: Array, chosen: list[Selection], loops: int) -> str:
    """Return the table as Markdown."""
    verified = [stage.note for selection in chosen for stage in selection.stages if stage.name == "margin"]
    complete = sum("in 123 of 123" in note for note in verified)
    rows = [
        ("systems held out", f"{len(measured.wall)}"),
        ("`direct`, median", f"{1e3 * np.median(measured.wall):.0f} ms"),
        ("`direct`, worst", f"{1e3 * measured.wall.max():.0f} ms"),
        ("its processor time, median", f"{1e3 * np.median(measured.processor):.0f} ms"),
        ("its processor time, worst", f"{1e3 * measured.processor.max():.0f} ms"),
        (f"with a margin beside {loops} busy loops, median", f"{1e3 * np.median(margin):.0f} ms"),
        (f"with a margin beside {loops} busy loops, worst", f"{1e3 * margin.max():.0f} ms"),
        ("of these within 180 ms", f"{int((margin <= 0.18).sum())}"),
        ("of these verified in all sampled systems", f"{complete}"),
    ]
    for name, excess in zip(_MEASURES, 100.0 * measured.excess.T, strict=True):
        rows += [
            (f"amplitude above the fine scan's best{name}, median", f"{np.median(excess):.2f} %"),
            (f"amplitude above the fine scan's best{name}, worst", f"{excess.max():.2f} %"),
            (f"systems within 2 % of it{name}", f"{int((excess <= 2.0).sum())}"),
        ]
    return "\n".join(["| quantity | value |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)])


def into(page: Path, text: str, begin: str = _BEGIN, end: str = _END) -> None:
    """Put the table between its two lines of a page."""
    given = page.read_text(encoding="utf-8")
    before, rest = given.split(begin)
    page.write_text(f"{before}{begin}\n{text}\n{end}{rest.split(end, 1)[1]}", encoding="utf-8")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    parser.add_argument("--systems", type=whole(1, 10_000), default=100, metavar="N", help="how many; default 100")
    parser.add_argument("--seed", type=whole(0, 2**32 - 1), default=_SEED, metavar="N", help=f"default {_SEED}")
    parser.add_argument("--busy", type=whole(0, 64), default=2, metavar="N", help="loops beside the margin; default 2")
    parser.add_argument("--page", type=file_path, default=None, metavar="FILE", help="page whose table is made anew")


def run(args: argparse.Namespace) -> int:
    """Measure, print, and fill in the page; return 0."""
    systems = population(args.systems, args.seed)
    measured = measure(systems)
    with busy(args.busy):
        margin, chosen = with_margin(systems)
    text = table(measured, margin, chosen, args.busy)
    print(text)
    if args.page is not None:
        into(args.page, text)
    return 0
