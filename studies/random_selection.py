# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`direct` and its margin on random systems, against brute force and against long runs inside the margin's box.

The draw, the brute force and the judgement of what is regular are of this file: of the code that is measured only the
engine's runs are used. `python -m studies random-selection --page docs/research/selection.md` puts the table there.
"""

import argparse
import json
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from atpid_common.arguments import file_path, whole
from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.protocol import Excitation
from atpid_control.selection.uncertain import MarginBox
from atpid_sim.display import counting
from atpid_sim.engine import columns
from atpid_sim.kernel_inputs import contact_of, restitution_of
from atpid_sim.maps import DamperResponse
from atpid_sim.outcome import NumericalFailure
from atpid_sim.robust import with_beam, with_restitution
from atpid_sim.root import root
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.simulation.integration import Observation, sample_series
from atpid_sim.system import Array
from studies.selection_speed import into

#: Laws drawn; `hertz` loses nothing, so it has no restitution in the range.
LAWS = ("impact", "linear", "lee_herrmann", "kuwabara_kono", "tsuji", "walton_braun")
#: Ranges: restitution [-], damping ratio [-], mass fraction [-], frequency over the natural one [-].
RESTITUTION, DAMPING, FRACTION, RATIO = (0.05, 0.9), (0.002, 0.02), (0.03, 0.2), (0.92, 1.08)
#: Mass of the beam [kg], natural frequency [Hz], acceleration of the closed damper over 9.81 m/s^2 [-].
MASS, FREQUENCY, LIFT = (0.1, 50.0), (2.0, 30.0), (3.0, 60.0)
#: Duration of a contact over the period [-]; radius of the grain over the closed damper's amplitude [-].
CONTACT, RADIUS = (5e-4, 4e-3), (0.1, 0.5)
#: Clearances of the fine scan, as shares of half a period at the closed damper's greatest velocity: coarse, then fine
#: around the best of them, so many.
_SHARES, _AROUND, _FINE = np.geomspace(0.025, 1.6, 170), 6, (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)
#: Heights of the scan that are run on all paths, at most; a single path is worth another while it is less than this.
_CANDIDATES, _WORTH = 24, 1.3
#: An irregular motion counts this many times as large (docs/selection.md): a window shows less than the worst.
_IRREGULAR = 1.15
#: A motion is regular if it repeats within this share of the amplitude after one to four periods.
_REPEATS, _PERIODS = 0.02, 4
#: How long a run settles, in time constants and in periods at least, how long it is watched [periods], and how often:
#: until two windows in a row show the same, since a slow beating passes for a regular motion in one; longer where
#: heights are compared, since irregular transients may last for thousands of periods.
_CONSTANTS, _LEAST, _WATCHED, _WINDOWS, _LONGEST = 10.0, 120.0, 32, 4, 30
#: Paths: start of the opening [periods], its duration [s], and the share of the clearance it starts at.
_PATHS = ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.5), (0.37, 0.0, 0.5), (0.71, 0.0, 0.25))
#: Other paths, on which the heights found are compared: among irregular motions a scan chooses the luckiest.
_FRESH = ((0.19, 0.0, 0.25), (0.53, 0.0, 0.5), (0.83, 1.0, 0.5), (0.0, 1.0, 0.1))
#: Standard deviations of a margin, and the amplitude's half width in the box [-].
_MARGIN, _AMPLITUDE = 3.0, 0.05
#: A least efficiency is printed and resolved to this [-].
_RESOLVED = 2e-3
#: Points of the box: random corners and random ones inside, beside the two ends of each quantity.
_CORNERS, _INSIDE = 8, 8
#: Lines of the page between which the table stands.
_BEGIN, _END = "<!-- made by python -m studies random-selection -->", "<!-- end of random-selection -->"
#: Arguments of the example in the help.
EXAMPLE = "--systems 5 --seed 1"


@dataclass(frozen=True)
class Drawn:
    """A random system."""

    law: str
    restitution: float  # at the speed of the closed damper's beam [-]
    damping_ratio: float  # of beam and grain as one mass [-]
    mass_fraction: float  # [-]
    ratio: float  # frequency over the natural one [-]
    gravity: float  # [m/s^2]
    mass: float  # of the beam [kg]
    natural: float  # frequency of beam and grain as one mass [Hz]
    lift: float  # acceleration of the closed damper over 9.81 m/s^2 [-]
    contact: float  # duration over the period [-]
    radius: float  # over the closed damper's amplitude [-]


@dataclass(frozen=True)
class Seen:
    """What long runs on several paths show at a height."""

    amplitude: float  # largest, half peak-to-peak [m]
    regular: bool  # all of them

    @property
    def objective(self) -> float:
        """The amplitude [m], raised where the motion is irregular."""
        return self.amplitude * (1.0 if self.regular else _IRREGULAR)


@dataclass(frozen=True)
class Outcome:
    """One system measured."""

    drawn: Drawn
    closed: float  # amplitude of the closed damper [m]
    excess: float = math.nan  # of the amplitude at `direct`'s height over that of brute force [-]
    regular: bool = True  # the motion at `direct`'s height
    best_regular: bool = True  # and at brute force's
    share: float = math.nan  # clearance of `direct` over half a period's way at the closed beam's velocity [-]
    best_share: float = math.nan  # and of brute force [-]
    seconds: float = math.nan  # of `direct` [s]
    irregular: int = 0  # points of the box with irregular motion under the margin
    points: int = 0
    announced: bool = False  # the margin says that it holds in no height
    broken: int = 0  # points below the printed least efficiency, where one is printed
    guaranteed: bool = False  # a least efficiency is printed as a bound
    price: float = math.nan  # amplitude under the margin over that of `direct`, everything as expected, less 1 [-]
    margin_seconds: float = math.nan  # [s]
    note: str = ""
    failure: str = ""


def draw(count: int, seed: int) -> list[Drawn]:
    """Return random systems, half of them at resonance, half without gravity."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    found = []
    for k in range(count):
        ratio = float(rng.uniform(*RATIO))
        found.append(
            Drawn(
                law=LAWS[k % len(LAWS)],
                restitution=float(rng.uniform(*RESTITUTION)),
                damping_ratio=log(*DAMPING),
                mass_fraction=log(*FRACTION),
                ratio=1.0 if rng.random() < 0.5 else ratio,
                gravity=0.0 if rng.random() < 0.5 else 9.81,
                mass=log(*MASS),
                natural=log(*FREQUENCY),
                lift=log(*LIFT),
                contact=log(*CONTACT),
                radius=log(*RADIUS),
            )
        )
    return found


