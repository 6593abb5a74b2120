# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings and result of the identification: docs/identification.md explains each value, Excitation.msg the fields."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from math import nan

from atpid_common.errors import InputError
from atpid_common.parameters import live, problem_of, setting
from atpid_common.vocabulary import Origin, Quality

#: Unit of a channel whose tone is divided by the square of its angular frequency.
ACCELERATION = "m/s^2"
#: Relative standard deviation from which a displacement is not inferred from an acceleration [-].
_VAGUE = 0.05


class IdentificationError(InputError):
    """Settings, or samples, that cannot be used."""


@dataclass(frozen=True)
class Settings:
    """Limits of the search and of quality: parameters of the identifier."""

    window_periods: float = setting(
        2.0, "sliding window in periods of the tone; 1 is enough for a steady one", "-", 1.0, 20.0
    )
    lowest_frequency: float = setting(1.0, "tones are looked for above this", "Hz", 0.01, 1e4)
    highest_frequency: float = setting(40.0, "tones are looked for below this", "Hz", 0.02, 1e4)
    mains_frequency: float = setting(50.0, "hum that joins the fit where it is present; 0: none", "Hz", 0.0, 1e4)
    least_amplitude: float = live(5e-5, "a smaller tone is no excitation [m, of a force N]", "", 0.0, 1e6)
    saturation: tuple[float, float] | None = None  # at or beyond these a sample is not valid [m, of a force N]
    change: float = live(0.01, "relative change of a steady amplitude that counts as one", "-", 1e-5, 0.9)
    change_likelihood: float = live(
        20.0, "log-likelihood from which a tone counts as changing inside the window", "-", 0.1, 1e6
    )
    #: Heights are selected for one tone.
    second_tone: float = live(
        0.1, "amplitude over the first's from which another tone makes an estimate poor; 0: none does", "-", 0.0, 0.9
    )
    slow_drift: float = live(0.03, "relative rate of a frequency up to which its tone is steady", "1/s", 0.0, 0.9)
    poor_residual: float = live(0.3, "residual over amplitude from which an estimate is poor", "-", 1e-4, 100.0)
    poor_harmonics: float = live(0.2, "harmonics over amplitude from which an estimate is poor", "-", 1e-4, 100.0)
    poor_lost: float = live(0.5, "share of lost samples from which an estimate is poor", "-", 1e-4, 1.0)
    analysis_rate: float = setting(
        1000.0, "streams of twice this rate and more are averaged down to it", "Hz", 1.0, 1e6
    )

    def __post_init__(self) -> None:
        if problem := problem_of(self):
            raise IdentificationError(problem)
        top = self.analysis_rate / 8.0
        if not self.lowest_frequency < self.highest_frequency <= top:
            allowed = f"above lowest_frequency and at most analysis_rate / 8 = {top:g} Hz"
            raise IdentificationError(f"highest_frequency: given {self.highest_frequency:g}; allowed: {allowed}")
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
