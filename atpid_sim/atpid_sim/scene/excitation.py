# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the support does: tones, nothing (free decay), a sweep, random motion, a shock, or a measured series."""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, Tag, field_validator, model_validator

from atpid_sim.fields import (
    Amplitude,
    AmplitudeOrPoints,
    Duration,
    FrequencyPoints,
    Hertz,
    LocatedPath,
    SceneBlock,
    Words,
    by_key,
    by_type,
    impossible,
)
from atpid_sim.scene.drives import MOST_PARTS, Displacement, Random, Shock, Tone, band_power

Frequency = Annotated[
    Annotated[Hertz, Tag("<number>")]
    | Annotated[Literal["resonance"], Tag("<word>")]
    | Annotated[FrequencyPoints, Tag("<points>")],
    by_type,
]


Points = tuple[tuple[float, float], ...]


class _SupportMotion(SceneBlock):
    """What every excitation is asked for."""

    kind: ClassVar[str]
    is_tone: ClassVar[bool] = False
    is_free: ClassVar[bool] = False
    #: Whether it goes on without repeating itself, so that motions are compared by their root mean square.
    is_stationary: ClassVar[bool] = False
    #: Whether the plant of a loop follows its exciter's state instead.
    is_commanded: ClassVar[bool] = False

    @property
    def amplitude_points(self) -> Points:
        """((t [s], A [m]), ...) of the support, one where it is constant; NaN: it has none."""
        return ((0.0, 0.0),)

    @property
    def largest_amplitude(self) -> float:
        """Largest amplitude of the support [m]; NaN: it has none."""
        return max(amplitude for _, amplitude in self.amplitude_points)

    @property
    def tone_frequency(self) -> float | Literal["resonance"] | Points:
        """Frequency of a tone [Hz], or ((t [s], f [Hz]), ...)."""
        return "resonance"

    @property
    def frequency_points(self) -> Points:
        """((t [s], f [Hz]), ...) where the frequency is given as points, else nothing."""
        return self.tone_frequency if isinstance(self.tone_frequency, tuple) else ()

    @property
    def deflection(self) -> float:
        """Displacement from the static equilibrium at a release [m]; 0: it is not released."""
        return 0.0


class HarmonicExcitation(_SupportMotion):
    """u = A(t) sin(2 pi f t) (equation 3.44), A and f along straight ramps where points are given."""

    kind: ClassVar[str] = "harmonic"
    is_tone: ClassVar[bool] = True
    amplitude: AmplitudeOrPoints = Field(
        description="support amplitude [m], or [[t, A], ...] with straight ramps [s, m]"
    )
    frequency: Frequency = Field(
        description="excitation frequency [Hz], or resonance: that of beam and grain as one mass; or [[t, f], ...] "
        "with straight ramps [s, Hz], without a jump of the phase"
    )

    @property
    def amplitude_points(self) -> Points:
        """See `_SupportMotion`."""
        return ((0.0, self.amplitude),) if isinstance(self.amplitude, float) else self.amplitude

    @property
    def tone_frequency(self) -> float | Literal["resonance"] | Points:
        """See `_SupportMotion`."""
        return self.frequency


class CommandedExcitation(HarmonicExcitation):
    """In a loop the support follows the excitation node (docs/excitation_output.md); in a single run it is the tone."""

    kind: ClassVar[str] = "commanded"
    is_commanded: ClassVar[bool] = True
    commanded: Literal[True] = Field(
        description="true: in a loop amplitude and frequency are commanded, and those of the scene are what its map is "
        "made for, and the largest amplitude expected"
    )


class FreeDecay(SceneBlock):
    """The release of a free decay."""

    deflection: Displacement = Field(description="displacement from the static equilibrium at release, upward [m]")


class FreeExcitation(_SupportMotion):
    """The support is at rest; the beam is released at rest from a deflection."""

    kind: ClassVar[str] = "free"
    is_free: ClassVar[bool] = True
    free: FreeDecay = Field(description="free decay")

    @property
    def deflection(self) -> float:
        """See `_SupportMotion`."""
        return self.free.deflection


class Sweep(SceneBlock):
    """A tone whose frequency changes at a constant rate, then stays."""

    amplitude: Amplitude = Field(description="support amplitude [m]")
    first: Hertz = Field(alias="from", description="frequency at the start [Hz]")
    last: Hertz = Field(alias="to", description="frequency at the end [Hz]")
    duration: Duration | None = Field(default=None, description="how long the sweep takes [s]; default: the whole run")


