# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pictures of docs/identification.md: the bound, the thesis's ramps, what spoils a signal, the watch, calibration."""

import argparse
from collections.abc import Callable

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_control.identification import Estimate, Quality
from atpid_sim.display import working
from atpid_sim.figure_style import LIGHT, metadata_of, style
from atpid_sim.system import Array
from studies.identification import measure as data

INK, GREY, BLUE, ORANGE, RED = LIGHT.ink, LIGHT.given_text, LIGHT.own, LIGHT.accent, "#b0304a"
STYLE = style(LIGHT) | {"figure.constrained_layout.use": True, "savefig.dpi": 130}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where the pictures go."""
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help="folder for the pictures")


def run(args: argparse.Namespace) -> int:
    """Make all pictures; about half a minute."""
    output.folder(args.out)
    for name, draw in FIGURES.items():
        path = args.out / f"identification_{name}.png"
        with working(f"drawing {path.name}"), matplotlib.rc_context(STYLE):
            figure = draw()
        with output.writing(path):
            figure.savefig(path, metadata=metadata_of(figure))
        print(path)
    return 0


def draw_bound() -> Figure:
    """Error of the amplitude against the length of the window, beside the Cramér-Rao bound."""
    figure = Figure(figsize=(9.6, 3.7))
    axes = figure.subplots(1, 3, sharey=True, sharex=True)
    styles = {
        "FFT bin (thesis)": (RED, "-", 1.3), "FFT, interpolated (Candan)": (ORANGE, "-", 1.3),
        "Hann, padded, parabola": (GREY, "-", 1.3), "four-parameter sine fit": (BLUE, "-", 2.2),
        "Cramér-Rao bound": (INK, (0, (2, 2)), 1.3),
    }  # fmt: skip
    for ax, decibels in zip(axes, (20.0, 40.0, 60.0), strict=True):
        periods, errors = data.errors_over_window(decibels)
        for name, (colour, dash, width) in styles.items():
            ax.loglog(periods, 100.0 * errors[name], color=colour, ls=dash, lw=width, label=name)
        ax.set(title=f"{decibels:.0f} dB", xlabel="length of the window [periods]")
        ax.set_xticks([1, 2, 3, 4], labels=["1", "2", "3", "4"])
        ax.minorticks_off()
    axes[0].set_ylabel("rms error of the amplitude [%]")
    axes[0].set_yticks([0.01, 0.1, 1, 10], labels=["0.01", "0.1", "1", "10"])
    entries = axes[0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=5, fontsize=8.5, columnspacing=1.2)
    return figure


def draw_ramps() -> Figure:
    """The excitation of thesis section 4.3, and a step, as identified block by block."""
    figure = Figure(figsize=(9.6, 3.8))
    left, right = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
    truth, found = data.thesis_ramps()
    _draw_estimates(left, truth, found)
    left.set(title="Thesis §4.3 excitation, 40 dB", ylim=(0.0, 0.045))
    truth, found = data.one_step()
    _draw_estimates(right, truth, found)
    for periods in (1, 2):
        later = data.STEP_AT + periods / data.FREQUENCY
        right.axvline(later, color=GREY, lw=0.8, ls=":")
        right.text(later, 0.0318, f" {periods} period{'s' * (periods > 1)}", color=GREY)
    span = (data.STEP_AT - 0.3, data.STEP_AT + 0.6)
    right.set(title="A step: steady again one period later", xlim=span, ylim=(0.012, 0.033))
    left.legend(loc="upper left", fontsize=8.5, bbox_to_anchor=(0.42, 0.45))
    return figure


def _draw_estimates(ax: Axes, truth: tuple[Array, Array], found: list[Estimate]) -> None:
    ax.plot(*truth, color=INK, lw=1.0, label="true amplitude")
    for quality, colour in ((Quality.STEADY, BLUE), (Quality.TRANSIENT, ORANGE)):
        chosen = [e for e in found if e.quality == quality]
        ax.errorbar(
            [e.time for e in chosen], [e.amplitude for e in chosen], [3.0 * e.amplitude_std for e in chosen],
            fmt="o", ms=2.6, lw=0.8, color=colour, label=f"{quality.name.lower()} estimate, ±3σ",
        )  # fmt: skip
    ax.set(xlabel="time [s]", ylabel="amplitude of the support [m]")


def draw_spoiled() -> Figure:
    """The amplitude's error where the signal is spoiled: the plain fit and ours."""
    figure = Figure(figsize=(9.6, 3.6))
    ax = figure.subplots()
    names, plain, ours = data.spoiled_errors()
    y = np.arange(len(names))
    ax.barh(y + 0.2, 100.0 * plain, height=0.36, color=LIGHT.given, label="four parameters alone")
    ax.barh(y - 0.2, 100.0 * ours, height=0.36, color=BLUE, label="with spikes, drift, harmonics and hum told apart")
    ax.axvline(1.0, color=RED, lw=0.9, ls="--")
    ax.text(1.03, -0.85, "1 % allowed", color=RED, va="center")
    ax.set_yticks(y, labels=names)
    ax.invert_yaxis()
    ax.set_xscale("log")
    ax.set_xticks([0.05, 0.1, 1.0, 10.0], labels=["0.05", "0.1", "1", "10"])
    ax.set_xlabel("largest error of the amplitude in 100 windows of two periods, 40 dB [%]")
    figure.legend(loc="outside lower center", ncols=2)
    ax.grid(axis="y", visible=False)
    return figure


