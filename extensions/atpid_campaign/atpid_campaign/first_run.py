# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid first-run SCENE`: the first measurement of a stand, step by step, beside what its scene expects."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import yaml

from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_common.cli import Parser
from atpid_common.errors import AtpidError, InputError
from atpid_common.files import Document
from atpid_control.analysis.analyse import analyse
from atpid_control.analysis.signals import AnalysisError, signals_of
from atpid_control.commands import bench, stand
from atpid_control.commands.results import Shown, claim, give, two_columns
from atpid_control.runs.run import Run, open_run
from atpid_control.stand.launching.options import add_devices, add_parameters
from atpid_control.stand.parameters import read_parameters, write_parameters
from atpid_control.stand.parts import NAMES, devices_of
from atpid_driver.motor.known_motion import HEIGHT_TOLERANCE
from atpid_sim.kernel_inputs import system_of
from atpid_sim.scene import Scene, load_scene
from atpid_sim.system import structure_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Time that a person has for what the step asks for [s].
_HANDS = 10.0
EXAMPLE = "scenes/stand_realtime.yaml --emulated-stand --yes --out out/first_run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=file_path, help="scene file with your beam, grain and ceiling (docs/scenes.md)")
    add("--out", type=file_path, default=Path("out/first_run"), help="folder of bags and page; default: %(default)s")
    output.add_force(parser)
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--simulated", action="store_true", help="in place of the stand: the simulated bench")
    kind.add_argument("--emulated-stand", action="store_true", help="or stand-in devices and the real firmware")
    add("--yes", action="store_true", help="ask nothing; allowed where no person has to act: without a stand")
    add("--amplitude", type=positive("m or N"), metavar="A", help="of the excitation; default: the scene's least")
    add("--move", type=positive("m"), default=0.1, metavar="METRES", help="known motion; default: %(default)s")
    add_devices(parser)
    add_parameters(parser)
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Make the steps that are not skipped, and the page; return 0, 1 where a figure is not as expected."""
    if args.yes and not (args.simulated or args.emulated_stand):
        raise InputError("--yes: given for a stand; allowed: with --simulated or --emulated-stand; a person has to act")
    expected = Expected(load_scene(args.scene), args.amplitude, args.move)
    picture, file = claim(args, "first_run.png", "first_run.json")
    done: list[tuple[Step, Run | None, list[Row]]] = []
    skipped: list[str] = []
    for step in steps_of(expected):
        answer = "" if args.yes else _asked(step)
        if answer == "q":
            skipped.append(f"stopped before: {step.title}")
            break
        if answer == "s":
            skipped.append(f"skipped: {step.title}")
            continue
        done.append((step, *_measured(args, step, expected)))
        for row in done[-1][2]:
            verdict = "as expected" if row.right else "DIFFERS"
            print(f"{verdict:11}  {row.what}: {row.found}; expected {row.expected}", file=sys.stderr)
    panels = [[partial(_draw, step=step, run=run)] for step, run, _ in done if run is not None]
    rows = [(step, row) for step, _, found in done for row in found]
    shown = two_columns((f"{step.title}: {row.what}", f"{row.found}; expected {row.expected}") for step, row in rows)
    notes = [f"not as expected: {row.what}: {row.remedy}" for _, row in rows if not row.right] + skipped
    steps = {step.name: [row._asdict() for row in found] for step, _, found in done}
    numbers = {"scene": str(args.scene), "missing": [], "notes": notes, "steps": steps}
    give(args, numbers, file, Shown(f"First measurement of {args.scene.stem}", shown, notes, picture, panels))
    return int(not all(row.right for _, row in rows))


def _asked(step: Step) -> str:
    """Show what to do, and return "" for going on, "s" for leaving the step out, "q" for the end."""
    print(f"\n{step.title} ({step.duration:.0f} s)\n  {step.task}", file=sys.stderr)
    while True:
        print("  Enter: go on, s: skip, q: stop > ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        answer = line.strip().lower() if line else "q"  # the terminal is gone
        if answer in ("", "s", "q"):
            return answer


def _measured(args: argparse.Namespace, step: Step, expected: Expected) -> tuple[Run | None, list[Row]]:
    """Record a step; return its run and figures. A run that fails is a row that is not right."""
    folder = args.out / step.name
    folder.mkdir(parents=True, exist_ok=True)
    file, parameters = folder / "scene.yaml", folder / "held.yaml"
    scene = _scene(expected.scene, step, devices_of(args)[0].configured())
    file.write_text(yaml.safe_dump(scene.to_mapping(), sort_keys=False), encoding="utf-8")
    given = read_parameters(args.params_file, NAMES) if args.params_file else {}
    given["selector_node"] = given.get("selector_node", {}) | {"hold": True}  # the ceiling stays closed
    write_parameters(given, parameters)
    values = vars(args) | {"scene": file, "params_file": parameters, "move": step.move}
    try:
        if args.simulated or args.emulated_stand:
            bag = folder / "run/bag"
            values |= {"out": bag.parent, "real_time": bool(step.move) and args.simulated}
            with bench.recorded(_options(bench, values)):
                pass
        else:
            bag = folder / f"bag-{len(list(folder.glob('bag-*'))) + 1}"  # an earlier one is kept
            stand.run(_options(stand, values | {"bag": bag, "seconds": step.duration + _HANDS}))
        run = open_run(bag)
        return run, rows_of(step, run, expected)
    except AtpidError as error:
        return None, [Row(step.title, str(error), "a run to its end", False, "docs/first_run.md, By symptom")]


def _options(command: ModuleType, values: Mapping[str, object]) -> argparse.Namespace:
    """Return the options of another command: its defaults, and of `values` those that it has."""
    parser = Parser()
    command.add_arguments(parser)
    found: argparse.Namespace = parser.parse_args([str(values["scene"])])
    vars(found).update({name: value for name, value in values.items() if name in found})
    return found


def _scene(scene: Scene, step: Step, motor: Document) -> Scene:
    """Return the scene of a step: closed, moved by a motor with these parameters, as long as the step."""
    ceiling, low, high, speed = scene.ceiling, motor["lowest"], motor["highest"], motor["speed"]
    low = max(low, 2.0 * scene.grain.radius)
    if ceiling.controlled:
        (low, high), speed = ceiling.range, ceiling.speed
    closed = {"closed": low, "range": [low, high], "speed": speed, "controller": "direct"}
    changes: Document = {"ceiling": closed, "duration": step.duration, "steady_window": [0.0, step.duration]}
    return scene.with_(excitation=dict(step.excitation), initial=None, faults=(), **changes)


def _draw(ax: Axes, step: Step, run: Run) -> None:
    """Draw what the sensors measured in a step, and the ceiling."""
    signals, _ = signals_of(run)
    for name, values, unit in zip(signals.names, (signals.excitation, signals.response), signals.units, strict=True):
        moved = values - np.nanmedian(values)
        ax.plot(signals.time, moved, linewidth=0.7, label=f"{name.replace('_', ' ')} about its median [{unit}]")
    begin = signals.time[0]
    if step.move:  # before the first sample: homing and the known motion
        known = np.isfinite(run.ceiling.height)
        begin = run.ceiling.time[known].min(initial=begin)
        ax.plot(run.ceiling.time, run.ceiling.height, linewidth=1.2, label="ceiling [m]")
    ax.set(title=step.title, xlabel="time [s]", xlim=(begin, signals.time[-1]))


#: Noise that is expected of a laser where the scene has none: the thesis's, section 2.2 [m].
_NOISE = 20e-6
#: How long sensors at rest and the known motion are recorded [s]; time constants until a motion is steady [-].
_REST, _STEADY = 5.0, 8.0
#: Times the expected noise up to which sensors are quiet [-].
_QUIET = 2.0
_PASSED = "known motion passed"
#: How far frequency, damping and amplification may be from the scene's [-]: beyond, the beam is to be calibrated.
FREQUENCY, DAMPING, _AMPLIFICATION = 0.02, 0.2, 0.15
#: And the amplitude from what was set, and what is identified from what is fitted [-].
AMPLITUDE, _IDENTIFIED = 0.1, 0.02


class Row(NamedTuple):
    """One figure beside the expected one, and what to do where they differ."""

    what: str
    found: str
    expected: str
    right: bool
    remedy: str


@dataclass(frozen=True)
class Step:
    """One measurement: what a person does for it, what a simulated stand does instead, what is read from it."""

    name: str
    title: str
    task: str
    duration: float  # [s]
    excitation: Mapping[str, object]  # of the scene, where the stand is simulated
    rows: Callable[[Run, Expected], Iterator[Row]]
    move: float = 0.0  # the known motion of the ceiling before it [m]


class Expected:
    """What the scene's structure does with the damper closed."""

    def __init__(self, scene: Scene, amplitude: float | None = None, move: float = 0.1) -> None:
        """Take the scene; amplitude: of the support [m] or force [N] at resonance, None: the least of the scene's.

        move: how far the ceiling travels [m].
        """
        modes = structure_of(system_of(scene), held=True)
        self.scene, self.frequency = scene, scene.natural_frequency_hz
        self.ratio = float(0.5 * modes.damping[0] / math.sqrt(modes.stiffness[0] * modes.mass[0]))
        given = [one for _, one in scene.excitation.amplitude_points if one > 0.0]
        self.amplitude = amplitude or min(given, default=0.005)
        self.move = move

    def amplification(self, frequency: float) -> float:
        """Return beam over support [-], or over force [m/N], at a frequency [Hz]."""
        return self.scene.linear_amplitude(1.0, frequency, grain=True)


