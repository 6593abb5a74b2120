# SPDX-License-Identifier: Apache-2.0
"""Settings of the identification; docs/identification.md explains how each value was chosen."""

from __future__ import annotations

import math
from dataclasses import dataclass

from atpid_common.errors import InputError


class IdentificationError(InputError):
    """Settings, or samples, that cannot be used."""


@dataclass(frozen=True)
class Settings:
    """Limits of the search and of quality; none has a physical default, the parameter file has the values."""

    window_periods: float  # length of the sliding window in periods of the tone, one at least
    lowest_frequency: float  # [Hz]
    highest_frequency: float  # [Hz]
    mains_frequency: float  # hum that joins the fit where it is present [Hz], 0: none
    least_amplitude: float  # a tone smaller than this is no signal [m]
    saturation: tuple[float, float] | None  # at or beyond these a sample is not valid [m]
    change: float  # relative change of a steady amplitude that counts as one [-]
    change_likelihood: float  # log-likelihood from which a tone counts as changing within the window [-]
    poor_residual: float  # residual over amplitude from which an estimate is poor [-]
    poor_harmonics: float  # harmonics over amplitude from which an estimate is poor [-]
    poor_lost: float  # share of lost samples from which an estimate is poor [-]
    analysis_rate: float  # streams of twice this rate and more are averaged down to it [Hz]

    def __post_init__(self) -> None:
        """Refuse what contradicts itself."""
        limits = {
            "window_periods": (self.window_periods, self.window_periods >= 1.0, "at least 1"),
            "lowest_frequency": (self.lowest_frequency, 0.0 < self.lowest_frequency < math.inf, "above 0 Hz"),
            "highest_frequency": (
                self.highest_frequency,
                self.lowest_frequency < self.highest_frequency <= self.analysis_rate / 8.0,
                f"above lowest_frequency and at most analysis_rate / 8 = {self.analysis_rate / 8.0:g} Hz",
            ),
            "mains_frequency": (self.mains_frequency, self.mains_frequency >= 0.0, "0 (none) or above"),
            "least_amplitude": (self.least_amplitude, self.least_amplitude >= 0.0, "at least 0 m"),
            "change": (self.change, 0.0 < self.change < 1.0, "between 0 and 1"),
            "change_likelihood": (self.change_likelihood, self.change_likelihood > 0.0, "above 0"),
            "poor_residual": (self.poor_residual, self.poor_residual > 0.0, "above 0"),
            "poor_harmonics": (self.poor_harmonics, self.poor_harmonics > 0.0, "above 0"),
            "poor_lost": (self.poor_lost, 0.0 < self.poor_lost <= 1.0, "above 0 and at most 1"),
        }
        for name, (given, fine, allowed) in limits.items():
            if not fine:
                raise IdentificationError(f"{name}: given {given:g}; allowed: {allowed}")
        if self.saturation is not None and not self.saturation[0] < self.saturation[1]:
            raise IdentificationError(f"saturation: given {self.saturation}; allowed: lower below upper limit [m]")