def scene_of(one: Drawn) -> Scene:
    """Return the system as a scene; its contact has the drawn restitution and duration at the beam's speed."""
    total = one.mass / (1.0 - one.mass_fraction)
    pace = 2.0 * math.pi * one.natural
    driven = one.ratio * pace
    stiffness, damping = total * pace * pace, 2.0 * one.damping_ratio * total * pace
    closed = one.lift * 9.81 / (driven * driven)
    transfer = abs(complex(stiffness, damping * driven) / complex(stiffness - total * driven**2, damping * driven))
    radius, speed = one.radius * closed, driven * closed
    return scene_from_mapping(
        {
            "beam": {"mass": one.mass, "stiffness": stiffness, "damping": damping},
            "grain": {"mass_fraction": one.mass_fraction, "radius": radius},
            "contact": _contact(one, radius, speed),
            "excitation": {"amplitude": closed / transfer, "frequency": one.ratio * one.natural},
            "ceiling": {"height": 2.0 * radius + closed},
            "gravity": one.gravity,
            "duration": 100.0 / one.natural,
            "tolerance": 1e-6,
        },
        source="random system",
    )


def _contact(one: Drawn, radius: float, speed: float) -> dict[str, object]:
    """Return the contact of a scene with the drawn restitution and duration at a speed [m/s]."""
    if one.law == "impact":
        return {"law": "impact", "restitution": one.restitution}
    reduced = one.mass * one.mass_fraction
    duration = one.contact / (one.ratio * one.natural)
    if one.law in ("linear", "walton_braun"):
        stiffness = reduced * (math.pi / duration) ** 2
        return {"law": one.law, "stiffness": stiffness, "restitution": one.restitution}
    depth = duration * speed / 2.94  # of Hertz's contact
    modulus = 0.75 * 1.25 * reduced * speed**2 / depth**2.5 / math.sqrt(radius) * 2.0 * (1.0 - 0.2**2)
    key, scale = "damping", reduced / duration
    if one.law == "tsuji":
        key, scale = "damping_ratio", 1.0
    elif one.law == "kuwabara_kono":
        scale /= math.sqrt(depth)
    contact: dict[str, object] = {"law": one.law, "young_modulus": modulus, "poisson_ratio": 0.2}

    def excess(log: float) -> float:
        grain = {"mass_fraction": one.mass_fraction, "radius": radius}
        scene = scene_from_mapping(
            {
                "beam": {"mass": one.mass, "stiffness": 1.0, "damping": 0.0},
                "grain": grain,
                "contact": contact | {key: scale * math.exp(log)},
                "excitation": {"amplitude": 1e-3, "frequency": 1.0},
                "ceiling": {"height": 3.0 * radius},
                "gravity": 0.0,
                "duration": 1.0,
                "tolerance": 1e-6,
            },
            source="random contact",
        )
        return restitution_of(contact_of(scene), speed, reduced) - one.restitution

    return contact | {key: scale * math.exp(root(excess, -6.0, min(4.0, math.log(9e8 / scale)), xtol=1e-9))}


