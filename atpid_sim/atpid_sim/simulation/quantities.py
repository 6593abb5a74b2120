# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a motion is measured by, as pure functions over series, simulated or recorded.

Half peak-to-peak, efficiency (Eq. 3.74), decrements of a free decay (Eq. 2.1, section 2.3.1), the spectrum of a
displacement (Figs 3.7 and 3.8).
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from atpid_sim.kernel_inputs import system_of
from atpid_sim.scene import Scene
from atpid_sim.system import Array, structure_of

#: Peaks below this share of the first are noise and rest, not decay.
_SMALLEST = 0.02
#: Zeros appended, in lengths of the signal: the spectrum is then read between its bins.
_PADDING = 8


def half_peak_to_peak(displacement: Array) -> float:
    """Return half the range of a displacement (n,) [m], NaN left out; NaN where there is nothing else."""
    known = displacement[np.isfinite(displacement)]
    return float(0.5 * np.ptp(known)) if len(known) else math.nan


def amplitudes_per_period(displacement: Array, samples: float) -> Array:
    """Return half the range (k,) [m] of a displacement (n,) [m] in each whole period of `samples` samples."""
    edges = np.rint(samples * np.arange(int(len(displacement) / samples) + 1)).astype(int)
    return np.array([half_peak_to_peak(displacement[begin:end]) for begin, end in pairwise(edges)])


class ModeShown(NamedTuple):
    """A mode of a scene's structure, as summary and report show it."""

    frequency: float  # without damping and grain [Hz]
    held_frequency: float  # with the grain held at the container [Hz]
    mass: float  # that an impulse at the container meets [kg]
    damping_ratio: float  # [-]
    drive_factor: float  # its part of the support's motion, or of the force over that of beam [-]


def modes_in(scene: Scene) -> list[ModeShown]:
    """Return the modes of a scene's structure, by rising frequency."""
    free, joined = (structure_of(system_of(scene), held=held) for held in (False, True))
    ratios = 0.5 * free.damping / np.sqrt(free.stiffness * free.mass)
    factors = free.direct / free.stiffness if scene.drive == "support" else free.direct
    rows = np.stack([free.frequencies, free.mass, ratios, factors], axis=1)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return [
        ModeShown(float(row[0]), float(low), *map(float, row[1:]))
        for row, low in zip(rows, np.sort(joined.frequencies), strict=True)
    ]


def efficiency(damped: float, undamped: float) -> float:
    """Return the share by which an amplitude [m] lies below another [m] (Eq. 3.74) [-]; NaN: that is 0.

    Against the closed damper it is called efficiency, against the structure without the damper reduction.
    """
    return 1.0 - damped / undamped if undamped > 0.0 else math.nan


def worse_than_without(reduction: float) -> list[str]:
    """Return a warning where the damper makes it worse, which is a reduction [-] below 0; else nothing."""
    if not reduction < 0.0:
        return []
    return [f"the structure moves by {-100.0 * reduction:.3g} % more than it does without the damper"]


def peaks(displacement: Array) -> Array:
    """Return the upper peaks (k,) [m] of a displacement (n,) from rest [m]: the highest point of each upward swing.

    One per swing above zero, so that an impact's ripple makes no second peak.
    """
    above = displacement > 0.0
    edges = np.flatnonzero(np.diff(above.astype(np.int8))) + 1
    swings = np.split(displacement, edges)
    return np.array([swing.max() for swing in swings if len(swing) and swing[0] > 0.0])


def largest_decrement(displacement: Array) -> float:
    """Return the largest ratio of successive upper peaks [-]; NaN where there are fewer than two."""
    found = decrements(displacement)
    return float(np.max(found)) if len(found) else math.nan


def decrements(displacement: Array) -> Array:
    """Return the ratios of successive upper peaks (k,) [-] of a displacement from rest (n,) [m] (Eq. 2.1)."""
    found = peaks(displacement)
    found = found[found > _SMALLEST * found[0]] if len(found) else found
    return np.asarray(found[:-1] / found[1:])


def amplitude_spectrum(displacement: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies (m,) [Hz] and amplitudes (m,) [m] of a displacement (n,) [m] sampled at `rate` [Hz].

    The mean is removed; the signal is neither windowed nor scaled beyond 2 / n, so that a tone over whole periods has
    its own amplitude.
    """
    count = len(displacement)
    spectrum = np.abs(np.fft.rfft(displacement - displacement.mean(), _PADDING * count))
    frequencies = np.fft.rfftfreq(_PADDING * count, 1.0 / rate)
    return np.asarray(frequencies, dtype=float), 2.0 * spectrum / count
