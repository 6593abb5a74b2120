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
        if invalid := self.signals.invalid:
            what = f"{invalid} of {len(self.signals.response)} samples are lost or invalid"
            lines.append(f"{what}; nothing is computed over their gaps")
        return lines

    def to_json(self) -> Document:
        """Return numbers and curves as plain values, SI units; NaN as None."""
        made = _taken(self.signals, "names units origin rate start duration invalid")
        made["begin"] = made.pop("start")
        made |= {"spectrum": self._spectra(), "frequency_response": self.response and _of_response(self.response)}
        made["decrement"] = self.decay and _taken(self.decay, _OF_DECAY)
        made["orders"] = self.orders and _taken(self.orders, _OF_ORDERS)
        return dict(finite(made | {"doubts": self.doubts, "skipped": self.skipped}))

    def _spectra(self) -> Document:
        one, other = self.spectra
        made = _taken(one, "resolution averages enbw frequency") | {"rms": [one.rms, other.rms]}
        return made | {"excitation_density": one.density.tolist(), "response_density": other.density.tolist()}


#: What the results have of a decay and of orders, by the names there.
_OF_DECAY = """begin end frequency frequency_std damping_ratio damping_ratio_std log_decrement log_decrement_std
    amplitude residual ratios"""
_OF_ORDERS = "begin end frequency excitation residual distortion amplitude amplitude_std phase"


def _taken(part: object, names: str) -> Document:
    """Return attributes of `part` as plain values."""
    values = ((name, getattr(part, name)) for name in names.split())
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values}


def _of_response(found: FrequencyResponse) -> Document:
    place = found.strongest
    sizes = {"h1": np.abs(found.h1), "h2": np.abs(found.h2), "phase": np.angle(found.h1)}
    curves = sizes | {name: getattr(found, name) for name in ("coherence", "relative_std", "trusted")}
    peak = curves | {"frequency": found.frequency, "phase_std": found.phase_std}
    return {
        "method": "averages" if found.local is None else "local models",
        "averages": found.averages,
        "trusted_lines": int(found.trusted.sum()),
        "excited_lines": int(found.excited.sum()),
        **{f"peak_{name}": values[place].item() for name, values in peak.items()},
        **{f"peak_{name}": float(abs(values[place])) for name, values in (("h1", found.h1), ("h2", found.h2))},
        "frequency": found.frequency.tolist(),
        **{name: values.tolist() for name, values in curves.items()},
    }


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
    channels = zip(values, signals.units, strict=True)
    made = [spectrum(one, signals.rate, resolution, shape, unit) for one, unit in channels]
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
