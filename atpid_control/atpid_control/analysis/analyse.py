# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""All analyses of a record together: what can be computed, and why the rest cannot."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from atpid_common.files import Document
from atpid_common.output import finite
from atpid_control.analysis.decrement import Decay, find_decay, free_decay
from atpid_control.analysis.frequency_response import FrequencyResponse, frequency_response
from atpid_control.analysis.orders import Orders, orders, steady_part
from atpid_control.analysis.signals import AnalysisError, Signals
from atpid_control.analysis.spectra import Spectrum, spectrum

_Found = TypeVar("_Found")


@dataclass(frozen=True)
class Analysis:
    """What was found in a record; None with its reason in `skipped` where it cannot be computed."""

    signals: Signals
    spectra: tuple[Spectrum, Spectrum]  # of excitation and response
    response: FrequencyResponse | None
    decay: Decay | None
    orders: Orders | None
    skipped: dict[str, str] = field(default_factory=dict)

    @property
    def doubts(self) -> list[str]:
        """What cannot be trusted, a line each."""
        parts = (("frequency response", self.response), ("decrement", self.decay), ("orders", self.orders))
        lines = [f"{name}: {line}" for name, part in parts if part is not None for line in part.doubts]
        if self.signals.invalid:
            lines.append(f"{self.signals.invalid} of {len(self.signals.response)} samples are lost or invalid; nothing "
                         "is computed over their gaps")  # fmt: skip
        return lines

    def to_json(self) -> Document:
        """Return numbers and curves as plain values, SI units; NaN as None."""
        return dict(finite({
            "names": list(self.signals.names), "units": list(self.signals.units), "origin": self.signals.origin,
            "rate": self.signals.rate, "begin": self.signals.start, "duration": self.signals.duration,
            "invalid": self.signals.invalid,
            "spectrum": self._spectra(), "frequency_response": self._response(), "decrement": self._decay(),
            "orders": self._orders(), "doubts": self.doubts, "skipped": self.skipped,
        }))  # fmt: skip

    def _spectra(self) -> Document:
        one, other = self.spectra
        return {
            "resolution": one.resolution, "averages": one.averages, "enbw": one.enbw, "rms": [one.rms, other.rms],
            "frequency": one.frequency.tolist(), "excitation_density": one.density.tolist(),
            "response_density": other.density.tolist(),
        }  # fmt: skip

    def _response(self) -> Document | None:
        found = self.response
        if found is None:
            return None
        place = found.strongest
        return {
            "method": "averages" if found.local is None else "local models",
            "averages": found.averages, "trusted_lines": int(found.trusted.sum()),
            "excited_lines": int(found.excited.sum()), "peak_frequency": float(found.frequency[place]),
            "peak_h1": float(abs(found.h1[place])), "peak_h2": float(abs(found.h2[place])),
            "peak_phase": float(np.angle(found.h1[place])), "peak_coherence": float(found.coherence[place]),
            "peak_phase_std": float(found.phase_std[place]),
            "peak_relative_std": float(found.relative_std[place]),
            "peak_trusted": bool(found.trusted[place]),
            "frequency": found.frequency.tolist(), "h1": np.abs(found.h1).tolist(), "h2": np.abs(found.h2).tolist(),
            "phase": np.angle(found.h1).tolist(), "coherence": found.coherence.tolist(),
            "relative_std": found.relative_std.tolist(), "trusted": found.trusted.tolist(),
        }  # fmt: skip

    def _decay(self) -> Document | None:
        found = self.decay
        if found is None:
            return None
        names = ("begin", "end", "frequency", "frequency_std", "damping_ratio", "damping_ratio_std", "log_decrement",
                 "log_decrement_std", "amplitude", "residual")  # fmt: skip
        return {name: getattr(found, name) for name in names} | {"ratios": found.ratios.tolist()}

    def _orders(self) -> Document | None:
        found = self.orders
        if found is None:
            return None
        names = ("begin", "end", "frequency", "excitation", "residual", "distortion")
        curves = {name: getattr(found, name).tolist() for name in ("amplitude", "amplitude_std", "phase")}
        return {name: getattr(found, name) for name in names} | curves


def analyse(signals: Signals, resolution: float | None = None, window: str = "", whole: bool = False) -> Analysis:
    """Return all that can be computed of a record.

    Spectra and frequency response take all of it; the orders its last part of constant excitation, all of it where
    `whole`; the decrement the longest part in which nothing excites. Raises AnalysisError where the record is
    too short for the resolution asked, or nothing moves.
    """
    if not np.isfinite(signals.response).any() or not np.nanmax(signals.response) > np.nanmin(signals.response):
        raise AnalysisError(f"{signals.names[1]} is constant: nothing to analyse; choose another with --output")
    known = np.isfinite(signals.excitation).any()
    shape = window if window not in ("", "local") else "hann"
    values = (signals.excitation if known else np.zeros(len(signals.response)), signals.response)
    made = [
        spectrum(one, signals.rate, resolution, shape, unit) for one, unit in zip(values, signals.units, strict=True)
    ]
    skipped: dict[str, str] = {}
    decay_at = find_decay(signals.excitation, signals.response, signals.rate)

    def part_of_decay() -> Decay:
        if decay_at is None:
            raise AnalysisError(f"no free decay: the beam does not swing out while {signals.names[0]} is at rest")
        begin, end = decay_at
        return free_decay(signals.response[begin:end], signals.rate, signals.start + begin / signals.rate)

    def excited(compute: Callable[[], _Found]) -> Callable[[], _Found]:
        def found() -> _Found:
            if not known or (decay_at is not None and decay_at[1] - decay_at[0] > 0.8 * len(signals.response)):
                raise AnalysisError(f"no excitation: {signals.names[0]} is at rest")
            return compute()

        return found

    response = _tried("frequency_response", excited(lambda: frequency_response(signals, resolution, window)), skipped)
    found = _tried("orders", excited(lambda: orders(signals if whole else steady_part(signals))), skipped)
    decay = _tried("decrement", part_of_decay, skipped)
    return Analysis(signals, (made[0], made[1]), response, decay, found, skipped)


def _tried(name: str, compute: Callable[[], _Found], skipped: dict[str, str]) -> _Found | None:
    try:
        return compute()
    except AnalysisError as error:
        skipped[name] = str(error)
        return None
