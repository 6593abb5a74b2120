# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Promises of designs against an integration of its own: structures unlike the thesis's beam, drawn in the stated box.

`python -m studies designs --draws 100 --page docs/research/design_check.md` measures and makes that page. The
integration is that of `damped_structure`; from the design it takes the heights and the intervals.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common import output
from atpid_common.arguments import path_to, whole
from atpid_control.design.check import height_at, interval_at
from atpid_control.design.make import promised
from atpid_control.design.problem import NOMINAL, Deviation, Problem, case, deviation, problem_of
from atpid_control.design.worst_case import Point, response_of
from atpid_sim.outcome import NumericalFailure
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.system import Array
from studies.damped_structure import integrated_bare, linear, motion, physics
from studies.pages import to_write

_STEEL = {"density": 7850.0, "young_modulus": 2.1e11, "restitution": 0.6}
_POLYMER = {"density": 1400.0, "young_modulus": 3e9, "restitution": 0.5}
_THESIS = {"density": 7850.0, "young_modulus": 2.1e8, "restitution": 0.15}


def _mode(mass: float, frequency: float, damping_ratio: float, drive_factor: float) -> dict[str, float]:
    return {"mass": mass, "frequency": frequency, "damping_ratio": damping_ratio, "drive_factor": drive_factor}


#: Name: (options of the design, mass fraction of the grain).
STRUCTURES: dict[str, tuple[dict[str, Any], float]] = {
    "0.1 kg, 50 Hz, horizontal, polymer": (
        {"mass": 0.1, "frequency": 50.0, "damping": 0.01, "amplitudes": (5e-5, 2e-4), "gravity": 0.0,
         "uncertainty": {"height": 1e-4}, **_POLYMER}, 0.1,
    ),
    "pump bracket, machine at 31 Hz, polymer": (
        {"mass": 0.45, "frequency": 31.0, "damping": 0.008, "amplitudes": (1.5e-4, 6e-4), "gravity": 0.0,
         "excitation_frequency": (31.0, 31.0), "uncertainty": {"height": 1e-4}, **_POLYMER}, 0.1,
    ),
    "1.5 kg, 18 Hz, steel": (
        {"mass": 1.5, "frequency": 18.0, "damping": 0.015, "amplitudes": (8e-4, 2e-3), **_STEEL}, 0.15,
    ),
    "6 kg, 12 Hz, machine drifts 11 to 12 Hz": (
        {"mass": 6.0, "frequency": 12.0, "damping": 0.02, "amplitudes": (1e-3, 3e-3),
         "excitation_frequency": (11.0, 12.0), **_THESIS}, 0.12,
    ),
    "floor plate, machine drifts 6.8 to 7.6 Hz": (
        {"mass": 38.0, "frequency": 7.2, "damping": 0.012, "amplitudes": (1.5e-3, 4e-3),
         "excitation_frequency": (6.8, 7.6), **_THESIS}, 0.15,
    ),
    "60 kg, 2.2 Hz, steel": (
        {"mass": 60.0, "frequency": 2.2, "damping": 0.01, "amplitudes": (6e-3, 1.2e-2), **_STEEL}, 0.1,
    ),
    "60 kg, 2.2 Hz, horizontal, machine at 2.1 Hz, polymer": (
        {"mass": 60.0, "frequency": 2.2, "damping": 0.01, "amplitudes": (4e-3, 1.2e-2), "gravity": 0.0,
         "excitation_frequency": (2.1, 2.1), **_POLYMER}, 0.1,
    ),
    "10 g, 120 and 640 Hz, force, horizontal, polymer": (
        {"mass": 0.01, "frequency": 120.0, "damping": 0.01, "amplitudes": (0.02, 0.06), "gravity": 0.0,
         "uncertainty": {"height": 2e-5}, "drive": "force",
         "further_modes": [_mode(0.03, 640.0, 0.01, -0.6)], **_POLYMER}, 0.1,
    ),
    "0.5 kg, 40 and 190 Hz, force, horizontal, polymer": (
        {"mass": 0.5, "frequency": 40.0, "damping": 0.01, "amplitudes": (1.0, 4.0), "gravity": 0.0,
         "uncertainty": {"height": 1e-4}, "drive": "force",
         "further_modes": [_mode(2.0, 190.0, 0.015, 0.4)], **_POLYMER}, 0.1,
    ),
    "2 kg, 15 and 60 Hz, force": (
        {"mass": 2.0, "frequency": 15.0, "damping": 0.02, "amplitudes": (10.0, 30.0), "drive": "force",
         "further_modes": [_mode(6.0, 60.0, 0.02, -0.5)], **_THESIS}, 0.15,
    ),
    "8 kg, 25 and 80 Hz, force, machine at 24 Hz, steel": (
        {"mass": 8.0, "frequency": 25.0, "damping": 0.01, "amplitudes": (15.0, 50.0), "drive": "force",
         "excitation_frequency": (24.0, 24.0), "further_modes": [_mode(20.0, 80.0, 0.02, -0.8)], **_STEEL}, 0.1,
    ),
    "40 kg, 8 and 21 Hz, force, machine drifts 7.2 to 7.7 Hz": (
        {"mass": 40.0, "frequency": 8.0, "damping": 0.02, "amplitudes": (60.0, 180.0), "drive": "force",
         "excitation_frequency": (7.2, 7.7), "further_modes": [_mode(90.0, 21.0, 0.03, 0.7)], **_THESIS}, 0.12,
    ),
    "100 kg, 3 and 11 Hz, force, horizontal, polymer": (
        {"mass": 100.0, "frequency": 3.0, "damping": 0.015, "amplitudes": (60.0, 150.0), "gravity": 0.0,
         "drive": "force", "further_modes": [_mode(250.0, 11.0, 0.02, -0.4)], **_POLYMER}, 0.1,
    ),
    "1 kg, 20, 90 and 260 Hz, support": (
        {"mass": 1.0, "frequency": 20.0, "damping": 0.015, "amplitudes": (4e-4, 1.2e-3),
         "further_modes": [_mode(4.0, 90.0, 0.02, -0.25), _mode(9.0, 260.0, 0.02, 0.1)], **_THESIS}, 0.15,
    ),
}  # fmt: skip
#: Systems of the second table, and the seed.
SYSTEMS, _SEED = 100, 2026
EXAMPLE = "--draws 10"


