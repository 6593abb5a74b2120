# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The values of a scene: everything one run needs and nothing else."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Strict, Tag, model_validator
from pydantic_core import PydanticCustomError

from atpid_common.files import Document
from atpid_common.injected_faults import CEILING, PARTS, Injected, overlapping
from atpid_common.vocabulary import DRIVES, Drive
from atpid_sim.contact.laws import LAWS, NAMES
from atpid_sim.contact.spec import ContactSpec
from atpid_sim.fields import Duration, Number, Range, SceneBlock, impossible, within
from atpid_sim.modal import Modes, ModeSet, bare_amplitude, modes_of, phasors, resting
from atpid_sim.scene.ceiling import Ceiling
from atpid_sim.scene.excitation import Excitation
from atpid_sim.scene.sensors import Fault, Recording, Sensors
from atpid_sim.scene.structure import Beam, Container, FurtherMode, Grain, Initial
from atpid_sim.scene.yaml12 import SceneError, write_yaml

#: Between which shares of the run the steady window is where the scene names none.
_STEADY = (0.875, 1.0)
#: Modes beside the first at most.
_MOST_MODES = 50
#: Faults of one run at most.
_MOST_FAULTS = 1000
#: Samples a block at most: what one message can hold without filling the memory.
_MOST_A_BLOCK = 1_000_000


def _law(value: object) -> str | None:
    law = value.get("law") if isinstance(value, Mapping) else getattr(value, "law", None)
    return f"<{law}>" if law in NAMES else None


_SPECS = [Annotated[law.Spec, Tag(f"<{name}>")] for name, law in zip(NAMES, LAWS, strict=True)]

#: The contact block: one variant per law, as the laws' files describe their keys.
if TYPE_CHECKING:
    ContactBlock = ContactSpec
else:
    ContactBlock = Annotated[
        functools.reduce(operator.or_, _SPECS),
        Discriminator(_law, custom_error_type="no_law", custom_error_message=f"law: one of {', '.join(NAMES)}"),
    ]


