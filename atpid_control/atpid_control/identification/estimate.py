# SPDX-License-Identifier: Apache-2.0
"""Result of the identification: the fields of Excitation.msg, with its meanings and units."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import nan


class Quality(IntEnum):
    """Quality of an estimate."""

    NONE = 0  # no estimate: handshake, too few samples, or no signal
    STEADY = 1  # a steady tone: the estimate can be acted on
    TRANSIENT = 2  # amplitude or frequency is changing inside the window: the estimate is a mean over it
    POOR = 3  # a tone was fitted, but residual, harmonics, gaps or saturation spoil it

    @classmethod
    def _missing_(cls, _value: object) -> Quality:
        """Return POOR for the value of a message that has none of these."""
        return cls.POOR


class Origin(IntEnum):
    """Which signal an estimate comes from."""

    SUPPORT = 0
    BEAM = 1


@dataclass(frozen=True)
class Estimate:
    """u(t) = offset + amplitude sin(2 pi frequency (t - time) + phase) in the window that ends at `time`."""

    time: float = nan  # of the last sample in the window [s]
    last_index: int = 0
    quality: Quality = Quality.NONE
    origin: Origin = Origin.SUPPORT
    changed: bool = False  # a change since the last steady estimate with this flag
    amplitude: float = nan  # [m]
    amplitude_std: float = nan  # [m]
    frequency: float = nan  # [Hz]
    frequency_std: float = nan  # [Hz]
    phase: float = nan  # at `time` [rad]
    phase_std: float = nan  # [rad]
    offset: float = nan  # [m]
    window: float = nan  # length of the window used [s]
    residual: float = nan  # root mean square of signal minus fit [m]
    harmonics: float = nan  # root of the power at multiples of frequency, relative to the amplitude [-]
    used: int = 0  # valid samples in the fit
    lost: int = 0  # samples missing from the window (gaps by index, NaN, saturated)
    beam_amplitude: float = nan  # half peak-to-peak of the beam in the window [m]
    growth: float = nan  # relative change of amplitude, mean over the window [1/s]; not in the message
    growth_std: float = nan  # [1/s]
