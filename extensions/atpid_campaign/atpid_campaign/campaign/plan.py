# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The file of a campaign, and its points in the order in which they are measured."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, Strict, Tag, ValidationError, model_validator

from atpid_common.errors import InputError
from atpid_common.files import Document, FileError, read_text
from atpid_sim.fields import Hertz, Length, LocatedPath, Mass, Number, SceneBlock, Words, by_type, impossible, within
from atpid_sim.scene import Scene, load_scene, scene_from_mapping
from atpid_sim.scene.scene import decimal_comma, explained
from atpid_sim.scene.yaml12 import read_yaml

#: Size of the file at most [bytes], and points of one campaign.
_LARGEST, _MOST = 1_000_000, 100_000
#: The smallest grain a scene can have stands for none: it moves the structure by a millionth.
_NO_GRAIN = 1e-6
#: The excitation of a simulated point grows for so long [s]; then its ceiling opens.
_RAMP = 0.5


class CampaignError(InputError):
    """A campaign that cannot be run as asked: what was given, what is allowed, what to do."""


Height = Annotated[Annotated[Length, Tag("<number>")] | Annotated[Literal["closed", "none"], Tag("<word>")], by_type]
Method = Literal["lookup", "pca", "direct"]
Amplitude = Annotated[Number, within(1e-9, 1e3, hint="in metres or newtons: 1 mm is 0.001")]
Share = Annotated[Number, within(1e-6, 0.5, hint="a share: 1 % is 0.01")]
Count = Annotated[int, Strict()]


class Rules(SceneBlock):
    """When a point counts as settled and measured, and what happens to one that does not."""

    settle_periods: Annotated[Count, Field(ge=4, le=10_000)] = Field(
        default=16, description="periods over which excitation and beam have to be steady before a measurement"
    )
    settle_limit: Annotated[Number, within(1.0, 3600.0)] = Field(
        default=40.0, description="time after which a point that has not settled is bad [s]"
    )
    measure_periods: Annotated[Count, Field(ge=4, le=100_000)] = Field(
        default=20, description="periods of the excitation that are measured"
    )
    drift: Share = Field(default=0.003, description="change of the beam's amplitude while settled, at most [-]")
    amplitude: Share = Field(default=0.02, description="identified amplitude of the excitation beside the point's [-]")
    frequency: Share = Field(default=0.005, description="identified frequency beside the point's [-]")
    repeat_bad: Annotated[Count, Field(ge=0, le=100)] = Field(
        default=2, description="how often a bad point is measured again before it is skipped and named"
    )
    on_fault: Literal["wait", "end"] = Field(
        default="wait", description="a latched fault: wait until a person has armed the motor again, or end"
    )


class Configurations(SceneBlock):
    """Parameter files of a real stand's nodes, in place of those of the packages."""

    motor: LocatedPath | None = Field(default=None, description="of motor_node; default: motor_serial.yaml")
    labjack: LocatedPath | None = Field(default=None, description="of labjack_node; default: labjack.yaml")
    excitation: LocatedPath | None = Field(default=None, description="of excitation_node, which a real stand needs")
    supervisor: LocatedPath | None = Field(default=None, description="of supervisor_node, with abort levels")


