# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The data of pictures and page, computed once: the run, the closed damper beside it, stages, the headline."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from atpid_control.runs.run import Run, open_run
from atpid_control.runs.tables import TRUTH
from atpid_control.views.report.stages import (
    Printed,
    Stage,
    beside,
    closed_height,
    closed_motion,
    measure,
    per_cent,
    true_excitation,
)
from atpid_sim.simulation.quantities import largest_decrement
from atpid_sim.system import Array

#: How many periods of the grain's motion are shown.
_PERIODS = 4.0


@dataclass(frozen=True)
class View:
    """A run and its comparison."""

    run: Run
    beam: Array  # (n,) displacement from rest [m]
    closed: Array | None  # (n,) the same with the damper closed [m]
    true_amplitude: Array | None  # (n,) [m], of a force [N]
    true_frequency: Array | None  # (n,) [Hz]
    stages: list[Stage]
    windows: list[tuple[float, float]]  # where each stage is measured [s]
    printed: list[Printed] | None  # the thesis's stages, where this is its bench
    decrements: tuple[float, float] | None  # free decay: largest ratio of successive peaks, damper and closed

    @property
    def drawn_truth(self) -> bool:
        """Whether what is shown is the simulated plant's own motion."""
        return self.run.motion.origin == TRUTH

    @property
    def reach(self) -> float:
        """How far the beam gets from rest, closed damper included [m]."""
        both = [self.beam] if self.closed is None else [self.beam, self.closed]
        return max(float(np.nanmax(np.abs(series))) for series in both)

    @property
    def moving(self) -> bool:
        """Whether there is a ceiling's motion to show: where it went, or at least where it was sent."""
        ceiling = self.run.ceiling
        known = self.drawn_truth or bool(np.isfinite(np.append(ceiling.height, self.run.commands.height)).any())
        return self.standing is None and known

    @property
    def standing(self) -> float | None:
        """Height of a fixed ceiling [m]; None where it moves, or its position is unknown."""
        seen = self.run.motion.ceiling if self.drawn_truth else self.run.ceiling.height
        seen = seen[np.isfinite(seen)]
        return float(seen[-1]) if len(seen) and float(np.ptp(seen)) <= 1e-6 else None

    @property
    def always_closed(self) -> bool:
        """Whether the damper is closed all the time, so that there is nothing to compare."""
        scene, height = self.run.scene, self.standing
        return scene is not None and height is not None and height <= closed_height(scene) + 1e-9

    @property
    def own_name(self) -> str:
        """What to call the run beside the closed damper."""
        if self.always_closed:
            return "closed"
        scene = self.run.scene
        return "adaptive" if scene is not None and scene.ceiling.controlled else "damper"

    @property
    def grain_window(self) -> tuple[float, float] | None:
        """Which periods of the grain's motion to show [s]; None where it is unknown."""
        if not self.drawn_truth or self.run.scene is None or self.always_closed:
            return None
        length = _PERIODS / self.run.scene.frequency_hz
        if self.decrements is not None:
            return 0.0, min(length, self.run.duration)
        measured = zip(self.stages, self.windows, strict=True)
        ends = [end for stage, (_, end) in measured if math.isfinite(stage.amplitude)]
        end = ends[-1] if ends else self.run.duration
        return max(0.0, end - length), end


def view_of(source: Path | Run) -> View:
    """Return what a report of a recorded run shows. Raises BagError."""
    run = source if isinstance(source, Run) else open_run(source)
    baseline = closed_motion(run)
    stages, windows = measure(run, baseline)
    amplitude, frequency = true_excitation(run)
    rest = run.scene.static_deflection if run.scene is not None else -float(np.nanmean(run.motion.beam))
    beam = run.motion.beam + rest
    still = baseline + rest if baseline is not None else None
    free = run.scene is not None and run.scene.excitation.is_free and still is not None
    return View(
        run=run,
        beam=beam,
        closed=still,
        true_amplitude=amplitude,
        true_frequency=frequency,
        stages=stages,
        windows=windows,
        printed=beside(run, stages),
        decrements=(largest_decrement(beam), largest_decrement(still)) if free and still is not None else None,
    )


def origin_of(view: View) -> list[str]:
    """Return the scene of a run, when it was recorded, and how long it took, as far as they are known."""
    about = view.run.about
    created = about.get("created", "")[:16].replace("T", " ")
    parts = (about.get("scene", "no scene"), created, f"{view.run.duration:.4g} s")
    return [part for part in parts if part]


def headline(view: View) -> str:
    """Return the run's result in one sentence."""
    if view.always_closed:
        return "The damper stays closed: beam and grain move as one mass."
    if view.decrements is not None:
        fall = "After the release successive peaks fall by a factor of up to {:.2f}; with the damper closed by {:.2f}."
        return fall.format(*view.decrements)
    known = [stage for stage in view.stages if math.isfinite(stage.efficiency)]
    if not known:
        return "The recorded run."
    today, closed = (
        (min(low for low, _ in ranges), max(high for _, high in ranges))
        for ranges in ([stage.reduction_range for stage in known], [stage.efficiency_range for stage in known])
    )
    who = "A damper that follows the excitation" if view.own_name == "adaptive" else "The damper"
    irregular = any(stage.amplitude_spread for stage in known)
    note = "; the motion is irregular, and single runs differ by that much" if irregular and len(known) == 1 else ""
    note = "; where the motion is irregular, by the spread of single runs" if irregular and len(known) > 1 else note
    against = f"{per_cent(closed)} against the damper closed{note}"
    if round(100.0 * today[0]) < 0:
        worst = f"the beam moves by up to {-100.0 * today[0]:.0f} % more than without the damper"
        return f"{who}: {worst}; the efficiency is {against}."
    return f"{who} reduces the beam's amplitude by {per_cent(today)} against the structure without it, by {against}."


def not_arrived(view: View) -> list[str]:
    """Return one sentence for each stage in which the ceiling was not where it had been commanded to."""
    scene = view.run.scene
    speed = f" (speed {1e3 * scene.ceiling.speed:g} mm/s)" if scene is not None and scene.ceiling.controlled else ""
    return [
        f"{stage.t0:g} to {stage.t1:g} s: {1e3 * stage.commanded_height:.4g} mm was commanded and not reached; "
        f"the ceiling was at {1e3 * stage.height:.4g} mm{speed}"
        for stage in view.stages
        if not stage.arrived
    ]
