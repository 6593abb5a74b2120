# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The support's motion in a bag, or the force that drives, as a series a scene's `excitation.series` takes."""

import math
from pathlib import Path

import numpy as np

from atpid_control.runs.errors import BagError, in_words
from atpid_control.runs.run import Run
from atpid_sim.system import Array

FILE_NAME = "support.csv"


def support_series(run: Run, begin: float = 0.0, end: float = math.inf) -> tuple[Array, Array]:
    """Return times (n,) of the run [s] and support's displacements [m] or forces [N] (n,), from `begin` to `end` [s].

    Times are index / rate: stamps jitter, indices prove that nothing is missing. `run` is read from `begin` to `end`.
    Raises BagError: no such channel, or scans that are lost, invalid or of two streams in between.
    """
    signal = run.signal(run.drive.channel)
    time = signal.time
    inside = (time >= begin) & (time <= end)
    if not inside.any():
        span = f"allowed: times from {time[0]:g} to {time[-1]:g} s"
        raise BagError(f"{run.path}: no scan from {begin:g} to {end:g} s; {span}")
    invalid = time[inside & ~np.isfinite(signal.values)]
    if len(invalid):
        raise BagError(f"{run.path}: {signal.name} is lost or invalid at {invalid[0]:g} s; {_advice(invalid[0])}")
    if signal.others:
        raise BagError(f"{run.path}: {signal.topic} starts anew: {signal.others[0]}; {_advice(time[-1])}")
    return time[inside], signal.values[inside]


def write_support(run: Run, folder: Path, begin: float = 0.0, end: float = math.inf) -> str:
    """Write the series as `folder`/support.csv and return a line about it. Raises BagError."""
    path = folder / FILE_NAME
    if path.exists():
        raise BagError(f"{path}: exists already and is not written over; give another folder with --out")
    times, values = support_series(run, begin, end)
    drive = run.drive
    lines = [f"time,{drive.channel}", *(f"{t!r},{u!r}" for t, u in zip(times.tolist(), values.tolist(), strict=True))]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise BagError(f"{path}: cannot be written: {in_words(error)}") from None
    lasts = times[-1] - times[0]
    span = f"{len(times)} samples over {lasts:g} s, from {values.min():g} to {values.max():g} {drive.unit}"
    return f"{path}: {span}, of {run.signal(drive.channel).origin}"


def _advice(at: float) -> str:
    return f"take a part without it, --support FROM:TO with TO below or FROM above {at:g}"