class Campaign(SceneBlock):
    """Amplitudes x frequencies x heights or methods x repeats x grain masses on one stand."""

    scene: LocatedPath = Field(description="scene of the stand, whose ceiling a controller moves")
    stand: Literal["simulated", "emulated", "real"] = Field(default="simulated", description="kind of stand")
    configurations: Configurations = Field(default=Configurations(), description="of a real stand's nodes")
    amplitudes: tuple[Amplitude, ...] = Field(min_length=1, description="of the support [m] or of a force [N]")
    frequencies: tuple[Hertz, ...] = Field(default=(), description="of the excitation [Hz]")
    frequency_ratios: tuple[Annotated[Number, within(0.05, 20.0)], ...] = Field(
        default=(), description="of the excitation over the resonance of structure and grain as one mass [-]"
    )
    heights: tuple[Height, ...] = Field(default=(), description="of the ceiling [m], closed, or none: no grain")
    methods: tuple[Method, ...] = Field(default=(), description="of selection, in place of a height")
    grain_masses: tuple[Mass, ...] = Field(default=(), description="[kg], changed by hand; default: the scene's")
    repeats: Annotated[Count, Field(ge=1, le=1000)] = Field(default=1, description="measurements of each point")
    order: Literal["settling", "random"] = Field(
        default="settling", description="settling: neighbours follow each other; random: by seed"
    )
    seed: Annotated[Count, Field(ge=0)] = Field(default=0, description="seed of the random order and of all noise [-]")
    height_std: Annotated[Number, within(0.0, 0.1)] = Field(
        default=5e-4, description="standard deviation of the ceiling's height, for the error bars [m]"
    )
    rules: Rules = Field(default=Rules(), description="when a point is settled, measured, or bad")

    @model_validator(mode="after")
    def _fits(self) -> Campaign:
        if bool(self.frequencies) == bool(self.frequency_ratios):
            raise impossible("", Words("frequencies and frequency_ratios"), "exactly one of both")
        if self.stand == "real" and self.configurations.excitation is None:
            raise impossible("configurations.excitation", Words("none"), "a parameter file of excitation_node")
        if not self.heights and not self.methods:
            raise impossible("", Words("neither heights nor methods"), "one of them at least")
        for name in ("amplitudes", "frequencies", "frequency_ratios", "heights", "methods", "grain_masses"):
            values = getattr(self, name)
            if len(set(values)) < len(values):
                raise impossible(name, list(values), "each value once; repeats measures all points again")
        if (count := math.prod(map(len, self.axes))) > _MOST:
            raise impossible("", Words(f"{count} points"), f"at most {_MOST}")
        return self

    @property
    def axes(self) -> tuple[tuple[Any, ...], ...]:
        """Grain masses, frequencies, ceilings, amplitudes, repeats: what takes longest to change first."""
        frequencies, repeats = self.frequencies or self.frequency_ratios, tuple(range(1, self.repeats + 1))
        ceilings = tuple(sorted((*self.heights, *self.methods), key=_rank))
        return self.grain_masses or (None,), frequencies, ceilings, self.amplitudes, repeats


def _rank(ceiling: float | str) -> tuple[bool, bool, float]:
    """Sort no grain last, since a person takes it out, and methods behind heights, of which closed is the lowest."""
    height = ceiling if isinstance(ceiling, float) else 0.0
    return ceiling == "none", ceiling not in ("closed", "none") and isinstance(ceiling, str), height


@dataclass(frozen=True)
class Point:
    """One point of a campaign."""

    number: int  # from 1, whatever the order
    amplitude: float  # of the support [m], of a force [N]
    frequency: float  # [Hz]
    ratio: float  # the same over the resonance [-]
    ceiling: float | str  # height [m], closed, none, or a method
    grain_mass: float  # [kg]; 0: there is none
    mass_fraction: float  # [-]
    repeat: int

    @property
    def is_method(self) -> bool:
        """Whether a method selects the height."""
        return isinstance(self.ceiling, str) and self.ceiling not in ("closed", "none")

    @property
    def text(self) -> str:
        """The point in words."""
        height = f"{self.ceiling:g} m" if isinstance(self.ceiling, float) else self.ceiling
        grain = f"grain {1e3 * self.grain_mass:.4g} g, " if self.grain_mass else ""
        return f"{self.number}: {self.amplitude:g} at {self.frequency:.4g} Hz, {height}, {grain}repeat {self.repeat}"

    def height(self, scene: Scene) -> float | None:
        """Return the height commanded [m]; None where a method selects it."""
        if self.is_method:
            return None
        return self.ceiling if isinstance(self.ceiling, float) else float(scene.ceiling.heights[0][1])

    def scene(self, given: Scene, **changes: Any) -> Scene:
        """Return the stand's scene with this point's excitation and grain, and with `changes`."""
        excitation = {"amplitude": self.amplitude, "frequency": self.frequency}
        return given.with_(mass_fraction=self.mass_fraction, excitation=excitation, **changes)


