# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two signals sampled together, NaN where a sample was lost, and their parts without a gap."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from atpid_common.errors import InputError
from atpid_control.runs.run import BEAM, Run
from atpid_sim.system import Array


class AnalysisError(InputError):
    """Signals that cannot be analysed as asked: what was given, what is needed, what to do."""


@dataclass(frozen=True)
class Signals:
    """What excites and what answers (n,), NaN where a sample was lost or is invalid."""

    rate: float  # [Hz]
    excitation: Array  # (n,) the support's displacement or the force, unless chosen otherwise
    response: Array  # (n,) the beam's
    units: tuple[str, str] = ("m", "m")
    names: tuple[str, str] = ("support_displacement", "beam_displacement")
    start: float = 0.0  # time of the first sample [s]
    origin: str = ""  # what measured them, such as `laser`; empty: not from a recording
    start_ns: int = 0  # stamp of the first sample
    delay: float = 0.0  # by which each sample of the response was taken after that of the excitation [s]
    clock_error: float = 0.0  # its standard deviation, of two devices, but for the least delays [s]; NaN: unknown

    @property
    def duration(self) -> float:
        """Length, gaps included [s]."""
        return len(self.response) / self.rate

    @property
    def time(self) -> Array:
        """Times of the samples (n,) [s]."""
        return self.start + np.arange(len(self.response)) / self.rate

    @property
    def invalid(self) -> int:
        """Samples of which one of the two is missing."""
        return int(np.count_nonzero(~np.isfinite(self.excitation + self.response)))

    def between(self, begin: float, end: float) -> Signals:
        """Return the part from `begin` to `end` [s]. Raises AnalysisError: no such part."""
        first = math.ceil((max(begin, self.start) - self.start) * self.rate - 1e-6)
        last = len(self.response) if math.isinf(end) else math.floor((end - self.start) * self.rate + 1e-6) + 1
        if not first < min(last, len(self.response)):
            until = self.start + self.duration
            raise AnalysisError(
                f"--from {begin:g} --to {end:g}: allowed: rising times from {self.start:g} to {until:g} s"
            )
        return replace(self, excitation=self.excitation[first:last], response=self.response[first:last],
                       start=self.start + first / self.rate)  # fmt: skip


def signals_of(
    run: Run, given: str = "", measured: str = BEAM, *, both: bool = True
) -> tuple[Signals, list[str]]:  # fmt: skip
    """Return what sensors measured in a run, at the same instants, and what is missing, a line each.

    given: empty: what drives the structure. Raises BagError: no samples of `measured`, or where it has to be `both` of
    `given`; else NaN stands in its place.
    """
    given = given or run.drive.channel
    excitation, response = run.signals(given, measured) if both else run.driven(given, measured)
    units = excitation.unit, response.unit
    signals = Signals(response.rate, excitation.values, response.values, units, (given, measured), response.time0,
                      response.origin, response.start_ns, response.skew - excitation.skew,
                      math.hypot(excitation.clock_error, response.clock_error))  # fmt: skip
    return signals, [*run.missing, *response.others]


def runs(valid: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of the parts of booleans (n,) that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.asarray(valid, dtype=np.int8), [0]))))
    yield from ((int(begin), int(end)) for begin, end in edges.reshape(-1, 2))
