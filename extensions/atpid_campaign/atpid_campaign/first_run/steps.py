# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The first measurement of a stand: its four steps, what each is expected to give, and what a recording shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from atpid_control.analysis.analyse import analyse
from atpid_control.analysis.signals import AnalysisError, signals_of
from atpid_control.runs.run import Run
from atpid_driver.motor.known_motion import HEIGHT_TOLERANCE
from atpid_sim.kernel_inputs import system_of
from atpid_sim.scene import Scene
from atpid_sim.system import Array, structure_of

#: Noise that is expected of a laser where the scene has none: the thesis's, section 2.2 [m].
_NOISE = 20e-6
#: How long sensors at rest and the known motion are recorded [s]; time constants until a motion is steady [-].
_REST, _STEADY = 5.0, 8.0
#: Times the expected noise up to which sensors are quiet [-].
_QUIET = 2.0
_PASSED = "known motion passed"
#: How far frequency, damping and amplification may be from the scene's [-]: beyond, the beam is to be calibrated.
FREQUENCY, DAMPING, AMPLIFICATION = 0.02, 0.2, 0.15
#: And the amplitude from what was set, and what is identified from what is fitted [-].
AMPLITUDE, IDENTIFIED = 0.1, 0.02


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
    excitation: Mapping[str, Any]  # of the scene, where the stand is simulated
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
    return [
        Step("1-noise", "noise floor", "Exciter off, beam at rest, everything that hums switched on.", _REST, still,
             _noise),
        Step("2-decrement", "free decay", f"Exciter off. Pull the tip by at most {reach:.2g} m and release it once "
             "the run says that it records.", 4.0 * constant + 3.0, {"free": {"deflection": reach}}, _decrement),
        Step("3-resonance", "closed damper at resonance", f"Everybody out of the beam's reach (±{reach:.2g} m). Set "
             f"the exciter to {driven}, from below.", settled, tone, _resonance),
        Step("4-motion", "known motion of the ceiling", f"Exciter off, hands out of the container: the ceiling travels "
             f"{move:g} m and back.", _REST, still, _motion, move),
    ]  # fmt: skip


def rows_of(step: Step, run: Run, expected: Expected) -> list[Row]:
    """Return what a recording of the step shows; an analysis that cannot be made is a row that is not right."""
    try:
        return [
            *step.rows(run, expected),
            Row("lost scans", str(run.lost), "0", not run.lost, "load of the PC, USB hub"),
        ]
    except AnalysisError as error:
        return [Row(step.title, str(error), "a recording that shows it", False, "repeat the step")]


def _near(
    what: str, found: float, expected: float, unit: str, share: float, remedy: str, std: float = 0.0
) -> Row:  # fmt: skip
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
        spread = _scatter(values, signals.rate)
        yield Row(
            f"{name} at rest", f"{spread:.3g} {unit}", f"up to {most:.3g} {unit}{', not 0' if given else ''}",
            spread <= most and (spread > 0.0 or not given), "light, cables, a common ground; 0: a converter that holds",
        )  # fmt: skip
    steady = int(np.count_nonzero(run.estimates.steady))
    yield Row("excitation identified", f"{steady} estimates", "none", steady == 0, "exciter off? mains? a fan?")


def _scatter(values: Array, rate: float) -> float:
    """Return the standard deviation of a signal (n,) at rest: the median of those of its half seconds."""
    parts = np.array_split(values, max(1, round(2.0 * len(values) / rate)))
    spreads = [float(np.std(part)) for part in parts if np.isfinite(part).all()]
    return float(np.median(spreads)) if spreads else math.nan


def _decrement(run: Run, expected: Expected) -> Iterator[Row]:
    found = analyse(signals_of(run)[0])
    if (decay := found.decay) is None:
        raise AnalysisError(found.skipped["decrement"])
    calibrate = "atpid calibrate beam, and its block into the scene"
    yield _near("frequency", decay.frequency, expected.frequency, "Hz", FREQUENCY, calibrate, decay.frequency_std)
    ratio = _near("damping ratio", decay.damping_ratio, expected.ratio, "", DAMPING,
                  f"{calibrate}; a grain that rattles is not held", decay.damping_ratio_std)  # fmt: skip
    yield ratio
    usual = math.exp(2.0 * math.pi * expected.ratio / math.sqrt(1.0 - expected.ratio**2))
    peaks = float(np.median(decay.ratios)) if len(decay.ratios) else math.nan
    yield Row("ratio of successive peaks", f"{peaks:.3f}", f"{usual:.3f}", ratio.right, calibrate)


def _resonance(run: Run, expected: Expected) -> Iterator[Row]:
    found = analyse(signals_of(run)[0])
    if (order := found.orders) is None:
        raise AnalysisError(found.skipped["orders"])
    yield _near("excitation's frequency", order.frequency, expected.frequency, "Hz", FREQUENCY, "set it to the decay's")
    yield _near("beam over excitation", order.excitation_ratio, expected.amplification(order.frequency), "",
                AMPLIFICATION, "frequency, clamp, calibration")  # fmt: skip
    steady, unit = run.estimates.amplitude[run.estimates.steady], expected.scene.driven_by.unit
    yield _near("amplitude identified", float(steady[-1]) if len(steady) else math.nan, order.excitation, unit,
                IDENTIFIED, "docs/identification.md, Quality")  # fmt: skip
    yield _near("amplitude", order.excitation, expected.amplitude, unit, AMPLITUDE, "the exciter; calibration")


def _motion(run: Run, expected: Expected) -> Iterator[Row]:
    made = [event for event in run.all_events if event.text.startswith("known motion")]
    yield Row("known motion", made[-1].text if made else "not made", _PASSED, bool(made) and made[-1].text == _PASSED,
              "docs/first_run.md, The motor")  # fmt: skip
    ends = (made[0].time, made[-1].time) if made else (math.inf, math.inf)
    heights = run.ceiling.height[(run.ceiling.time >= ends[0]) & (run.ceiling.time <= ends[1])]
    if np.isfinite(heights).any():
        yield _near("ceiling's travel", float(np.nanmax(heights) - np.nanmin(heights)), expected.move, "m",
                    2.0 * HEIGHT_TOLERANCE / expected.move, "calibrate the height sensor")  # fmt: skip