class SceneValues(SceneBlock):
    """One run: structure, contact, excitation, ceiling and how long (docs/scenes.md)."""

    beam: Beam = Field(description="the beam reduced to one mass")
    further_modes: tuple[FurtherMode, ...] = Field(
        default=(), max_length=_MOST_MODES, description="modes of the structure beside beam (docs/modes.md)"
    )
    drive: Literal["support", "force"] = Field(
        default="support", description="what the excitation is: the support's displacement [m], or a force on beam [N]"
    )
    grain: Grain = Field(description="the grain")
    container: Container = Field(
        default=Container(),
        description="friction and rotation of the container, checked against limits (docs/horizontal.md)",
    )
    contact: ContactBlock = Field(description="the contact law between grain and walls")
    excitation: Excitation = Field(description="what the support does")
    ceiling: Ceiling = Field(description="what the ceiling does")
    initial: Initial | None = Field(default=None, description="how the run begins; default: at rest")
    gravity: Annotated[Number, within(0.0, 1e4)] = Field(description="gravity [m/s^2]")
    duration: Duration = Field(description="length of the run [s]")
    steady_window: Range = Field(
        default_factory=lambda given: tuple(share * given.get("duration", math.nan) for share in _STEADY),
        description="between which times the amplitude is taken [s]; default: the last eighth of the run",
    )
    tolerance: Annotated[Number, within(1e-13, 0.5)] = Field(
        description="relative error of the amplitude asked for [-]"
    )
    sensors: Sensors = Field(default=Sensors(), description="what the bench's sensors read")
    recording: Recording = Field(default=Recording(), description="how the bench records")
    seed: Annotated[int, Strict(), Field(ge=0)] = Field(default=0, description="seed of all noise [-]")
    faults: tuple[Fault, ...] | None = Field(
        default=None, max_length=_MOST_FAULTS, description="faults injected on the bench (docs/faults.md)"
    )

    @model_validator(mode="before")
    @classmethod
    def _one_damper(cls, given: object) -> object:
        if isinstance(given, Mapping) and "further_dampers" in given:
            allowed = "none: one damper with one grain is simulated, that of grain and ceiling"
            raise impossible("further_dampers", given["further_dampers"], allowed)
        return given

    @model_validator(mode="after")
    def _fits(self) -> SceneValues:
        first, last = self.steady_window
        if not 0.0 <= first < last <= self.duration:
            allowed = f"two rising times between 0 and duration ({self.duration:g} s)"
            raise impossible("steady_window", list(self.steady_window), allowed)
        for errors in (_height_errors, _initial_errors, _block_errors, _fault_errors):
            for error in errors(self):
                raise error
        return self

    @property
    def total_mass(self) -> float:
        """Mass of beam and grain [kg]."""
        return self.beam.mass / (1.0 - self.grain.mass_fraction)

    @property
    def grain_mass(self) -> float:
        """Mass of the grain [kg]."""
        return self.beam.mass * self.grain.mass_fraction / (1.0 - self.grain.mass_fraction)

    @property
    def natural_frequency_hz(self) -> float:
        """Undamped natural frequency of beam and grain as one mass [Hz] (equation 3.45)."""
        if self.modes is not None:
            return float(self.modes.joined.frequencies[0])
        return math.sqrt(self.beam.stiffness / self.total_mass) / (2.0 * math.pi)

    @property
    def driven_by(self) -> Drive:
        """What the excitation is: its sensor's channel and unit."""
        return DRIVES[self.drive]

    @property
    def modes(self) -> Modes | None:
        """The structure's modes where they are several or a force drives it, else None."""
        if not self.further_modes and self.drive == "support":
            return None
        given = [(self.beam, 1.0), *((mode, mode.drive_factor) for mode in self.further_modes)]
        parts = tuple((mode.mass, mode.stiffness, mode.damping, factor) for mode, factor in given)
        return _modes_from(parts, self.drive, self.grain_mass, self.gravity)

    @property
    def frequency_hz(self) -> float:
        """Frequency of the tone [Hz], at the run's end where it moves; without a tone the natural frequency."""
        given = self.excitation.tone_frequency
        if isinstance(given, tuple):
            times, frequencies = zip(*given, strict=True)
            return float(np.interp(self.duration, times, frequencies))
        return self.natural_frequency_hz if isinstance(given, str) else given

    @property
    def frequency_moves(self) -> bool:
        """Whether the tone's frequency changes during the run."""
        return len({frequency for _, frequency in self.excitation.frequency_points}) > 1

    @property
    def height_limits(self) -> tuple[float, float]:
        """Lowest and highest height a controller may command [m]: from closed, within the ceiling's range."""
        low, high = self.ceiling.range
        return max(low, 2.0 * self.grain.radius), high

    @property
    def injected(self) -> tuple[Injected, ...]:
        """The faults of the run as nodes take them."""
        return tuple(fault.injected for fault in self.faults or ())

    def require_faults_fit(self) -> None:
        """Raise SceneError for a fault the run would not have: after its end, or of a motor where none moves.

        Not a rule of the scene: simulations are derived from it with other ceilings and durations.
        """
        for fault in self.injected:
            if fault.begin >= self.duration:
                allowed = f"faults that begin before the run's end, duration {self.duration:g} s"
                raise SceneError(f"faults: given {fault}; allowed: {allowed}")
            if fault.part in CEILING and not self.ceiling.controlled:
                allowed = "a fault of motor or height sensor only where a controller moves the ceiling"
                raise SceneError(f"faults: given {fault}; allowed: {allowed}")

    def refuse_faults(self, where: str, parts: tuple[str, ...] = PARTS) -> None:
        """Raise SceneError where the scene has a fault of `parts`, which `where` cannot act."""
        for fault in self.injected:
            if fault.part in parts:
                way = {"serial_link": " --emulated-stand", "recorder": " --real-time"}.get(fault.part, "")
                raise SceneError(
                    f"faults: given {fault}; {where} cannot act faults of {fault.part}; leave it out, or run it by "
                    f"`atpid bench SCENE.yaml --out DIR{way}`"
                )

    @property
    def static_deflection(self) -> float:
        """How far the weight of beam and grain pulls the beam down [m] (equation 3.41), positive."""
        if self.modes is not None:
            return -float(resting(self.modes.joined).sum())
        return self.total_mass * self.gravity / self.beam.stiffness

    @property
    def initial_deflection(self) -> float:
        """Where the beam is as a run begins, from its rest [m]."""
        if self.excitation.is_free:
            return self.excitation.deflection
        return self.initial.displacement if self.initial is not None else 0.0

    def linear_amplitude(self, amplitude: float, frequency: float | None = None, *, grain: bool) -> float:
        """Return the steady amplitude [m] of the structure with the grain held, or without the damper.

        amplitude: of the support [m] or of a force [N]; frequency [Hz]: None is the scene's. NaN where either is.
        """
        frequency = self.frequency_hz if frequency is None else frequency
        if self.modes is not None:
            modes = self.modes.joined if grain else self.modes.free
            return float(amplitude * abs(phasors(modes, frequency).sum()))
        beam, mass = self.beam, self.total_mass if grain else self.beam.mass
        return bare_amplitude(mass, beam.stiffness, beam.damping, amplitude, frequency)

    def require_prescribed_ceiling(self) -> None:
        """Raise SceneError where a controller moves the ceiling: a single run has no controller."""
        if self.ceiling.controlled:
            raise SceneError(
                f"ceiling: given one that a controller moves ({self.ceiling.controller}); allowed in a single run: one "
                "of {height}, {closed, open, start, end}, {profile}; use `simulate --height H`, or run the loop with "
                "`atpid bench SCENE.yaml --out DIR`"
            )

    def defaults(self) -> list[str]:
        """Return one line for each optional value the scene does not give: key, value used, meaning."""
        return [f"{key} = {_text(value)}: {meaning}" for key, value, meaning in _defaults(self, "")]

    def decisive_defaults(self, measured: bool = False) -> list[str]:
        """Return `key = value` of each value the scene does not give and a run uses; `measured`: sensors as well."""
        noise = () if self.excitation.kind == "random" else ("seed",)
        apart = ("further_modes", "drive", *(() if measured else ("sensors.", "recording.", *noise)))
        used = [(key, value) for key, value, _ in _defaults(self, "") if value is not None]
        return [f"{key} = {_text(value)}" for key, value in used if not key.startswith(apart)]

    def to_mapping(self) -> Document:
        """Return what was given, as plain numbers, text, lists and dicts."""
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)

    def to_yaml(self) -> str:
        """Return the scene as YAML; loading it gives the same scene."""
        return write_yaml(self.to_mapping())


