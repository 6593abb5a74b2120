# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What was measured: support, beam and ceiling of a part of a recording."""

import math
from dataclasses import dataclass

import numpy as np

from atpid_common.errors import InputError
from atpid_common.vocabulary import DRIVES, Drive
from atpid_control.analysis.signals import Signals, runs, signals_of
from atpid_control.runs.run import BEAM, Run
from atpid_sim.scene import Scene, SceneError
from atpid_sim.system import Array

#: Samples below which nothing is compared: a cubic spline and an initial velocity need more.
_FEWEST = 100


class ValidationError(InputError):
    """A recording that cannot be simulated: what is missing in it, and what to give."""


@dataclass(frozen=True)
class Measured:
    """Samples (n,) at `rate` [Hz]; height of the ceiling (k, 2) [s, m], None where it was not recorded."""

    rate: float
    support: Array  # displacement [m], of a force that drives instead [N]
    beam: Array  # displacement [m]
    ceiling: Array | None
    begin: float = 0.0  # of the part, in the recording [s]
    chosen: bool = False  # as the longest part without a gap
    origin: str = ""  # of the samples, such as `laser`
    drive: Drive = DRIVES["support"]
    missing: tuple[str, ...] = ()  # what is not in the recording and should be, a line each

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return (len(self.beam) - 1) / self.rate


def read_measured(run: Run, begin: float = -math.inf, end: float = math.inf) -> Measured:
    """Return the part from `begin` to `end` [s] of a recording; of a whole one with gaps the longest without.

    Raises ValidationError where there is none, or where a part that was chosen has gaps.
    """
    whole, missing = signals_of(run, both=False)
    if not np.isfinite(whole.excitation).any():
        raise ValidationError(f"{run.path}: {run.drive.channel} was not recorded, so nothing can drive the scene")
    part = _without_gap(whole) if math.isinf(begin) and math.isinf(end) else whole.between(begin, end)
    if len(part.response) < _FEWEST:
        raise ValidationError(f"{run.path}: {len(part.response)} samples in that part; needed: {_FEWEST}")
    for name, series in ((run.drive.channel, part.excitation), (BEAM, part.response)):
        gaps = np.flatnonzero(~np.isfinite(series))
        if len(gaps):
            at = part.start + gaps[0] / part.rate
            raise ValidationError(
                f"{run.path}: {name} is missing or invalid at {at:g} s; choose a part with --from, --to"
            )
    heights = np.column_stack([run.ceiling.time - part.start, run.ceiling.height])
    heights = heights[np.isfinite(heights).all(axis=1)]
    heights = heights[np.argsort(heights[:, 0], kind="stable")]
    chosen = math.isinf(begin) and math.isinf(end) and len(part.response) < len(whole.response)
    return Measured(part.rate, part.excitation, part.response, heights if len(heights) else None, part.start, chosen,
                    part.origin, run.drive, tuple(missing))  # fmt: skip


def _without_gap(whole: Signals) -> Signals:
    """Return the longest part in which support and beam are valid; all where nothing is."""
    parts = runs(np.isfinite(whole.excitation + whole.response))
    first, last = max(parts, key=lambda part: part[1] - part[0], default=(0, len(whole.response)))
    return whole.between(whole.start + first / whole.rate, whole.start + (last - 1) / whole.rate)


def scene_of(run: Run) -> Scene:
    """Return the scene kept in the run; raise SceneError or ValidationError where there is none."""
    if run.scene is not None:
        return run.scene
    if run.scene_text is None:
        raise ValidationError(f"{run.path}: no scene was recorded; give one with --scene")
    raise SceneError(f"{run.scene_problem}; give a scene with --scene")
