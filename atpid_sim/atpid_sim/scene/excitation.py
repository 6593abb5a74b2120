# SPDX-License-Identifier: Apache-2.0
"""What the support does: a tone, nothing (free decay), a sweep, or a measured series."""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, Tag, field_validator

from atpid_sim.fields import (
    Amplitude,
    AmplitudeOrPoints,
    Duration,
    FrequencyPoints,
    Hertz,
    LocatedPath,
    Number,
    SceneBlock,
    by_key,
    by_type,
    impossible,
    within,
)

Frequency = Annotated[
    Annotated[Hertz, Tag("<number>")]
    | Annotated[Literal["resonance"], Tag("<word>")]
    | Annotated[FrequencyPoints, Tag("<points>")],
    by_type,
]
Displacement = Annotated[Number, within(-1e3, 1e3)]


Points = tuple[tuple[float, float], ...]


class SupportMotion(SceneBlock):
    """What every excitation is asked for."""

    kind: ClassVar[str]
    is_tone: ClassVar[bool] = False
    is_free: ClassVar[bool] = False

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


class HarmonicExcitation(SupportMotion):
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
        """See `SupportMotion`."""
        return ((0.0, self.amplitude),) if isinstance(self.amplitude, float) else self.amplitude

    @property
    def tone_frequency(self) -> float | Literal["resonance"] | Points:
        """See `SupportMotion`."""
        return self.frequency


class FreeDecay(SceneBlock):
    """The release of a free decay."""

    deflection: Displacement = Field(description="displacement from the static equilibrium at release, upward [m]")


class FreeExcitation(SupportMotion):
    """The support stands still; the beam is released at rest from a deflection."""

    kind: ClassVar[str] = "free"
    is_free: ClassVar[bool] = True
    free: FreeDecay = Field(description="free decay")

    @property
    def deflection(self) -> float:
        """See `SupportMotion`."""
        return self.free.deflection


class Sweep(SceneBlock):
    """A tone whose frequency changes at a constant rate, then stays."""

    amplitude: Amplitude = Field(description="support amplitude [m]")
    first: Hertz = Field(alias="from", description="frequency at the start [Hz]")
    last: Hertz = Field(alias="to", description="frequency at the end [Hz]")
    duration: Duration | None = Field(default=None, description="how long the sweep takes [s]; default: the whole run")


class SweepExcitation(SupportMotion):
    """u = A sin(2 pi (f0 t + (f1 - f0) t^2 / 2 T))."""

    kind: ClassVar[str] = "sweep"
    sweep: Sweep = Field(description="frequency sweep")

    @property
    def amplitude_points(self) -> Points:
        """See `SupportMotion`."""
        return ((0.0, self.sweep.amplitude),)


class Series(SceneBlock):
    """A measured support displacement, in a file."""

    file: LocatedPath = Field(description="CSV with a header line, or NPZ; relative to the scene's folder")
    time: str = Field(default="time", description="name of the column or array with the time [s]")
    displacement: str = Field(default="support_displacement", description="name of the one with the displacement [m]")
    offset: Displacement | None = Field(
        default=None,
        description="taken off every displacement [m]; default: the first one, so that the run begins at rest",
    )

    @field_validator("file")
    @classmethod
    def _exists(cls, file: LocatedPath) -> LocatedPath:
        if file.suffix.lower() not in (".csv", ".npz") or not file.is_file():
            raise impossible("", str(file), "an existing file that ends in .csv or .npz")
        return file


class SeriesExcitation(SupportMotion):
    """u interpolated by a cubic spline through measured points, so that velocity is its exact derivative."""

    kind: ClassVar[str] = "series"
    series: Series = Field(description="measured series")

    @property
    def amplitude_points(self) -> Points:
        """See `SupportMotion`."""
        return ((0.0, math.nan),)


Excitation = Annotated[
    Annotated[HarmonicExcitation, Tag("<harmonic>")]
    | Annotated[FreeExcitation, Tag("<free>")]
    | Annotated[SweepExcitation, Tag("<sweep>")]
    | Annotated[SeriesExcitation, Tag("<series>")],
    by_key(
        {
            "<free>": ("free",),
            "<sweep>": ("sweep",),
            "<series>": ("series",),
            "<harmonic>": ("amplitude", "frequency"),
        },
        "one of {amplitude, frequency}, {free: ...}, {sweep: ...}, {series: ...}",
    ),
]
