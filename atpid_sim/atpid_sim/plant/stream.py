# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant as a stream of blocks: integer ticks, one block per call, sensors at rates of their own.

A sensor adds white noise to an exact signal, and reads NaN outside its range.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import ceil, isfinite, lcm
from typing import Any, Protocol

import numpy as np

from atpid_common.errors import InputError
from atpid_common.injected_faults import Injected
from atpid_sim.plant.sensor_faults import PART_OF, ChannelFaults
from atpid_sim.scene import Scene
from atpid_sim.scene.sensors import Reading
from atpid_sim.system import Array

#: No rate two sensors have in common may be faster than this [Hz]; beyond it the rates are simply incommensurable.
_FASTEST = 1_000_000
#: A sample closer to the end than this share of the time lies beyond the end.
_ROUNDING = 1e-12


class StreamError(InputError):
    """Sensor rates that have no common clock, or a block after the last."""


class PlantLike(Protocol):
    """What a stream needs of `atpid_sim.plant.plant.Plant`."""

    @property
    def height(self) -> float:
        """Height of the ceiling now [m]."""
        ...

    def advance(self, duration_ticks: int, rate: float, target: float, speed: float) -> Any:
        """Advance by ticks of 1/rate [s], the ceiling moving toward target [m] at speed [m/s]; return a PlantBlock."""
        ...


@dataclass(frozen=True)
class Instrument:
    """One simulated device: which channels it reads, at what rate, and with how much noise."""

    device: str
    channels: tuple[str, ...]
    units: tuple[str, ...]
    sensors: tuple[Reading, ...]  # of each channel
    rate: float  # [Hz]
    seed: int
    number: int

    def read(self, block: int, signals: Array) -> Array:
        """Return the readings (n_scans, n_channels) [SI] of exact `signals` of the same shape, NaN where saturated.

        Noise is seeded by scene, device, channel and block: a run repeats, whatever was read before.
        """
        readings = signals.copy()
        for channel, sensor in enumerate(self.sensors):
            column = readings[:, channel]
            if sensor.noise > 0.0:
                generator = np.random.default_rng([self.seed, self.number, channel, block])
                column += sensor.noise * generator.standard_normal(len(column))
            if sensor.saturation is not None:
                low, high = sensor.saturation
                column[(column < low) | (column > high)] = np.nan
        return readings


def laser_of(scene: Scene) -> Instrument:
    """Return the two channels sampled together: the support's displacement [m] or the force [N], and the beam's [m]."""
    drive, laser = scene.driven_by, scene.sensors.laser
    first = laser if scene.drive == "support" else scene.sensors.load_cell or Reading()
    channels, units = (drive.channel, "beam_displacement"), (drive.unit, "m")
    return Instrument("laser", channels, units, (first, laser), laser.rate, scene.seed, 0)


def accelerometer_of(scene: Scene) -> Instrument | None:
    """Return the accelerometer on the beam [m/s^2], if the scene has one."""
    sensor = scene.sensors.accelerometer
    if sensor is None:
        return None
    return Instrument("accelerometer", ("beam_acceleration",), ("m/s^2",), (sensor,), sensor.rate, scene.seed, 1)


@dataclass(frozen=True)
class DeviceBlock:
    """What one device read during one block."""

    instrument: Instrument
    rate: float  # [Hz]
    first_index: int
    data: Array  # (n_scans, n_channels), SI, NaN where saturated


@dataclass(frozen=True)
class StreamBlock:
    """One block: the readings, the laser's always first, and the true motion at the laser's instants."""

    number: int
    first_index: int  # of the laser's first scan
    scans: int  # of the laser
    readings: tuple[DeviceBlock, ...]
    truth: Any  # PlantBlock at `truth_stride` ticks a laser scan
    truth_stride: int

    def truth_series(self, name: str) -> Array:
        """Return one exact series (scans,) at the laser's instants: support [m or N], beam, grain or ceiling [m]."""
        series: Array = np.ascontiguousarray(getattr(self.truth, name)[:: self.truth_stride])
        return series