def steps_of(expected: Expected) -> list[Step]:
    """Return the steps, in their order."""
    constant = 1.0 / (2.0 * math.pi * expected.ratio * expected.frequency)  # of the decay [s]
    reach = expected.amplitude * expected.amplification(expected.frequency)
    settled = _STEADY * constant + 20.0 / expected.frequency
    tone = {"amplitude": expected.amplitude, "frequency": "resonance"}
    still, move = tone | {"amplitude": 0.0}, expected.move
    driven = f"{expected.frequency:.2f} Hz and {expected.amplitude:g} {expected.scene.driven_by.unit}"
    quiet = "Exciter off, beam at rest, everything that hums switched on."
    pull = f"Exciter off. Pull the tip by at most {reach:.2g} m and release it once the run says that it records."
    drive = f"Everybody out of the beam's reach (±{reach:.2g} m). Set the exciter to {driven}, from below."
    travel = f"Exciter off, hands out of the container: the ceiling travels {move:g} m and back."
    free, decays = {"free": {"deflection": reach}}, 4.0 * constant + 3.0
    return [
        Step("1-noise", "noise floor", quiet, _REST, still, _noise),
        Step("2-decrement", "free decay", pull, decays, free, _decrement),
        Step("3-resonance", "closed damper at resonance", drive, settled, tone, _resonance),
        Step("4-motion", "known motion of the ceiling", travel, _REST, still, _motion, move),
    ]


