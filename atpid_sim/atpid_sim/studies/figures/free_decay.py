# SPDX-License-Identifier: Apache-2.0
"""The free decays measured on the real stand (thesis section 2.3.1) beside the model's, without any fitting.

python -m atpid_sim.studies.figures.free_decay --out docs/figures
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_common import output
from atpid_common.cli import guarded
from atpid_sim.figure_numbers import metadata_of
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.simulate import trajectory

Array = NDArray[np.float64]

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
    return scene_from_mapping(
        {
            "beam": {"mass": 0.3258, "stiffness": 117.6, "damping": 0.56},
            "grain": {"mass_fraction": mass_fraction, "radius": 0.0085},
            "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
            "excitation": {"free": {"deflection": 0.2}},
            "ceiling": {"height": height},
            "gravity": 9.81,
            "duration": 6.0,
            "tolerance": 1e-6,
        }
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


def table() -> str:
    """Return measured and computed largest ratios as a Markdown table."""
    lines = ["| grain | height | measured | model |", "|---|---|---|---|"]
    for case in MEASURED:
        found = decrements(free_decay(case.mass_fraction, case.height)).max()
        height = "closed" if case.height == 0.017 else f"{case.height:g} m"
        measured = f"{case.decrement:g}" if case.within else f"above {case.decrement:g}"
        lines.append(f"| {100 * case.mass_fraction:g} % | {height} | {measured} | {found:.3g} |")
    return "\n".join(lines)


def draw(out: Path) -> list[Path]:
    """Draw decays and decrements into the folder `out`; return the files written."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11.0, 4.0), layout="constrained")
    for colour, (fraction, height, label) in enumerate(
        [(0.1, 0.017, "closed"), (0.05, 0.2, "5 % of grain"), (0.1, 0.2, "10 %"), (0.2, 0.2, "20 %")]
    ):
        scene = free_decay(fraction, height)
        motion = trajectory(scene, _RATE, "soft")
        left.plot(motion.time, motion.beam + scene.static_deflection, color=f"C{colour}", linewidth=1.3, label=label)
    left.set(
        xlim=(0.0, 3.0), xlabel="time [s]", ylabel="beam above equilibrium [m]", title="Released from 0.2 m, h = 0.2 m"
    )
    left.legend(fontsize=8)
    cases = MEASURED
    model = [decrements(free_decay(case.mass_fraction, case.height)).max() for case in cases]
    places = np.arange(len(cases))
    right.plot(
        places, [case.decrement for case in cases], "ko", markersize=8, fillstyle="none", label="measured on the stand"
    )
    open_end = [place for place, case in zip(places, cases, strict=True) if case.within is None]
    for place in open_end:  # "above 3"
        right.annotate("", (place, 4.2), (place, 3.1), arrowprops={"arrowstyle": "->"})
    right.plot(places, model, "C3x", markersize=8, label="model, nothing fitted")
    names = [f"{100 * c.mass_fraction:g} %\n" + ("closed" if c.height == 0.017 else f"{c.height:g} m") for c in cases]
    right.set_xticks(places, names, fontsize=8)
    right.set(
        xlabel="grain, height",
        ylabel="largest ratio of amplitudes [-]",
        title="Damping of the free decay (thesis §2.3.1)",
        yscale="log",
    )
    right.set_yticks([1.3, 1.5, 2.0, 3.0, 4.0, 6.0], ["1.3", "1.5", "2", "3", "4", "6"])
    right.minorticks_off()
    right.legend(fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    file = output.folder(out) / "free_decay.png"
    with output.writing(file):
        figure.savefig(file, dpi=150, metadata=metadata_of(figure))
    pyplot.close(figure)
    return [file]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this figure's arguments."""
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder the picture goes to")


def run(args: argparse.Namespace) -> int:
    """Draw the figure, print the table."""
    for file in draw(args.out):
        print(file)
    print(table())
    return 0


def main() -> int:
    """Run as a command."""
    parser = argparse.ArgumentParser(description="measured and computed free decays")
    add_arguments(parser)
    return guarded(lambda: run(parser.parse_args()))


if __name__ == "__main__":
    raise SystemExit(main())