class Stream:
    """Cuts a scene's run into blocks of whole samples of every sensor; the last one may be shorter."""

    def __init__(self, scene: Scene, plant: PlantLike) -> None:
        """Prepare the first block; raise StreamError where the sensors' rates have no common clock."""
        self._scene, self._plant = scene, plant
        self.laser = laser_of(scene)
        second = accelerometer_of(scene)
        self.instruments = (self.laser, second) if second else (self.laser,)
        self.rate = common_rate([item.rate for item in self.instruments])
        self.faults: tuple[Injected, ...] = scene.injected
        self._channels = {item.device: [ChannelFaults(PART_OF.get(name, ""), item.rate, scene.seed)
                                        for name in item.channels] for item in self.instruments}  # fmt: skip
        self._strides = {item.device: round(self.rate / item.rate) for item in self.instruments}
        stride = self._strides["laser"]
        self.ticks_per_block = max(1, round(scene.recording.block * scene.sensors.laser.rate)) * stride
        # a faster sensor must not read beyond the end, where nothing drives the support any more
        whole = max(1, round(scene.duration * scene.sensors.laser.rate)) * stride
        self.ticks = min(whole, samples_before(scene.duration, self.rate))
        self.blocks = ceil(self.ticks / self.ticks_per_block)
        self.block_seconds = self.ticks_per_block / self.rate
        self._next = 0

    @property
    def finished(self) -> bool:
        """Whether the last block has been computed."""
        return self._next >= self.blocks

    @property
    def height(self) -> float:
        """Height of the ceiling now [m]."""
        return self._plant.height

    @property
    def computed_ticks(self) -> int:
        """Ticks of 1/rate [s] computed so far."""
        return min(self._next * self.ticks_per_block, self.ticks)

    @property
    def computed_scans(self) -> int:
        """Laser scans computed so far."""
        return -(-self.computed_ticks // self._strides["laser"])

    def advance(self, target: float, speed: float) -> StreamBlock:
        """Compute the next block while the ceiling goes toward `target` [m] at `speed` [m/s], 0 to hold.

        Raises StreamError after the last block, and what the plant raises.
        """
        if self.finished:
            raise StreamError(f"the run of {self._scene.duration:g} s is over: its {self.blocks} blocks are computed")
        number, first = self._next, self._next * self.ticks_per_block
        ticks = min(self.ticks_per_block, self.ticks - first)
        if not self._scene.ceiling.controlled:
            target, speed = self._own_ceiling((first + ticks) / self.rate, ticks / self.rate)
        elif isfinite(target):
            # a real position sensor may read a closed ceiling a little too low; the grain holds the ceiling up
            target = max(target, 2.0 * self._scene.grain.radius)
        truth = self._plant.advance(ticks, self.rate, target, speed)
        self._next += 1
        readings = tuple(self._read(item, number, first, truth) for item in self.instruments)
        laser = readings[0]
        return StreamBlock(number, laser.first_index, len(laser.data), readings, truth, self._strides["laser"])

    def _own_ceiling(self, end: float, duration: float) -> tuple[float, float]:
        """Target [m] and speed [m/s] where the scene itself, and no controller, moves the ceiling."""
        times, heights = zip(*self._scene.ceiling.heights, strict=True)
        target = float(np.interp(end, times, heights))
        return target, abs(target - self._plant.height) / duration

    def _read(self, instrument: Instrument, number: int, first: int, truth: Any) -> DeviceBlock:
        stride = self._strides[instrument.device]
        names = {"laser": ("support", "beam"), "accelerometer": ("beam_acceleration",)}[instrument.device]
        signals = np.stack([np.asarray(getattr(truth, name))[::stride] for name in names], axis=1)
        index, readings = first // stride, instrument.read(number, signals)
        for column, channel in enumerate(self._channels[instrument.device]):
            readings[:, column] = channel.act(self.faults, index, readings[:, column])
        return DeviceBlock(instrument, instrument.rate, index, readings)


def common_rate(rates: list[float]) -> float:
    """Return the slowest rate [Hz] that is a whole multiple of every one of `rates`; raise StreamError if none."""
    exact = [Fraction(rate).limit_denominator(1000) for rate in rates]
    unit = lcm(*(rate.denominator for rate in exact))
    common = Fraction(lcm(*(int(rate * unit) for rate in exact)), unit)
    if common > _FASTEST:
        given = ", ".join(f"{rate:g}" for rate in rates)
        raise StreamError(
            f"sensors: given rates {given} Hz; allowed: rates with a common multiple up to {_FASTEST} Hz; round one"
        )
    return float(common)


def samples_before(end: float, rate: float) -> int:
    """Return how many samples at `rate` [Hz], the first at zero, lie before `end` [s]; at least one."""
    return max(1, ceil(end * rate * (1.0 - _ROUNDING)))


def stamp_ns(start_ns: int, index: int, rate: float) -> int:
    """Return the instant [ns] of sample `index` at `rate` [Hz] after `start_ns`, rounded once, exact for any index."""
    return start_ns + round(Fraction(index * 1_000_000_000) / Fraction(rate))


def last_stamp_ns(begin_ns: int, first_index: int, scans: int, rate: float) -> int:
    """Return when a block's last scan was taken [ns]: the stream's start plus index over rate, rounded once.

    begin_ns: stamp of its first scan; first_index: of that scan; scans: how many it has; rate [Hz].
    """
    if scans == 0 or not rate > 0.0:
        return begin_ns
    start = begin_ns - stamp_ns(0, first_index, rate)
    return stamp_ns(start, first_index + scans - 1, rate)