def rows_of(step: Step, run: Run, expected: Expected) -> list[Row]:
    """Return what a recording of the step shows; an analysis that cannot be made is a row that is not right."""
    try:
        return [
            *step.rows(run, expected),
            Row("lost scans", str(run.lost), "0", not run.lost, "load of the PC, USB hub"),
        ]
    except AnalysisError as error:
        return [Row(step.title, str(error), "a recording that shows it", False, "repeat the step")]


def _near(what: str, found: float, expected: float, unit: str, share: float, remedy: str, std: float = 0.0) -> Row:
    """Return a figure that may differ from the expected one by a share of it, and by three standard deviations."""
    shown = f"{found:.4g}" + (f" ± {std:.1g}" if std else "")
    near = bool(abs(found - expected) <= share * expected + 3.0 * std)
    return Row(what, f"{shown} {unit}".rstrip(), f"{expected:.4g} {unit}".rstrip(), near, remedy)


def _noise(run: Run, expected: Expected) -> Iterator[Row]:
    signals, _ = signals_of(run)
    sensors = expected.scene.sensors
    for name, values, unit in zip(signals.names, (signals.excitation, signals.response), signals.units, strict=True):
        given = (sensors.load_cell.noise if sensors.load_cell else 0.0) if unit == "N" else sensors.laser.noise
        most = _QUIET * (given or (_NOISE if unit == "m" else math.inf))
        parts = np.array_split(values, max(1, round(2.0 * len(values) / signals.rate)))  # half a second each
        spreads = [float(np.std(part)) for part in parts if np.isfinite(part).all()]
        spread = float(np.median(spreads)) if spreads else math.nan
        quiet, allowed = spread <= most and (spread > 0.0 or not given), f"up to {most:.3g} {unit}"
        mend = "light, cables, a common ground; 0: a converter that holds"
        expects = f"{allowed}, not 0" if given else allowed
        yield Row(f"{name} at rest", f"{spread:.3g} {unit}", expects, quiet, mend)
    steady = int(np.count_nonzero(run.estimates.steady))
    yield Row("excitation identified", f"{steady} estimates", "none", steady == 0, "exciter off? mains? a fan?")


