# SPDX-License-Identifier: Apache-2.0
"""Promises of designs against an integration of its own: structures unlike the thesis's beam, drawn in the stated box.

`python -m studies designs --draws 100 --page docs/design_check.md` measures and makes that page. The integration shares
nothing with the packages: fourth-order Runge and Kutta of both masses and Tsuji's law, a hundred steps in an impact
and, before it, steps that halve the gap. From the design it takes the heights and the intervals.
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from atpid_common import output
from atpid_common.arguments import path_to, whole
from atpid_control.design.check import height_at, interval_at
from atpid_control.design.make import promised
from atpid_control.design.problem import NOMINAL, Deviation, Problem, case, deviation, grain_radius, problem_of
from atpid_control.design.worst_case import Point, response_of
from atpid_sim.kernel import kernel
from atpid_sim.outcome import NumericalFailure
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.system import Array
from studies.pages import to_write

_STEEL = {"density": 7850.0, "young_modulus": 2.1e11, "restitution": 0.6}
_POLYMER = {"density": 1400.0, "young_modulus": 3e9, "restitution": 0.5}
_THESIS = {"density": 7850.0, "young_modulus": 2.1e8, "restitution": 0.15}
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
}  # fmt: skip
#: Systems of the second table, the periods in which an amplitude is taken, and the seed.
_SYSTEMS, _WINDOW, _SEED = 100, 16, 2026
#: Poisson's ratio, as the design states it; steps in an impact and in a period of flight.
_POISSON, _IMPACT_STEPS, _FLIGHT_STEPS = 0.2, 100, 400
#: A motion counts as regular up to this change between periods of the same parity, over the amplitude [-].
_REGULAR = 0.02
EXAMPLE = "--draws 10"


class Physics(NamedTuple):
    """Everything a run needs, plain numbers."""

    structure: float  # [kg]
    grain: float  # [kg]
    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    gravity: float  # [m/s^2]
    diameter: float  # [m]
    contact: float  # k of Tsuji's law [N/m^1.5]
    loss: float  # c of Tsuji's law [N s/m^1.25]
    amplitude: float  # of the support [m]
    omega: float  # [rad/s]


class Motion(NamedTuple):
    """What a run shows in its last `_WINDOW` periods."""

    amplitude: float  # half peak-to-peak [m]
    ceiling: float  # largest force [N]
    floor: float
    regular: bool


@kernel
def _force(overlap: float, rate: float, contact: float, loss: float) -> float:
    if overlap <= 0.0:
        return 0.0
    force: float = max(0.0, contact * overlap**1.5 + loss * rate * overlap**0.25)
    return force


@kernel
def _ceiling(p: Any, t: float, height: float, start: float, travel: float) -> tuple[float, float]:
    if t <= start:
        return p.diameter, 0.0
    if t >= start + travel:
        return height, 0.0
    speed = (height - p.diameter) / travel
    return p.diameter + speed * (t - start), speed


@kernel
def _slope(p: Any, t: float, y: Any, h: float, speed: float) -> Any:
    u, rate = p.amplitude * math.sin(p.omega * t), p.amplitude * p.omega * math.cos(p.omega * t)
    floor = _force(y[0] - y[2], y[1] - y[3], p.contact, p.loss)
    top = _force(p.diameter + y[2] - y[0] - h, y[3] - y[1] - speed, p.contact, p.loss)
    spring = -p.stiffness * (y[0] - u) - p.damping * (y[1] - rate)
    return (
        y[1], (spring - floor + top) / p.structure - p.gravity,
        y[3], (floor - top) / p.grain - p.gravity,
    )  # fmt: skip


@kernel
def _moved(y: Any, k: Any, step: float) -> Any:
    return y[0] + step * k[0], y[1] + step * k[1], y[2] + step * k[2], y[3] + step * k[3]


@kernel
def _run(p: Any, y: Any, height: float, start: float, travel: float, end: float, fine: float, window: int) -> Any:
    """Return least and largest structure displacement in the window, largest forces, strobed displacements."""
    period = 2.0 * math.pi / p.omega
    begin = end - window * period
    coarse, t = period / _FLIGHT_STEPS, 0.0
    low, high, ceiling, floor = 1e300, -1e300, 0.0, 0.0
    strobe = np.zeros(window)
    while t < end:
        h, speed = _ceiling(p, t, height, start, travel)
        below, above = y[2] - y[0], y[0] + h - p.diameter - y[2]
        gap = min(below, above)
        closing = abs(y[1] - y[3]) + speed + (p.gravity + 4.0 * p.omega**2 * (abs(y[0]) + p.amplitude)) * fine
        step = min(max(0.5 * gap / closing, fine), coarse)
        k1 = _slope(p, t, y, h, speed)
        h2, s2 = _ceiling(p, t + 0.5 * step, height, start, travel)
        k2 = _slope(p, t + 0.5 * step, _moved(y, k1, 0.5 * step), h2, s2)
        k3 = _slope(p, t + 0.5 * step, _moved(y, k2, 0.5 * step), h2, s2)
        h4, s4 = _ceiling(p, t + step, height, start, travel)
        k4 = _slope(p, t + step, _moved(y, k3, step), h4, s4)
        mean = (
            (k1[0] + 2.0 * k2[0] + 2.0 * k3[0] + k4[0]) / 6.0, (k1[1] + 2.0 * k2[1] + 2.0 * k3[1] + k4[1]) / 6.0,
            (k1[2] + 2.0 * k2[2] + 2.0 * k3[2] + k4[2]) / 6.0, (k1[3] + 2.0 * k2[3] + 2.0 * k3[3] + k4[3]) / 6.0,
        )  # fmt: skip
        before = y[0]
        y = _moved(y, mean, step)
        t += step
        if t >= begin:
            low, high = min(low, y[0]), max(high, y[0])
            floor = max(floor, _force(y[0] - y[2], y[1] - y[3], p.contact, p.loss))
            ceiling = max(ceiling, _force(p.diameter + y[2] - y[0] - h4, y[3] - y[1] - s4, p.contact, p.loss))
            number = int((t - begin) / period)
            if math.floor((t - step - begin) / period) != number and number < window:
                strobe[number] = y[0] - (y[0] - before) * (t - begin - number * period) / step
    return low, high, ceiling, floor, strobe


@kernel
def _rebound(mass: float, contact: float, loss: float, speed: float) -> tuple[float, float]:
    """Return restitution and duration [s] of one impact of a reduced mass [kg] at a speed [m/s]."""
    step = 2.94 * (1.25 * mass * speed * speed / contact) ** 0.4 / speed / 2000.0
    x, v, t = 1e-12, speed, 0.0
    while True:
        a = -_force(x, v, contact, loss) / mass
        middle, mid_v = x + 0.5 * step * v, v + 0.5 * step * a
        b = -_force(middle, mid_v, contact, loss) / mass
        x, v, t = x + step * mid_v, v + step * b, t + step
        if x <= 0.0 or (v < 0.0 and contact * x**1.5 + loss * v * x**0.25 <= 0.0):
            return -v / speed, t


def physics(problem: Problem, fraction: float, amplitude: float, off: Deviation, frequency: float | None) -> Physics:
    """Return the system of a deviation; amplitude: of the support, as identified [m]; frequency: None is resonance."""
    grain = problem.mass * fraction / (1.0 - fraction)
    structure = problem.mass * (1.0 + off.mass)
    own = 2.0 * math.pi * problem.frequency * (1.0 + off.frequency)
    stiffness = structure * own**2
    radius = grain_radius(problem, fraction)
    effective = problem.young_modulus * (1.0 + off.young_modulus) / (2.0 * (1.0 - _POISSON**2))
    contact = 4.0 / 3.0 * effective * math.sqrt(radius)
    closed = math.sqrt(stiffness / (structure + grain))
    omega = (closed if frequency is None else 2.0 * math.pi * frequency) * (1.0 + off.detuning)
    restitution = min(problem.restitution * (1.0 + off.restitution), 0.99)
    reduced = structure * grain / (structure + grain)
    low, high = 0.0, 20.0 * math.sqrt(contact * reduced)
    for _ in range(60):
        loss = 0.5 * (low + high)
        low, high = (loss, high) if _rebound(reduced, contact, loss, 1.0)[0] > restitution else (low, loss)
    damping = 2.0 * problem.damping * (1.0 + off.damping) * structure * own
    return Physics(
        structure, grain, stiffness, damping, problem.gravity, 2.0 * radius, contact, 0.5 * (low + high),
        amplitude * (1.0 + off.amplitude), omega,
    )  # fmt: skip


def steady(p: Physics, mass: float) -> complex:
    """Return the phasor of one mass [kg] on the spring against the support's sine [m]."""
    drive = complex(p.stiffness, p.damping * p.omega) * p.amplitude
    return drive / complex(p.stiffness - mass * p.omega**2, p.damping * p.omega)


