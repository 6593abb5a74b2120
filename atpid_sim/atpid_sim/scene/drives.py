# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The blocks of drives that are no single tone: one of several tones, a random motion, a shock."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Strict, Tag, field_validator, model_validator

from atpid_sim.fields import Amplitude, Duration, Hertz, Instant, Number, Range, SceneBlock, Words, impossible, within
from atpid_sim.system import Array

#: A power spectral density, one-sided: ((f [Hz], S [unit^2/Hz]), ...), f rising; straight between the points in
#: logarithms of both, zero outside.
Density = tuple[tuple[float, float], ...]
#: One frequency [Hz], or that of beam and grain as one mass.
_ToneFrequency = Annotated[
    Annotated[Hertz, Tag("<number>")] | Annotated[Literal["resonance"], Tag("<word>")],
    Discriminator(lambda value: "<word>" if isinstance(value, str) else "<number>"),
]
Displacement = Annotated[Number, within(-1e3, 1e3)]
Acceleration = Annotated[Number, within(-1e9, 1e9)]
#: Values of a power spectral density, in its unit.
_LEAST_DENSITY, _LARGEST_DENSITY = 1e-30, 1e15
#: Points of a power spectral density and tones at most.
MOST_PARTS = 1000
#: Acceleration of gravity as a unit [m/s^2].
_G = 9.80665
#: Rise of a random motion: periods of its lowest frequency, and share of the run at most.
_RISE, _RISE_SHARE = 2.0, 0.25
#: Periods of the resonance in which the velocity of a shock is brought back to zero.
_COMPENSATION = 10.0


class Tone(SceneBlock):
    """One of several tones, A sin(2 pi f t + phase)."""

    amplitude: Amplitude = Field(description="support amplitude [m]")
    frequency: _ToneFrequency = Field(description="frequency [Hz], or resonance: that of beam and grain as one mass")
    phase: Annotated[Number, within(-100.0, 100.0)] = Field(default=0.0, description="phase at time zero [rad]")


class Random(SceneBlock):
    """A stationary Gaussian motion, one realisation of its power spectral density."""

    psd: Annotated[tuple[Range, ...], Field(min_length=2, max_length=MOST_PARTS)] = Field(
        description="one-sided power spectral density, [[f, S], ...] [Hz, unit]: straight between the points in "
        "logarithms of both, zero below the first and above the last"
    )
    unit: Literal["m^2/Hz", "(m/s^2)^2/Hz", "g^2/Hz"] = Field(
        description="of S: m^2/Hz, (m/s^2)^2/Hz or g^2/Hz (g = 9.80665 m/s^2)"
    )
    rise: Duration | None = Field(
        default=None,
        description="in which the motion grows from rest [s]; default: two periods of the lowest frequency, at most a "
        "quarter of the run",
    )
    seed: Annotated[int, Strict(), Field(ge=0)] | None = Field(
        default=None, description="of the realisation [-]; default: that of the scene"
    )

    @field_validator("psd")
    @classmethod
    def _rises(cls, psd: Density) -> Density:
        last = 0.0
        for f, value in psd:
            if not max(last, 1e-6) <= f <= 1e6 or f == last:
                raise impossible("", f, f"rising frequencies from 1e-06 to 1e+06 Hz (the one before is {last:g})")
            if not _LEAST_DENSITY <= value <= _LARGEST_DENSITY:
                raise impossible("", value, f"densities from {_LEAST_DENSITY:g} to {_LARGEST_DENSITY:g}")
            last = f
        return psd

    @property
    def displacement_psd(self) -> Density:
        """The power spectral density of the displacement, ((f [Hz], S [m^2/Hz]), ...)."""
        if self.unit == "m^2/Hz":
            return self.psd
        factor = _G**2 if self.unit == "g^2/Hz" else 1.0
        return tuple((f, factor * value / (2.0 * math.pi * f) ** 4) for f, value in self.psd)

    def rise_in(self, duration: float) -> float:
        """Return in what time the motion grows from rest in a run of `duration` [s]."""
        return self.rise or min(_RISE / self.psd[0][0], _RISE_SHARE * duration)


class Shock(SceneBlock):
    """One pulse of the support's acceleration, whose velocity is then brought back to zero."""

    acceleration: Acceleration | None = Field(
        default=None, description="peak of the pulse, upward [m/s^2]; or give displacement; default: none"
    )
    displacement: Displacement | None = Field(
        default=None,
        description="how far the support is in the end, upward [m], instead of acceleration; default: none",
    )
    duration: Duration = Field(description="of the pulse [s]")
    form: Literal["half_sine"] = Field(default="half_sine", description="of the pulse: half_sine")
    at: Instant = Field(default=0.0, description="when the pulse begins [s]")
    compensation: Duration | None = Field(
        default=None,
        description="in which the velocity is brought back to zero after the pulse, at an acceleration like sin^2 "
        "[s]; default: 10 periods of the resonance",
    )

    @model_validator(mode="after")
    def _one_size(self) -> "Shock":
        if (self.acceleration is None) == (self.displacement is None):
            given = "neither" if self.acceleration is None else "both"
            raise impossible("", Words(given), "exactly one of acceleration, displacement")
        return self

    def compensation_of(self, resonance: float) -> float:
        """Return in what time [s] the velocity is brought back, for a resonance [Hz]."""
        return self.compensation or _COMPENSATION / resonance

    def peak_of(self, resonance: float) -> float:
        """Return the peak of the pulse [m/s^2], for a resonance [Hz]."""
        return (self.displacement or 0.0) / self._lever(resonance) if self.acceleration is None else self.acceleration

    def travel_of(self, resonance: float) -> float:
        """Return how far the support is in the end [m], for a resonance [Hz]."""
        return self.peak_of(resonance) * self._lever(resonance)

    def _lever(self, resonance: float) -> float:
        """Displacement in the end over the peak of the pulse [s^2]."""
        return self.duration * (self.duration + self.compensation_of(resonance)) / math.pi


def band_power(density: Density, edges: Sequence[float] | Array) -> Array:
    """Return the mean square (n,) [unit^2] between successive of the rising frequencies `edges` (n + 1,) [Hz].

    The exact integral of S = S1 (f / f1)^p over each segment.
    """
    f, s = (np.array(values) for values in zip(*density, strict=True))
    slopes = np.log(s[1:] / s[:-1]) / np.log(f[1:] / f[:-1]) + 1.0

    def below(segment: NDArray[np.intp], frequency: Array) -> Array:
        """Power of the segment below a frequency in it."""
        octaves, slope = np.log(frequency / f[segment]), slopes[segment]
        grown = np.where(np.abs(slope) < 1e-9, octaves, np.expm1(slope * octaves) / np.where(slope == 0.0, 1.0, slope))
        power: Array = s[segment] * f[segment] * grown
        return power

    segments = np.arange(len(slopes))
    before = np.concatenate([[0.0], np.cumsum(below(segments, f[1:]))])
    inside = np.clip(np.asarray(edges, dtype=float), f[0], f[-1])
    at = np.clip(np.searchsorted(f, inside, side="right") - 1, 0, len(slopes) - 1)
    return np.diff(before[at] + below(at, inside))
