# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The free decays measured on the real stand (thesis section 2.3.1) beside the model's, without any fitting.

python -m studies figures free_decay --out docs/figures
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from atpid_common import output
from atpid_sim.figure_style import WIDTH, drawn
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

#: Samples a second from which peaks are read: the highest of a period is then within 5e-5 of the true one.
_RATE = 2000.0
#: Periods in which the largest ratio is looked for, as in the thesis's figures.
_PERIODS = 11


class Measurement(NamedTuple):
    """Largest ratio of successive amplitudes read off the thesis, and how closely the model is to meet it."""

    mass_fraction: float
    height: float  # [m]
    decrement: float
    within: float | None  # relative; None where one impact near the equilibrium decides


#: The thesis's text on figures 2.9-2.19. It gives "above 3" for 30 % of grain.
MEASURED = (
    Measurement(0.1, 0.017, 1.31, 0.01),
    Measurement(0.025, 0.05, 1.345, 0.03),
    Measurement(0.025, 0.10, 1.38, 0.03),
    Measurement(0.025, 0.15, 1.40, 0.03),
    Measurement(0.025, 0.20, 1.42, 0.03),
    Measurement(0.05, 0.20, 1.52, 0.03),
    Measurement(0.1, 0.20, 1.8, 0.05),
    Measurement(0.2, 0.20, 2.5, 0.05),
    Measurement(0.3, 0.20, 3.0, None),
)


def free_decay(mass_fraction: float, height: float) -> Scene:
    """Return the beam of 3.02 Hz, released at rest 0.2 m above its equilibrium."""
    return standard_bench(
        beam={"mass": 0.3258, "stiffness": 117.6, "damping": 0.56},
        grain={"mass_fraction": mass_fraction, "radius": 0.0085},
        excitation={"free": {"deflection": 0.2}},
        ceiling={"height": height},
        duration=6.0,
    )


def upper_peaks(scene: Scene) -> tuple[Array, Array]:
    """Return times (n,) [s] and heights above equilibrium (n,) [m] of the highest point in each period.

    A period begins half of one before each multiple: a grain's impact makes small extra peaks that are no amplitudes.
    """
    motion = trajectory(scene, _RATE, "soft")
    lifted, period = motion.beam + scene.static_deflection, 1.0 / scene.natural_frequency_hz
    number = np.floor(motion.time / period + 0.5).astype(int)
    highest = [np.flatnonzero(number == k)[np.argmax(lifted[number == k])] for k in range(_PERIODS)]
    return motion.time[highest], lifted[highest]


def decrements(scene: Scene) -> Array:
    """Return the ratios of successive amplitudes, (n,) [-]."""
    _, heights = upper_peaks(scene)
    return np.asarray(heights[:-1] / heights[1:])


def _largest(case: Measurement) -> float:
    return float(decrements(free_decay(case.mass_fraction, case.height)).max())


def _height(case: Measurement) -> str:
    return "closed" if case.height == 0.017 else f"{case.height:g} m"


def table() -> str:
    """Return measured and computed largest ratios as a Markdown table."""
    lines = ["| grain | height | measured | model |", "|---|---|---|---|"]
    for case in MEASURED:
        measured = f"{case.decrement:g}" if case.within else f"above {case.decrement:g}"
        lines.append(f"| {100 * case.mass_fraction:g} % | {_height(case)} | {measured} | {_largest(case):.3g} |")
    return "\n".join(lines)


def draw(out: Path) -> list[Path]:
    """Draw decays and decrements into the folder `out`; return the files written."""
    file = output.folder(out) / "free_decay.png"
    with drawn(file, nrows=2, figsize=(WIDTH, 7.0)) as (_, (upper, lower)):
        _decays(upper)
        _ratios(lower)
    return [file]


def _decays(axes: Any) -> None:
    scenes = {"closed": free_decay(0.1, 0.017), "5 % of grain": free_decay(0.05, 0.2)}
    for label, scene in (scenes | {"10 %": free_decay(0.1, 0.2), "20 %": free_decay(0.2, 0.2)}).items():
        motion = trajectory(scene, _RATE, "soft")
        axes.plot(motion.time, motion.beam + scene.static_deflection, linewidth=1.3, label=label)
    title = "Released from 0.2 m, h = 0.2 m"
    axes.set(xlim=(0.0, 3.0), xlabel="time [s]", ylabel="beam above equilibrium [m]", title=title)
    axes.legend()


def _ratios(axes: Any) -> None:
    measured = [case.decrement for case in MEASURED]
    axes.plot(measured, "ko", markersize=8, fillstyle="none", label="measured on the stand")
    for place, case in enumerate(MEASURED):
        if case.within is None:  # "above 3"
            axes.annotate("", (place, 4.2), (place, 3.1), arrowprops={"arrowstyle": "->"})
    axes.plot([_largest(case) for case in MEASURED], "C3x", markersize=8, label="model, nothing fitted")
    names = [f"{100 * case.mass_fraction:g} %\n{_height(case)}" for case in MEASURED]
    axes.set_xticks(range(len(MEASURED)), names)
    title = "Damping of the free decay (thesis §2.3.1)"
    axes.set(xlabel="grain, height", ylabel="largest ratio of amplitudes [-]", title=title, yscale="log")
    axes.set_yticks([1.3, 1.5, 2.0, 3.0, 4.0, 6.0], ["1.3", "1.5", "2", "3", "4", "6"])
    axes.minorticks_off()
    axes.legend()