@dataclass(frozen=True)
class Kept:
    """How a promise was kept."""

    name: str
    promise: tuple[float, float, float, float]  # least and largest reduction, least and largest efficiency [-]
    draws: int
    kept: int
    excess: float  # farthest beyond, of reduction or efficiency [-]
    nominal: float  # farthest of the given structure's force from what is expected, where regular, relative [-]
    force: float  # largest force of a draw over that stated [-]
    floor: float


def check(name: str, draws: int, seed: int, points_made: int = 7) -> Kept:
    """Return how the promise of a structure, made at so many amplitudes, is kept by others drawn in its box."""
    options, fraction = STRUCTURES[name]
    problem = problem_of(**options)
    _, points, _ = promised(problem, fraction, amplitudes=points_made)
    random = np.random.default_rng(seed)
    jobs, count = [], problem.quantities
    for number in range(draws):
        amplitude = float(np.exp(random.uniform(*np.log(problem.amplitudes))))
        box = random.choice([-1.0, 1.0], count) if number % 3 == 0 else random.uniform(-1.0, 1.0, count)
        limits = problem.excitation_frequency
        frequency = None if limits is None else float(random.uniform(*limits))
        opening = float(random.uniform()), float(random.choice([1e-6, 0.2, 1.0]))
        jobs.append((amplitude, deviation(problem, box), frequency, opening))

    def beyond(job: tuple[float, Deviation, float | None, tuple[float, float]]) -> tuple[float, float, float]:
        amplitude, off, frequency, opening = job
        p = physics(problem, fraction, amplitude, off, frequency)
        found = motion(p, max(height_at(points, amplitude) + off.height, p.diameter), *opening)
        shares = {
            "efficiency": 1.0 - found.amplitude / linear(p, p.grain),
            "reduction": 1.0 - found.amplitude / linear(p, 0.0),
        }
        out = [max(interval_at(points, amplitude, key).low - v, v - interval_at(points, amplitude, key).high)
               for key, v in shares.items()]  # fmt: skip
        bears = [float(np.interp(amplitude, [o.amplitude for o in points], values)) for values in _stated(points)]
        return max(out), found.ceiling / bears[0], found.floor / bears[1]

    results = [result for _, result in on_all_cores(beyond, jobs)]
    excess = np.array([one[0] for one in results])
    at = [None if problem.excitation_frequency is None else one.frequency for one in points]
    off = [_force_off(problem, fraction, one, f) for one, f in zip(points, at, strict=True)]
    return Kept(
        name,
        (min(o.reduction.low for o in points), max(o.reduction.high for o in points),
         min(o.efficiency.low for o in points), max(o.efficiency.high for o in points)),
        draws, int((excess <= 0.0).sum()), float(excess.max()),
        max((one for one in off if not math.isnan(one)), default=math.nan),
        max(one[1] for one in results), max(one[2] for one in results),
    )  # fmt: skip