def _decrement(run: Run, expected: Expected) -> Iterator[Row]:
    found = analyse(signals_of(run)[0])
    if (decay := found.decay) is None:
        raise AnalysisError(found.skipped["decrement"])
    calibrate = "atpid calibrate beam, and its block into the scene"
    yield _near("frequency", decay.frequency, expected.frequency, "Hz", FREQUENCY, calibrate, decay.frequency_std)
    mend = f"{calibrate}; a grain that rattles is not held"
    ratio = _near("damping ratio", decay.damping_ratio, expected.ratio, "", DAMPING, mend, decay.damping_ratio_std)
    yield ratio
    usual = math.exp(2.0 * math.pi * expected.ratio / math.sqrt(1.0 - expected.ratio**2))
    peaks = float(np.median(decay.ratios)) if len(decay.ratios) else math.nan
    yield Row("ratio of successive peaks", f"{peaks:.3f}", f"{usual:.3f}", ratio.right, calibrate)


def _resonance(run: Run, expected: Expected) -> Iterator[Row]:
    found = analyse(signals_of(run)[0])
    if (order := found.orders) is None:
        raise AnalysisError(found.skipped["orders"])
    yield _near("excitation's frequency", order.frequency, expected.frequency, "Hz", FREQUENCY, "set it to the decay's")
    usual, mend = expected.amplification(order.frequency), "frequency, clamp, calibration"
    yield _near("beam over excitation", order.excitation_ratio, usual, "", _AMPLIFICATION, mend)
    steady, unit = run.estimates.amplitude[run.estimates.steady], expected.scene.driven_by.unit
    last, mend = float(steady[-1]) if len(steady) else math.nan, "docs/identification.md, Quality"
    yield _near("amplitude identified", last, order.excitation, unit, _IDENTIFIED, mend)
    yield _near("amplitude", order.excitation, expected.amplitude, unit, AMPLITUDE, "the exciter; calibration")


def _motion(run: Run, expected: Expected) -> Iterator[Row]:
    made = [event for event in run.all_events if event.text.startswith("known motion")]
    found = made[-1].text if made else "not made"
    yield Row("known motion", found, _PASSED, found == _PASSED, "docs/first_run.md, The motor")
    ends = (made[0].time, made[-1].time) if made else (math.inf, math.inf)
    heights = run.ceiling.height[(run.ceiling.time >= ends[0]) & (run.ceiling.time <= ends[1])]
    if np.isfinite(heights).any():
        travel, share = float(np.nanmax(heights) - np.nanmin(heights)), 2.0 * HEIGHT_TOLERANCE / expected.move
        yield _near("ceiling's travel", travel, expected.move, "m", share, "calibrate the height sensor")