def draw_beam() -> Figure:
    """The excitation inferred from the beam alone, with the closed damper, from rest."""
    figure = Figure(figsize=(9.6, 3.4))
    left, right = figure.subplots(1, 2)
    time, beam, found = data.from_closed_beam()
    left.plot(time, beam, color=GREY, lw=0.5)
    left.set(title="What is measured: the beam, 40 dB", xlabel="time [s]", ylabel="beam displacement [m]")
    good = [e for e in found if e.quality in (Quality.STEADY, Quality.TRANSIENT)]
    at, amplitude = np.array([e.time for e in good]), np.array([e.amplitude for e in good])
    spread = np.array([e.amplitude_std for e in good])
    band = (at, amplitude - spread, amplitude + spread)
    right.fill_between(*band, color=BLUE, alpha=0.18, lw=0, label="±σ, model included")
    right.plot(at, amplitude, color=BLUE, lw=1.4, label="inferred")
    right.axhline(data.CLOSED_AMPLITUDE, color=INK, lw=0.9, ls="--", label="true")
    right.set(title="What the support did", xlabel="time [s]", ylabel="amplitude of the support [m]", ylim=(0.0, 0.016))
    right.legend(loc="lower right", ncols=3)
    return figure


def draw_watch() -> Figure:
    """Rumble in the measured beam: a safe course and one with the ceiling too high."""
    figure = Figure(figsize=(9.6, 5.4))
    rows = figure.subplots(3, 2, sharex=True, sharey="row", height_ratios=[1.3, 0.8, 1.0])
    for column, (title, course) in zip(rows.T, data.watched_courses().items(), strict=True):
        displacement, height, scatter = column
        displacement.plot(course.time, course.beam, color=GREY, lw=0.4)
        height.plot(course.time, course.height, color=INK, lw=1.1)
        scatter.plot(course.state_time, course.scatter, color=BLUE, lw=1.1)
        for level, name in ((data.RUMBLE.onset, "rumble"), (data.RUMBLE.calm, "calm")):
            scatter.axhline(level, color=GREY, lw=0.8, ls="--")
            scatter.text(-0.6, level + 0.002, name, color=GREY, va="bottom", fontsize=8)
        for ax in column:
            for begin, end in course.alarms:
                ax.axvspan(begin, end, color=RED, alpha=0.12, lw=0)
        displacement.set_title(title)
        scatter.set_xlabel("time [s]")
    for ax, label in zip(rows[:, 0], ("beam [m]", "ceiling [m]", "scatter [-]"), strict=True):
        ax.set_ylabel(label)
    rows[2, 0].set_ylim(0.0, 0.2)
    return figure


def draw_calibration() -> Figure:
    """A decay and a sweep: stiffness and damping recovered, error against noise, with the error bar claimed."""
    figure = Figure(figsize=(9.6, 3.4))
    axes = figure.subplots(1, 2, sharey=True)
    for ax, (title, result) in zip(axes, data.calibrations().items(), strict=True):
        for index, (name, colour) in enumerate((("stiffness", BLUE), ("damping", ORANGE))):
            noise, error, claimed = 1e3 * result.noise, 100.0 * result.error, 100.0 * result.claimed
            ax.loglog(noise, error[:, index], "o-", ms=4, color=colour, label=f"{name}: error")
            ax.loglog(noise, claimed[:, index], ls=":", color=colour, label=f"{name}: σ claimed")
        ax.axhline(1.0, color=RED, lw=0.9, ls="--")
        ax.set(title=title, xlabel="noise of both lasers [mm]")
        ax.set_xticks(1e3 * result.noise, labels=[f"{1e3 * sigma:g}" for sigma in result.noise])
        ax.minorticks_off()
    axes[0].set_ylabel("rms error of ten recordings [%]")
    axes[0].set_yticks([1e-3, 1e-2, 0.1, 1.0], labels=["0.001", "0.01", "0.1", "1"])
    axes[0].legend(ncols=2, fontsize=8, loc="upper left", bbox_to_anchor=(0.0, 0.93))
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "bound": draw_bound, "ramps": draw_ramps, "spoiled": draw_spoiled, "beam": draw_beam, "watch": draw_watch,
    "calibration": draw_calibration,
}  # fmt: skip
