# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded signal: read and bounded by the program that commands it, bounded again by the node that puts it out."""

from pathlib import Path

import numpy as np

from atpid_common.files import FileError, read_text
from atpid_exciter.excitation.limits import CommandRefusedError, Floats

#: Largest file [bytes], most samples, longest signal [s]; largest rate, so the shortest step between two times [Hz].
_MOST_BYTES, MOST_SAMPLES, LONGEST, _FASTEST = 20_000_000, 1_000_000, 600.0, 50_000.0


def read_recorded(path: Path) -> tuple[float, Floats]:
    """Return the rate [Hz] and the samples (n,) of a text file with two columns, time [s] and value.

    They are taken at the shortest step of its times, without their mean, with a peak of 1. Raises FileError.
    """
    text = read_text(path, _MOST_BYTES)
    try:
        table = _table(text, "," if path.suffix.lower() == ".csv" else None)
        if table.shape[1] != 2 or len(table) < 2 or not np.isfinite(table).all():
            raise ValueError("all numbers have to be finite")
        times, values = table.T
        steps = np.diff(times)
        rate = 1.0 / steps.min() if steps.min() > 0.0 else np.inf
        if rate > _FASTEST or (length := times[-1] - times[0]) > LONGEST or length * rate > MOST_SAMPLES:
            raise ValueError(f"its times have to rise by {1.0 / _FASTEST:g} s at least, over {LONGEST:g} s at most, to "
                             f"at most {MOST_SAMPLES} samples of the shortest step")  # fmt: skip
        return float(rate), scaled(np.interp(np.arange(times[0], times[-1], 1.0 / rate), times, values))
    except ValueError as error:
        reason = str(error).splitlines()[0]
        raise FileError(f"{path}: allowed: two columns, time [s] and value ({reason})") from None


def resampled(values: Floats, rate: float, at: float) -> Floats:
    """Return `values` (n,) at `rate` [Hz] as samples at the rate `at` [Hz], without their mean, with a peak of 1.

    Raises CommandRefusedError for what is no number, or too much of it.
    """
    length = len(values) / rate
    if not np.isfinite(values).all() or not 0.0 < length <= LONGEST or len(values) > MOST_SAMPLES:
        raise CommandRefusedError(
            f"signal: given {len(values)} samples over {length:g} s; allowed: finite numbers, at most {MOST_SAMPLES}, "
            f"at most {LONGEST:g} s"
        )
    times = np.arange(len(values)) / rate
    try:
        return scaled(np.interp(np.arange(0.0, times[-1], 1.0 / at), times, values))
    except ValueError as error:
        raise CommandRefusedError(f"signal: {error}") from None


def scaled(values: Floats) -> Floats:
    """Return `values` (n,) without their mean, with a peak of 1. Raises ValueError where they do not move."""
    largest = np.abs(values).max(initial=0.0)
    within = values / largest if largest else values  # sums of the largest numbers have no place
    moving = within - (within.mean() if len(within) else 0.0)
    peak = np.abs(moving).max(initial=0.0)
    if not peak > 0.0:
        raise ValueError("the signal does not move; allowed: one that does")
    return np.asarray(moving / peak)


def _table(text: str, delimiter: str | None) -> Floats:
    """Return the numbers (n, m) of a text, whose first line may be a heading. Raises ValueError."""
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 2:
        raise ValueError(f"{len(lines)} lines")
    try:
        return np.loadtxt(lines, delimiter=delimiter, ndmin=2)
    except ValueError:
        return np.loadtxt(lines[1:], delimiter=delimiter, ndmin=2)
