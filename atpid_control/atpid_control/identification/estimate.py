# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings and result of the identification: docs/identification.md explains each value, Excitation.msg the fields."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from math import nan

from atpid_common.errors import InputError
from atpid_common.vocabulary import Origin, Quality

#: Unit of a channel whose tone is divided by the square of its angular frequency.
ACCELERATION = "m/s^2"
#: Relative standard deviation from which a displacement is not inferred from an acceleration [-].
_VAGUE = 0.05


class IdentificationError(InputError):
    """Settings, or samples, that cannot be used."""


@dataclass(frozen=True)
class Settings:
    """Limits of the search and of quality; none has a physical default, the parameter file has the values."""

    window_periods: float  # length of the sliding window in periods of the tone, one at least
    lowest_frequency: float  # [Hz]
    highest_frequency: float  # [Hz]
    mains_frequency: float  # hum that joins the fit where it is present [Hz], 0: none
    least_amplitude: float  # a tone smaller than this is no signal [m, of a force N]
    saturation: tuple[float, float] | None  # at or beyond these a sample is not valid [m, of a force N]
    change: float  # relative change of a steady amplitude that counts as one [-]
    change_likelihood: float  # log-likelihood from which a tone counts as changing within the window [-]
    poor_residual: float  # residual over amplitude from which an estimate is poor [-]
    poor_harmonics: float  # harmonics over amplitude from which an estimate is poor [-]
    poor_lost: float  # share of lost samples from which an estimate is poor [-]
    analysis_rate: float  # streams of twice this rate and more are averaged down to it [Hz]
    second_tone: float = 0.0  # amplitude over the first's from which another tone spoils the estimate; 0: none does [-]
    slow_drift: float = 0.0  # relative rate of a frequency up to which its tone is steady, not another one [1/s]

    def __post_init__(self) -> None:
        top = self.analysis_rate / 8.0
        highest = f"above lowest_frequency and at most analysis_rate / 8 = {top:g} Hz"
        limits = {
            "window_periods": (self.window_periods >= 1.0, "at least 1"),
            "lowest_frequency": (0.0 < self.lowest_frequency < math.inf, "above 0 Hz"),
            "highest_frequency": (self.lowest_frequency < self.highest_frequency <= top, highest),
            "mains_frequency": (self.mains_frequency >= 0.0, "0 (none) or above"),
            "least_amplitude": (self.least_amplitude >= 0.0, "at least 0"),
            "change": (0.0 < self.change < 1.0, "between 0 and 1"),
            "change_likelihood": (self.change_likelihood > 0.0, "above 0"),
            "poor_residual": (self.poor_residual > 0.0, "above 0"),
            "poor_harmonics": (self.poor_harmonics > 0.0, "above 0"),
            "slow_drift": (0.0 <= self.slow_drift < 1.0, "at least 0 and below 1"),
            "second_tone": (0.0 <= self.second_tone < 1.0, "at least 0 and below 1"),
            "poor_lost": (0.0 < self.poor_lost <= 1.0, "above 0 and at most 1"),
        }
        for name, (fine, allowed) in limits.items():
            if not fine:
                raise IdentificationError(f"{name}: given {getattr(self, name):g}; allowed: {allowed}")
        if self.saturation is not None and not self.saturation[0] < self.saturation[1]:
            raise IdentificationError(f"saturation: given {self.saturation}; allowed: lower below upper limit")


@dataclass(frozen=True)
class Estimate:
    """u(t) = offset + amplitude sin(2 pi frequency (t - time) + phase) in the window that ends at `time`.

    u is a displacement [m], or the force that drives the structure [N].
    """

    time: float = nan  # of the last sample in the window [s]
    last_index: int = 0
    quality: Quality = Quality.NONE
    origin: Origin = Origin.SUPPORT
    changed: bool = False  # a change since the last steady estimate with this flag
    amplitude: float = nan  # [m, of a force N]
    amplitude_std: float = nan  # likewise
    frequency: float = nan  # [Hz]
    frequency_std: float = nan  # [Hz]
    phase: float = nan  # at `time` [rad]
    phase_std: float = nan  # [rad]
    offset: float = nan  # likewise
    window: float = nan  # length of the window used [s]
    residual: float = nan  # root mean square of signal minus fit, likewise
    harmonics: float = nan  # root of the power at multiples of frequency, relative to the amplitude [-]
    used: int = 0  # valid samples in the fit
    lost: int = 0  # samples missing from the window (gaps by index, NaN, saturated)
    beam_amplitude: float = nan  # half peak-to-peak of the beam in the window [m]
    growth: float = nan  # relative change of amplitude, mean over the window [1/s]; not in the message
    growth_std: float = nan  # [1/s]
    drift: float = 0.0  # relative rate of a frequency that drifts slowly [1/s]; not in the message

    def displaced(self) -> Estimate:
        """Return the displacement of this acceleration [m]: nothing is integrated, so that nothing drifts.

        The offset is a sensor's and no displacement: NaN. Harmonics are at most a quarter. Raises IdentificationError
        where the tone is too slow for the noise.
        """
        omega = 2.0 * math.pi * self.frequency
        if not omega > 0.0:
            return self
        relative = math.hypot(self.amplitude_std / self.amplitude, 2.0 * self.frequency_std / self.frequency)
        if relative > _VAGUE:
            raise IdentificationError(
                f"acceleration: given a tone at {self.frequency:.3g} Hz in noise of {self.residual:.2g} m/s^2, a "
                f"displacement of {self.amplitude / omega**2:.2g} m within {relative:.0%}; allowed: {_VAGUE:.0%}; "
                f"excite above {self.frequency * math.sqrt(relative / _VAGUE):.3g} Hz, or measure displacement"
            )
        amplitude, residual = self.amplitude / omega**2, self.residual / omega**2
        phase, harmonics = math.remainder(self.phase + math.pi, 2.0 * math.pi), self.harmonics / 4.0
        moved = replace(self, amplitude=amplitude, amplitude_std=amplitude * relative, residual=residual)
        return replace(moved, phase=phase, offset=nan, harmonics=harmonics)