def _force_off(problem: Problem, fraction: float, one: Point, frequency: float | None) -> float:
    """Return how far the force on the ceiling is from the expected one [-]; NaN: the given structure is irregular."""
    given = motion(physics(problem, fraction, one.amplitude, NOMINAL, frequency), one.height)
    regular = response_of(case(problem, fraction, frequency=frequency), one.amplitude, one.height).regular
    expected = one.ceiling_force.expected
    if not (regular and given.regular) or expected == given.ceiling == 0.0:
        return math.nan
    return abs(given.ceiling / expected - 1.0) if expected > 0.0 else math.inf


def _stated(points: list[Point]) -> tuple[list[float], list[float]]:
    return [one.ceiling_force.high for one in points], [one.floor_force for one in points]


@dataclass(frozen=True)
class Compared:
    """Reductions of random structures by the packages and by the integration of this study."""

    systems: int
    failed: int  # refused by the packages
    regular: int  # by both
    difference: Array  # of the regular ones [-]
    bare: float  # farthest of the amplitude without a damper, integrated, from the closed form, relative [-]


def compare(systems: int, seed: int, modal: bool = False) -> Compared:
    """Return reductions of random structures at random frequencies and heights; modal: of two or three modes, each
    second one under a force.
    """
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    jobs = []
    for number in range(systems):
        natural, fraction = between(2.0, 50.0), between(0.03, 0.3)
        material = (_STEEL, _POLYMER, _THESIS)[number % 3]
        gravity = (0.0, 9.81)[number % 2]
        damping = between(0.003, 0.03)
        closed = natural * math.sqrt(1.0 - fraction)
        # the closed damper moves with 5 to 30 g, as without gravity
        moves = between(5.0, 30.0) * 9.81 / (2.0 * math.pi * closed) ** 2
        support = max(2.0 * damping * math.sqrt(1.0 - fraction) * moves, 2e-6)
        mass = between(0.1, 60.0)
        more: dict[str, Any] = {}
        if modal:
            more["drive"] = ("support", "force")[number // 2 % 2]
            more["further_modes"] = [
                _mode(mass * between(0.5, 10.0), natural * between(1.5, 15.0), between(0.005, 0.03),
                      random.uniform(-0.6, 0.6))
                for _ in range(1 + number % 2)
            ]  # fmt: skip
            if more["drive"] == "force":
                support *= mass * (2.0 * math.pi * natural) ** 2
        problem = problem_of(
            mass=mass, frequency=natural, damping=damping, amplitudes=(support, 1.01 * support), gravity=gravity,
            **material, **more,
        )  # fmt: skip
        jobs.append((problem, fraction, support, closed * random.uniform(0.9, 1.12), float(random.uniform(0.35, 0.75))))

    def both(job: tuple[Problem, float, float, float, float]) -> tuple[float, bool, float] | None:
        problem, fraction, support, frequency, share = job
        one = case(problem, fraction, frequency=frequency)
        height = one.damper.diameter + share * one.damper.ballistic_clearance(support)
        try:
            theirs = response_of(one, support, height)
        except NumericalFailure:
            return None
        p = physics(problem, fraction, support, NOMINAL, frequency)
        mine, bare = motion(p, height), integrated_bare(p)
        regular = theirs.regular and mine.regular
        return abs(theirs.reduction - (1.0 - mine.amplitude / bare)), regular, bare / theirs.bare - 1.0

    found = [result for _, result in on_all_cores(both, jobs)]
    done = [one for one in found if one is not None]
    difference = np.array([one[0] for one in done if one[1]])
    return Compared(systems, len(found) - len(done), len(difference), difference, max(abs(one[2]) for one in done))


def tables(kept: list[Kept], compared: Sequence[Compared], seed: int) -> str:
    """Return the table of promises, and what the comparisons of one mode and of several show, as Markdown."""
    rows = [
        f"| {one.name} | {100 * one.promise[0]:.0f} to {100 * one.promise[1]:.0f} % | {100 * one.promise[2]:.0f} to "
        f"{100 * one.promise[3]:.0f} % | {one.kept} of {one.draws} | {100 * max(one.excess, 0.0):.2f} | "
        f"{'none regular' if math.isnan(one.nominal) else f'{100 * one.nominal:.1f} %'} | {one.force:.2f} | "
        f"{one.floor:.2f} |"
        for one in kept
    ]
    return "\n".join([
        "| structure | reduction promised | efficiency promised | kept | farthest beyond [points] | force, given "
        "structure | ceiling, drawn / stated | floor, drawn / stated |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
        *(f"\n{_compared(one, words, seed)}" for one, words in zip(
            compared, ("", "of two or three modes, half of them under a force, "), strict=True,
        )),
    ])  # fmt: skip


def _compared(one: Compared, words: str, seed: int) -> str:
    worst, within = float(one.difference.max()), int((one.difference <= 0.01).sum())
    return (
        f"Of {one.systems} random structures {words}at random frequencies and heights (seed {seed}) {one.failed} "
        f"are refused and {one.regular} move regularly in both integrations; the reduction of {within} of these "
        f"agrees within one point, the median within {100 * float(np.median(one.difference)):.3f}, the farthest "
        f"within {100 * worst:.2f}. The amplitude without a damper, integrated, agrees with the closed form to "
        f"{one.bare:.0e}."
    )


_PAGE = """# Promises of designs, checked

Made by `python -m studies designs`; do not edit. Structures unlike the thesis's beam are designed for
as [a damper for your own structure](../design.md) describes, with the mass of the grain given, at
{points} amplitudes. Then structures are drawn in the stated box of uncertainties, and frequencies
in the stated range, and run by an integration that shares nothing with the packages.

    python -m studies designs --draws {draws} --seed {seed} --points {points} --page docs/research/design_check.md

Kept: reduction *and* efficiency lie inside their intervals. Force, given structure: how far the
largest force on the ceiling is from the expected one, at the worst of the amplitudes at which it
moves regularly. Drawn / stated: the largest force of all draws over that which ceiling or floor is
said to bear.

{text}
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    parser.add_argument("--draws", type=whole(1, 10_000), default=100, metavar="N", help="a structure; default 100")
    parser.add_argument("--seed", type=whole(0, 2**32 - 1), default=_SEED, metavar="S", help=f"default {_SEED}")
    parser.add_argument("--points", type=whole(2, 20), default=7, metavar="N", help="amplitudes; default 7")
    parser.add_argument("--page", type=path_to(".md"), metavar="FILE.md", help="write the page of the documentation")


def run(args: argparse.Namespace) -> int:
    """Check, print the tables, write the page; return 0. Raises NumericalFailure and OutputError."""
    compared = [compare(SYSTEMS, args.seed, modal) for modal in (False, True)]
    text = tables([check(name, args.draws, args.seed, args.points) for name in STRUCTURES], compared, args.seed)
    print(text)
    if args.page is not None:
        page: Path = to_write(args.page)
        with output.writing(page, "--page"):
            page.write_text(
                _PAGE.format(draws=args.draws, seed=args.seed, points=args.points, text=text), encoding="utf-8"
            )
    return 0