def seen(
    damper: DamperResponse, amplitude: float, height: float, paths: Sequence[tuple[float, float, float]],
    windows: int = _WINDOWS,
) -> Seen:  # fmt: skip
    """Return what long runs on paths to a height [m] show, in so many windows at most.

    Once one of them stays irregular the others are watched in one window.
    """
    runs: list[tuple[float, bool]] = []
    for path in paths:
        runs.append(_run(damper, amplitude, height, path, windows if all(one for _, one in runs) else 1))
    sizes = [size for size, _ in runs]
    same = max(sizes) - min(sizes) <= _REPEATS * max(sizes)
    return Seen(max(sizes), same and all(regular for _, regular in runs))


def _run(
    damper: DamperResponse, amplitude: float, height: float, path: tuple[float, float, float], windows: int
) -> tuple[float, bool]:
    """Return amplitude [m] and whether the motion repeats, long after the path's end."""
    later, travel, share = path
    settle = max(min(_CONSTANTS * damper.decay_periods, 800.0), _LEAST)
    first = damper.diameter + share * (height - damper.diameter)
    start = (later + (0.0 if share == 0.0 else 0.5 * settle)) * damper.period
    reached = start + max(travel, 1e-6 * damper.period)
    way = [(0.0, first), (start, first), (reached, height)] if start > 0.0 else [(0.0, first), (reached, height)]
    begin, strobe, sizes = reached, sample_series(_WATCHED), [0.0]
    state = damper.closed_state(amplitude)
    for _ in range(windows):
        begin += settle * damper.period
        end = begin + _WATCHED * damper.period
        damper.advance(amplitude, state, tuple(way), Observation((begin, end), begin, damper.period, strobe))
        beam, size, begin = strobe[columns.S_BEAM], state.amplitude, end
        changes = [float(np.abs(beam[period:] - beam[:-period]).max()) for period in range(1, _PERIODS + 1)]
        sizes.append(size)
        same = windows == 1 or abs(size - sizes[-2]) <= _REPEATS * size
        if same and min(changes) <= _REPEATS * size:
            return size, True
    return max(sizes[-2:]), False