def from_rest(scene: Scene, amplitude: float, frequency: float, height: float | None, **changes: Any) -> Scene:
    """Return the scene whose excitation [m or N, Hz] grows from rest; then its ceiling opens to `height` [m].

    height: None: the ceiling is as in `changes`.
    """
    if height is not None:
        closed = float(scene.ceiling.heights[0][1])
        end = _RAMP + abs(height - closed) / scene.ceiling.speed
        opening = {"closed": closed, "open": height, "start": _RAMP, "end": end}
        changes["ceiling"] = opening if end > _RAMP else {"height": height}
    excitation = {"amplitude": [[0.0, 0.0], [_RAMP, amplitude]], "frequency": frequency}
    return scene.with_(excitation=excitation, **changes)


def read_campaign(path: Path) -> tuple[Campaign, Scene]:
    """Return the campaign in a YAML file and its scene. Raises CampaignError and SceneError in one line."""
    try:
        mapping = read_yaml(read_text(path, _LARGEST), str(path))
        if comma := decimal_comma(mapping):
            raise CampaignError(f"{path}: {comma}")
        campaign = Campaign.model_validate(mapping, context={"folder": path.parent})
    except FileError as error:
        raise CampaignError(f"{error}; a campaign is a YAML file in UTF-8") from None
    except ValidationError as error:
        raise CampaignError(f"{path}: {explained(error.errors(include_url=False), Campaign)}") from None
    scene = load_scene(campaign.scene)
    if not scene.ceiling.controlled:
        raise CampaignError(f"{campaign.scene}: ceiling: given {scene.ceiling.kind}; allowed: one a controller moves")
    low, high = scene.ceiling.range
    for height in campaign.heights:
        if isinstance(height, float) and not low <= height <= high:
            allowed = f"the ceiling's range, {low:g} to {high:g} m"
            raise CampaignError(f"{path}: heights: given {height:g} m; allowed: {allowed}")
    return campaign, scene


def campaign_in(plan: Document, folder: Path) -> tuple[Campaign, Scene]:
    """Return the campaign and the scene that the plan in a folder keeps. Raises CampaignError, SceneError."""
    try:
        campaign = Campaign.model_validate({**plan["campaign"], "scene": folder})
        return campaign, scene_from_mapping(plan["scene"], source=f"the scene in {folder}", folder=folder)
    except (KeyError, TypeError, ValidationError):
        raise CampaignError(f"{folder}: its plan is damaged, or of another version; give another folder") from None


def points_of(campaign: Campaign, scene: Scene) -> list[Point]:
    """Return all points in the order in which they are measured; each keeps its number in any order."""
    axes = campaign.axes
    # without a grain there are no masses of it
    every = _serpentine([len(axis) for axis in axes])
    places = [place for place in every if axes[2][place[2]] != "none" or place[0] == 0]
    numbers = {place: number for number, place in enumerate(sorted(places), 1)}
    if campaign.order == "random":
        places = random.Random(campaign.seed).sample(sorted(places), len(places))
    points = [_point(campaign, scene, numbers[place], place) for place in places]
    masses = list(dict.fromkeys(point.grain_mass for point in points))
    return sorted(points, key=lambda point: masses.index(point.grain_mass))  # a person changes a grain once


def _serpentine(sizes: list[int]) -> Iterator[tuple[int, ...]]:
    """Yield all places of a grid; each differs from the one before by one step of one axis."""
    if not sizes:
        yield ()
        return
    for number, before in enumerate(_serpentine(sizes[:-1])):
        steps = range(sizes[-1])
        yield from ((*before, step) for step in (reversed(steps) if number % 2 else steps))


def _point(campaign: Campaign, scene: Scene, number: int, place: tuple[int, ...]) -> Point:
    grain, frequency, ceiling, amplitude, repeat = (axis[at] for axis, at in zip(campaign.axes, place, strict=True))
    mass = scene.grain_mass if grain is None else grain
    fraction = mass / (scene.beam.mass + mass)
    resonance = scene.with_(mass_fraction=fraction).natural_frequency_hz
    hertz = frequency if campaign.frequencies else frequency * resonance
    if ceiling == "none":  # at the frequency of the first grain, beside whose points it is drawn
        mass, fraction = 0.0, _NO_GRAIN
    return Point(number, amplitude, hertz, hertz / resonance, ceiling, mass, fraction, repeat)