class SweepExcitation(_SupportMotion):
    """u = A sin(2 pi (f0 t + (f1 - f0) t^2 / 2 T))."""

    kind: ClassVar[str] = "sweep"
    sweep: Sweep = Field(description="frequency sweep")

    @property
    def amplitude_points(self) -> Points:
        """See `_SupportMotion`."""
        return ((0.0, self.sweep.amplitude),)


class _UnevenMotion(_SupportMotion):
    """What has no one amplitude."""

    @property
    def amplitude_points(self) -> Points:
        """See `_SupportMotion`."""
        return ((0.0, math.nan),)


class TonesExcitation(_UnevenMotion):
    """u = sum of A sin(2 pi f t + phase), from time zero on."""

    kind: ClassVar[str] = "tones"
    is_stationary: ClassVar[bool] = True
    tones: tuple[Tone, ...] = Field(
        min_length=1, max_length=MOST_PARTS, description="[{amplitude, frequency, phase}, ...]"
    )

    @property
    def largest_amplitude(self) -> float:
        """Sum of the amplitudes [m]."""
        return sum(tone.amplitude for tone in self.tones)


class RandomExcitation(_UnevenMotion):
    """A stationary random motion of given power spectral density; seed and duration make the realisation."""

    kind: ClassVar[str] = "random"
    is_stationary: ClassVar[bool] = True
    random: Random = Field(description="random motion")

    @property
    def largest_amplitude(self) -> float:
        """Amplitude of the tone of the same root mean square [m]."""
        points = self.random.displacement_psd
        return math.sqrt(2.0 * float(band_power(points, [points[0][0], points[-1][0]])[0]))


class ShockExcitation(_UnevenMotion):
    """The support is at rest, makes one pulse of acceleration, and comes to rest elsewhere."""

    kind: ClassVar[str] = "shock"
    shock: Shock = Field(description="shock")


class Series(SceneBlock):
    """A measured displacement or acceleration of the support, in a file."""

    file: LocatedPath = Field(description="CSV with a header line, or NPZ; relative to the scene's folder")
    time: str = Field(default="time", description="name of the column or array with the time [s]")
    displacement: str = Field(default="support_displacement", description="name of the one with the displacement [m]")
    offset: Displacement | None = Field(
        default=None,
        description="taken off every displacement [m]; default: the first one, so that the run begins at rest",
    )
    acceleration: str | None = Field(
        default=None,
        description="name of the one with the acceleration [m/s^2], which is integrated twice; default: none, the "
        "displacement is read",
    )
    high_pass: Hertz | None = Field(
        default=None,
        description="frequency below which the integrated motion is left out [Hz]; needed with acceleration; "
        "default: none",
    )

    @field_validator("file")
    @classmethod
    def _exists(cls, file: LocatedPath) -> LocatedPath:
        if file.suffix.lower() not in (".csv", ".npz") or not file.is_file():
            raise impossible("", str(file), "an existing file that ends in .csv or .npz")
        return file

    @model_validator(mode="after")
    def _either(self) -> "Series":
        if (self.acceleration is None) != (self.high_pass is None):
            raise impossible("", Words("one of acceleration and high_pass"), "both or neither")
        if self.acceleration is not None and {"displacement", "offset"} & self.model_fields_set:
            raise impossible("", Words("displacement or offset beside acceleration"), "acceleration, high_pass alone")
        return self


class SeriesExcitation(_UnevenMotion):
    """u interpolated by a cubic spline through measured points, so that velocity is its exact derivative."""

    kind: ClassVar[str] = "series"
    is_stationary: ClassVar[bool] = True
    series: Series = Field(description="measured series")


Excitation = Annotated[
    Annotated[CommandedExcitation, Tag("<commanded>")]
    | Annotated[HarmonicExcitation, Tag("<harmonic>")]
    | Annotated[FreeExcitation, Tag("<free>")]
    | Annotated[SweepExcitation, Tag("<sweep>")]
    | Annotated[SeriesExcitation, Tag("<series>")]
    | Annotated[TonesExcitation, Tag("<tones>")]
    | Annotated[RandomExcitation, Tag("<random>")]
    | Annotated[ShockExcitation, Tag("<shock>")],
    by_key(
        {f"<{key}>": (key,) for key in ("commanded", "free", "sweep", "series", "tones", "random", "shock")}
        | {"<harmonic>": ("amplitude", "frequency")},
        "one of {amplitude, frequency}, {commanded: true, amplitude, frequency}, {free: ...}, {sweep: ...}, "
        "{series: ...}, {tones: ...}, {random: ...}, {shock: ...}",
    ),
]
