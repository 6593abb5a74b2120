# SPDX-License-Identifier: Apache-2.0
"""What the support does: a tone, nothing (free decay), a sweep, or a measured series."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, Tag, field_validator

from atpid_sim.fields import (
    Amplitude,
    AmplitudeOrPoints,
    Block,
    Duration,
    FrequencyPoints,
    Hertz,
    LocatedPath,
    Number,
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


class HarmonicExcitation(Block):
    """u = A(t) sin(2 pi f t) (equation 3.44), A and f along straight ramps where points are given."""

    kind: ClassVar[str] = "harmonic"
    amplitude: AmplitudeOrPoints = Field(
        description="support amplitude [m], or [[t, A], ...] with straight ramps [s, m]"
    )
    frequency: Frequency = Field(
        description="excitation frequency [Hz], or resonance: that of beam and grain as one mass; or [[t, f], ...] "
        "with straight ramps [s, Hz], without a jump of the phase"
    )

    @property
    def frequency_points(self) -> tuple[tuple[float, float], ...]:
        """((t [s], f [Hz]), ...) where the frequency is given as points, else nothing."""
        return self.frequency if isinstance(self.frequency, tuple) else ()


class FreeDecay(Block):
    """The release of a free decay."""

    deflection: Displacement = Field(description="displacement from the static equilibrium at release, upward [m]")


class FreeExcitation(Block):
    """The support stands still; the beam is released at rest from a deflection."""

    kind: ClassVar[str] = "free"
    free: FreeDecay = Field(description="free decay")


class Sweep(Block):
    """A tone whose frequency changes at a constant rate, then stays."""

    amplitude: Amplitude = Field(description="support amplitude [m]")
    first: Hertz = Field(alias="from", description="frequency at the start [Hz]")
    last: Hertz = Field(alias="to", description="frequency at the end [Hz]")
    duration: Duration | None = Field(default=None, description="how long the sweep takes [s]; default: the whole run")


class SweepExcitation(Block):
    """u = A sin(2 pi (f0 t + (f1 - f0) t^2 / 2 T))."""

    kind: ClassVar[str] = "sweep"
    sweep: Sweep = Field(description="frequency sweep")


class Series(Block):
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


class SeriesExcitation(Block):
    """u interpolated by a cubic spline through measured points, so that velocity is its exact derivative."""

    kind: ClassVar[str] = "series"
    series: Series = Field(description="measured series")


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