@functools.lru_cache(maxsize=64)
def _modes_from(
    parts: tuple[tuple[float, float, float, float], ...], drive: str, grain_mass: float, gravity: float
) -> Modes:
    """Return the modes of (mass, stiffness, damping, drive factor) each [SI units]."""
    mass, stiffness, damping, factors = np.array(parts).T
    if drive == "support":
        factors[0] = 1.0 - factors[1:].sum()
        direct, rate = factors * stiffness, factors * damping
    else:
        direct, rate = factors, np.zeros(len(factors))
    weight = np.zeros(len(mass))
    weight[0] = gravity
    return modes_of(ModeSet(mass, stiffness, damping, direct, rate, weight), grain_mass, gravity)


def _height_errors(scene: SceneValues) -> Iterator[PydanticCustomError]:
    diameter = 2.0 * scene.grain.radius
    named = {key: getattr(scene.ceiling, key) for key in ("height", "closed", "open") if hasattr(scene.ceiling, key)}
    if scene.ceiling.kind == "profile":
        named["profile"] = min(height for _, height in scene.ceiling.heights)
    if scene.ceiling.controlled:
        named["range"] = scene.ceiling.range[0]
    for key, height in named.items():
        if height < diameter:
            yield impossible(f"ceiling.{key}", height, f"at least the grain's diameter 2 r = {diameter:g} m")


def _initial_errors(scene: SceneValues) -> Iterator[PydanticCustomError]:
    if scene.initial is None:
        return
    if scene.excitation.is_free and scene.initial.displacement:
        allowed = "none beside excitation.free.deflection, which is the same"
        yield impossible("initial.displacement", scene.initial.displacement, allowed)
    clearance = scene.ceiling.heights[0][1] - 2.0 * scene.grain.radius
    if scene.initial.grain_height > clearance:
        allowed = f"at most the clearance at the start, height less 2 r = {max(clearance, 0.0):g} m"
        yield impossible("initial.grain_height", scene.initial.grain_height, allowed)


def _block_errors(scene: SceneValues) -> Iterator[PydanticCustomError]:
    if not {"sensors", "recording"} & scene.model_fields_set:
        return
    if scene.sensors.load_cell is not None and scene.drive != "force":
        yield impossible("sensors.load_cell", "one", "none but with drive: force")
    for name in ("laser", "accelerometer"):
        sensor = getattr(scene.sensors, name)
        count = scene.recording.block * sensor.rate if sensor else 1.0
        if not 0.5 <= count <= _MOST_A_BLOCK or abs(count - round(count)) > 1e-6 * count:
            allowed = (
                f"a whole number of samples a block, at most {_MOST_A_BLOCK}"
                f" (sensors.{name}.rate x recording.block is {count:g})"
            )
            yield impossible("recording.block", scene.recording.block, allowed)


def _fault_errors(scene: SceneValues) -> Iterator[PydanticCustomError]:
    faults = scene.injected
    for number, fault in enumerate(faults):
        key, given = f"faults[{number}]", str(fault)
        if fault.part == "accelerometer" and scene.sensors.accelerometer is None:
            yield impossible(key, given, "an accelerometer's fault only where sensors.accelerometer is given")
        if fault.part == "support_laser" and scene.drive != "support":
            yield impossible(key, given, "none of the support's laser, which drive: force does not read")
    if both := overlapping(faults):
        yield impossible("faults", f"{both[0]} and {both[1]}", "one fault of a part at a time")


def _defaults(block: SceneBlock, prefix: str) -> Iterator[tuple[str, object, str]]:
    """Yield key, value used and meaning of each value that was not given."""
    for name, field in type(block).model_fields.items():
        key, value = prefix + (field.alias or name), getattr(block, name)
        if name not in block.model_fields_set and not isinstance(value, SceneBlock):
            yield key, value, field.description or ""
        elif isinstance(value, SceneBlock):
            yield from _defaults(value, key + ".")


def _text(value: object) -> str:
    shown = list(value) if isinstance(value, tuple) else value
    return "none" if shown is None else str(shown)