def brute_force(damper: DamperResponse, amplitude: float) -> tuple[Seen, float]:
    """Return what is seen on other paths at the best height of a fine scan, and that height [m]."""
    unit = math.pi * damper.closed_amplitude(amplitude)
    quick = damper.sufficient(amplitude, 2e-3)

    def objectives(heights: Iterable[float], level: DamperResponse, paths: int, windows: int) -> dict[float, float]:
        rated = dict(on_all_cores(lambda h: seen(level, amplitude, h, _PATHS[:paths], windows).objective, heights))
        return dict(sorted(rated.items(), key=lambda item: item[1]))

    first = objectives([damper.diameter + float(s) * unit for s in _SHARES], quick, 1, 1)
    step = float(_SHARES[1] / _SHARES[0]) - 1.0
    around = [h + part * step * (h - damper.diameter) for h in list(first)[:_AROUND] for part in _FINE]
    first |= objectives(around, quick, 1, 1)
    least = min(first.values())
    promising = [height for height in sorted(first, key=first.__getitem__) if first[height] <= _WORTH * least]
    every = len(promising) / _CANDIDATES
    spread = [promising[int(k * every)] for k in range(min(_CANDIDATES, len(promising)))]
    rated = objectives({*promising[: _CANDIDATES // 2], *spread}, quick, len(_PATHS), _WINDOWS)
    height = next(iter(objectives(list(rated)[:3], damper, len(_PATHS), _WINDOWS)))
    return seen(damper, amplitude, height, _FRESH, _LONGEST), height


def measured(one: Drawn, only: str = "") -> Outcome:
    """Measure `direct` and its margin in one system; only: "direct" or "margin", that alone."""
    try:
        return _measured(one, only)
    except NumericalFailure as error:
        return Outcome(one, math.nan, failure=str(error))


def _measured(one: Drawn, only: str) -> Outcome:
    scene = scene_of(one)
    amplitude = float(scene.excitation.amplitude_points[0][1])
    damper = DamperResponse(scene, 1e-6)
    closed = damper.closed_amplitude(amplitude)
    selector = DirectSelector(scene)
    begun = time.monotonic()
    bare = selector.select(Excitation(amplitude))
    seconds = time.monotonic() - begun
    here = seen(damper, amplitude, bare.height, _FRESH, _LONGEST)
    outcome = Outcome(one, closed, regular=here.regular, seconds=seconds)
    if only != "margin":
        best, height = brute_force(damper, amplitude)
        shares = [(h - damper.diameter) / (math.pi * closed) for h in (bare.height, height)]
        outcome = replace(
            outcome, best_regular=best.regular, excess=here.amplitude / best.amplitude - 1.0, share=shares[0],
            best_share=shares[1],
        )  # fmt: skip
    return outcome if only == "direct" else _with_margin(outcome, scene, amplitude, selector, here)


def _with_margin(
    outcome: Outcome, scene: Scene, amplitude: float, selector: DirectSelector, bare: Seen
) -> Outcome:  # fmt: skip
    """Return the outcome with what long runs at points of the margin's box show, which are drawn here."""
    box = MarginBox()
    selector.prepare()
    begun = time.monotonic()
    chosen = selector.select(Excitation(amplitude, _AMPLITUDE / _MARGIN * amplitude), _MARGIN)
    seconds = time.monotonic() - begun
    least = float(chosen.note.split()[2]) if chosen.note.startswith("least efficiency ") else math.nan
    guaranteed = math.isfinite(least) and "no bound" not in chosen.note
    irregular = broken = 0
    for k, point in enumerate(box_points().tolist()):
        damper, driven = _varied(scene, amplitude, box, point)
        height = max(chosen.height + box.resolution * (k % 3 - 1), damper.diameter)
        here = seen(damper, driven, height, [_PATHS[k % len(_PATHS)]], 1)
        irregular += not here.regular
        broken += guaranteed and 1.0 - here.amplitude / damper.closed_amplitude(driven) < least - _RESOLVED
    expected = seen(DamperResponse(scene, 1e-6), amplitude, chosen.height, _FRESH, _LONGEST)
    return replace(
        outcome, irregular=irregular, points=len(box_points()), announced="no lower height" in chosen.note,
        broken=broken, guaranteed=guaranteed, price=expected.amplitude / bare.amplitude - 1.0, note=chosen.note,
        margin_seconds=seconds,
    )  # fmt: skip


def box_points() -> Array:
    """Return points (n, 5) of the box: amplitude, frequency, mass, stiffness, restitution, each from -1 to 1."""
    rng = np.random.default_rng(7)
    corners = rng.choice([-1.0, 1.0], (_CORNERS, 5))
    return np.concatenate([np.zeros((1, 5)), np.eye(5), -np.eye(5), corners, rng.uniform(-1.0, 1.0, (_INSIDE, 5))])


def _varied(scene: Scene, amplitude: float, box: MarginBox, point: list[float]) -> tuple[DamperResponse, float]:
    """Return the system at a point of the box, and the support's amplitude there [m]."""
    size, frequency, mass, stiffness, restitution = point
    driven = scene.frequency_hz * (1.0 + frequency * box.frequency)
    varied = with_beam(scene, mass=1.0 + mass * box.mass, stiffness=1.0 + stiffness * box.stiffness)
    varied = with_restitution(varied, 1.0 + restitution * box.restitution) or varied
    return DamperResponse(varied.with_(frequency=driven), 1e-6), amplitude * (1.0 + size * _AMPLITUDE)


def table(done: Sequence[Outcome]) -> str:
    """Return the table as Markdown."""
    rows = [
        ("systems", f"{len(done)}"),
        ("of these refused by the engine", f"{sum(bool(one.failure) for one in done)}"),
    ]
    regular = [one for one in done if math.isfinite(one.excess) and one.best_regular]
    others = [one for one in done if math.isfinite(one.excess) and not one.best_regular]
    rows += _excess("brute force ends in a regular motion", regular)
    rows += _excess("brute force ends in an irregular one", others)
    seconds = [one.seconds for one in done if math.isfinite(one.seconds)]
    rows += [("time of `direct`, median and worst", _times(seconds))] if seconds else []
    safe = [one for one in done if one.points]
    if safe:
        promised = [one for one in safe if not one.announced]
        prices = [one.price for one in promised if one.regular]
        rows += [
            ("with a margin", f"{len(safe)}"),
            ("announced: no such height", f"{len(safe) - len(promised)}"),
            ("of the others, with an irregular motion inside the box", f"{sum(one.irregular > 0 for one in promised)}"),
            ("irregular motions inside the box, announced or not", f"{sum(one.irregular for one in safe)}"),
            ("points looked at", f"{sum(one.points for one in safe)}"),
            ("with a least efficiency printed as a bound", f"{sum(one.guaranteed for one in safe)}"),
            ("of these with less than it inside the box", f"{sum(one.broken > 0 for one in safe)}"),
            ("time with a margin, median and worst", _times([one.margin_seconds for one in safe])),
        ]
        if prices:
            text = f"{100.0 * np.median(prices):.0f} %, {100.0 * max(prices):.0f} %"
            rows += [("price: more amplitude where all is as expected, median and worst", text)]
    return "\n".join(["| quantity | value |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)])


def _excess(where: str, done: Sequence[Outcome]) -> list[tuple[str, str]]:
    if not done:
        return []
    excess = 100.0 * np.array([one.excess for one in done])
    return [
        (f"{where}", f"{len(done)}"),
        ("there `direct` within 2 %", f"{int((excess <= 2.0).sum())}"),
        ("there above it, median and worst", f"{np.median(excess):.1f} %, {excess.max():.1f} %"),
    ]


def _times(seconds: Sequence[float]) -> str:
    return f"{np.median(seconds):.1f} s, {max(seconds):.1f} s"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    add = parser.add_argument
    add("--systems", type=whole(1, 10_000), default=40, metavar="N", help="how many; default 40")
    add("--seed", type=whole(0, 2**32 - 1), default=1, metavar="S", help="of the random systems; default 1")
    add("--only", choices=("direct", "margin"), default="", help="measure that alone")
    add("--page", type=file_path, default=None, metavar="FILE", help="page whose table is made anew")
    add("--json", action="store_true", help="print one JSON object a system as it is done, and no table")


def run(args: argparse.Namespace) -> int:
    """Measure, print, and fill in the page; return 0."""
    done = []
    with counting("systems", args.systems) as count:
        for one in draw(args.systems, args.seed):
            done.append(measured(one, args.only))
            count(len(done))
            if args.json:
                print(json.dumps(asdict(done[-1])), flush=True)
    text = table(done)
    if not args.json:
        print(text)
    if args.page is not None:
        into(args.page, text, _BEGIN, _END)
    return 0