def motion(p: Physics, height: float, phase: float = 0.0, travel: float = 1e-6) -> Motion:
    """Return the motion after the ceiling of the closed damper, in its steady state, has opened to a height [m].

    phase: of the support when it begins to open [periods]; travel: duration [s]. The run lasts twelve time constants.
    """
    both, period = p.structure + p.grain, 2.0 * math.pi / p.omega
    closed, rest = steady(p, both), both * p.gravity / p.stiffness
    x, v = closed.imag - rest, p.omega * closed.real
    reduced = p.structure * p.grain / both
    fine = _rebound(reduced, p.contact, p.loss, p.omega * abs(closed))[1] / _IMPACT_STEPS
    settled = min(max(12.0 * decay(p) / period, 40.0), 500.0) + _WINDOW
    end = (phase + settled) * period + travel
    low, high, ceiling, floor, strobe = _run(p, (x, v, x, v), height, phase * period, travel, end, fine, _WINDOW)
    size = 0.5 * (high - low)
    change = max(float(np.ptp(strobe[parity::2])) for parity in (0, 1)) / size
    return Motion(size, ceiling, floor, change <= _REGULAR)


def decay(p: Physics) -> float:
    """Return the time constant of the closed damper [s]."""
    return 2.0 * (p.structure + p.grain) / p.damping


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
    jobs = []
    for number in range(draws):
        amplitude = float(np.exp(random.uniform(*np.log(problem.amplitudes))))
        box = random.choice([-1.0, 1.0], 8) if number % 3 == 0 else random.uniform(-1.0, 1.0, 8)
        limits = problem.excitation_frequency
        frequency = None if limits is None else float(random.uniform(*limits))
        opening = float(random.uniform()), float(random.choice([1e-6, 0.2, 1.0]))
        jobs.append((amplitude, deviation(problem, box), frequency, opening))

    def beyond(job: tuple[float, Deviation, float | None, tuple[float, float]]) -> tuple[float, float, float]:
        amplitude, off, frequency, opening = job
        p = physics(problem, fraction, amplitude, off, frequency)
        found = motion(p, max(height_at(points, amplitude) + off.height, p.diameter), *opening)
        shares = {
            "efficiency": 1.0 - found.amplitude / abs(steady(p, p.structure + p.grain)),
            "reduction": 1.0 - found.amplitude / abs(steady(p, p.structure)),
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
    return abs(given.ceiling / one.ceiling_force.expected - 1.0) if regular and given.regular else math.nan


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


def compare(systems: int, seed: int) -> Compared:
    """Return reductions of random structures at random frequencies and heights."""
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
        problem = problem_of(
            mass=between(0.1, 60.0), frequency=natural, damping=damping, amplitudes=(support, 1.01 * support),
            gravity=gravity, **material,
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
        mine, bare = motion(p, height), _integrated_bare(p)
        regular = theirs.regular and mine.regular
        return abs(theirs.reduction - (1.0 - mine.amplitude / bare)), regular, bare / theirs.bare - 1.0

    found = [result for _, result in on_all_cores(both, jobs)]
    done = [one for one in found if one is not None]
    difference = np.array([one[0] for one in done if one[1]])
    return Compared(systems, len(found) - len(done), len(difference), difference, max(abs(one[2]) for one in done))


def _integrated_bare(p: Physics) -> float:
    """Return the structure's amplitude without a damper, integrated: a grain of no weight far from both walls."""
    alone = p._replace(grain=1.0, gravity=0.0, diameter=0.0)
    period = 2.0 * math.pi / p.omega
    settled = 30.0 * p.structure / p.damping / period + _WINDOW
    far = 1e3
    low, high, *_ = _run(alone, (0.0, 0.0, far, 0.0), 3.0 * far, -1.0, 1e-6, settled * period, 1e-6 * period, _WINDOW)
    return float(0.5 * (high - low))


def tables(kept: list[Kept], compared: Compared, seed: int) -> str:
    """Return both tables and what they show, as Markdown."""
    rows = [
        f"| {one.name} | {100 * one.promise[0]:.0f} to {100 * one.promise[1]:.0f} % | {100 * one.promise[2]:.0f} to "
        f"{100 * one.promise[3]:.0f} % | {one.kept} of {one.draws} | {100 * max(one.excess, 0.0):.2f} | "
        f"{'none regular' if math.isnan(one.nominal) else f'{100 * one.nominal:.1f} %'} | {one.force:.2f} | "
        f"{one.floor:.2f} |"
        for one in kept
    ]
    worst, within = float(compared.difference.max()), int((compared.difference <= 0.01).sum())
    return "\n".join([
        "| structure | reduction promised | efficiency promised | kept | farthest beyond [points] | force, given "
        "structure | ceiling, drawn / stated | floor, drawn / stated |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
        "",
        f"Of {compared.systems} random structures at random frequencies and heights (seed {seed}) {compared.failed} "
        f"are refused and {compared.regular} move regularly in both integrations; the reduction of {within} of these "
        f"agrees within one point, the median within {100 * float(np.median(compared.difference)):.3f}, the farthest "
        f"within {100 * worst:.2f}. The amplitude without a damper, integrated, agrees with the closed form to "
        f"{compared.bare:.0e}.",
    ])  # fmt: skip


_PAGE = """# Promises of designs, checked

Made by `python -m studies designs`; do not edit. Structures unlike the thesis's beam are designed for
as [a damper for your own structure](design.md) describes, with the mass of the grain given, at
{points} amplitudes. Then structures are drawn in the stated box of uncertainties, and frequencies
in the stated range, and run by an integration that shares nothing with the packages.

    python -m studies designs --draws {draws} --seed {seed} --points {points} --page docs/design_check.md

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
    compared = compare(_SYSTEMS, args.seed)
    text = tables([check(name, args.draws, args.seed, args.points) for name in STRUCTURES], compared, args.seed)
    print(text)
    if args.page is not None:
        page: Path = to_write(args.page)
        with output.writing(page, "--page"):
            page.write_text(
                _PAGE.format(draws=args.draws, seed=args.seed, points=args.points, text=text), encoding="utf-8"
            )
    return 0
