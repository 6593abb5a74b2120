# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scene of a run whose excitation was commanded, with the tone that was put out in place of the largest one."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from atpid_control.runs.tables import TIME, Columns
from atpid_sim.scene import Scene

#: Points nearer than this share of the largest value to the line through their neighbours are left out.
_STRAIGHT = 1e-3


def as_put_out(scene: Scene, messages: Callable[[str], Columns]) -> Scene:
    """Return the scene with the tone that the plant had, else that the exciter reported, as points.

    messages: returns the fields of all messages of a type. The frequency counts where there is an amplitude.
    """
    for kind, prefix in (("PlantTruth", "excitation_"), ("ExcitationState", "")):
        fields = messages(kind)
        if f"{prefix}amplitude" in fields:
            break
    else:
        return scene
    late = fields["scans"] / fields["rate"] if "scans" in fields else 0.0  # a block's value is that of its end
    time, amplitude, frequency = fields[TIME] + late, fields[f"{prefix}amplitude"], fields[f"{prefix}frequency"]
    rising = (np.diff(time, prepend=-1.0) > 0.0) & (time > 0.0)
    usable = rising & np.isfinite(amplitude) & np.isfinite(frequency)
    time, amplitude, frequency = time[usable], amplitude[usable], frequency[usable]
    on = (amplitude > 0.0) & (frequency > 0.0)
    if not on.any():
        return scene.with_(excitation={"amplitude": 0.0, "frequency": scene.frequency_hz})
    frequencies = _corners(time, np.interp(time, time[on], frequency[on]))
    tone = [[0.0, frequencies[0][1]], *frequencies] if len(frequencies) > 1 else frequencies[0][1]
    return scene.with_(excitation={"amplitude": [[0.0, 0.0], *_corners(time, amplitude)], "frequency": tone})


def _corners(time: NDArray[np.float64], values: NDArray[np.float64]) -> list[list[float]]:
    """Return the points [time, value] between which the values are straight; one where they are constant."""
    limit = _STRAIGHT * np.abs(values).max()
    if np.ptp(values) <= limit:
        return [[float(time[0]), float(values[0])]]
    kept = [0]
    for k in range(1, len(values) - 1):
        last = kept[-1]
        inner = np.arange(last + 1, k + 1)
        line = np.interp(time[inner], [time[last], time[k + 1]], [values[last], values[k + 1]])
        if np.abs(values[inner] - line).max() > limit:
            kept.append(k)
    return [[float(time[k]), float(values[k])] for k in (*kept, len(values) - 1)]
