# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant as a stream of blocks: integer ticks, one block per call, sensors at rates of their own.

A sensor adds white noise to an exact signal, and reads NaN outside its range. Injected faults change readings and
stamps.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, isfinite, lcm
from typing import Any, Protocol

import numpy as np

from atpid_common.errors import InputError
from atpid_common.injected_faults import FAULT_KINDS, Injected, active_fault
from atpid_sim.scene import Scene
from atpid_sim.scene.sensors import Reading
from atpid_sim.system import Array

#: Channels of the simulated stand and the part that measures each.
_PART_OF = {
    "support_displacement": "support_laser",
    "beam_displacement": "beam_laser",
    "beam_acceleration": "accelerometer",
}
#: Readings kept for a delay: the longest delay [s].
_KEPT = FAULT_KINDS["support_laser"]["delayed"].high
#: An intermittent clock is behind by so much [s].
_BEHIND = 0.5


class ChannelFaults:
    """The faults of one channel, injected into its readings; without one the readings are passed through unchanged."""

    def __init__(self, part: str, rate: float, seed: int) -> None:
        """Take the part (`_PART_OF`), the channel's rate [Hz] and the seed of random readings."""
        self.part, self._rate, self._seed = part, rate, seed
        self._past = np.empty(0)  # what the working sensor read, up to `_KEPT`
        self._last = math.nan  # what was read last with the fault injected: where a stuck sensor stays

    def act(self, faults: Sequence[Injected], first_index: int, readings: Array) -> Array:
        """Return the readings (n,) that begin at scan `first_index`, with the faults of this part injected."""
        mine = [fault for fault in faults if fault.part == self.part]
        time = (first_index + np.arange(readings.size)) / self._rate
        known = np.concatenate((self._past, readings))
        out = readings.copy()
        for fault in mine:
            during = (time >= fault.begin) & (time < fault.end)
            if during.any():
                out[during] = self._faulty(fault, time, known, out)[during]
        longest = max((fault.value for fault in mine if fault.kind == "delayed"), default=0.0)
        keep = round(min(longest, _KEPT) * self._rate)
        self._past = known[known.size - keep :] if keep else np.empty(0)
        self._last = float(out[-1]) if out.size else self._last
        return out

    def _faulty(self, fault: Injected, time: Array, known: Array, readings: Array) -> Array:
        match fault.kind:
            case "off":
                return np.full_like(readings, np.nan)
            case "stuck":
                before = np.flatnonzero(time < fault.begin)
                return np.full_like(readings, readings[before[-1]] if before.size else self._last)
            case "garbage":
                generator = np.random.default_rng([self._seed, 7, round(time[0] * self._rate)])
                return generator.uniform(-fault.value, fault.value, readings.size)
            case "wrong":
                return readings * fault.value
            case "slow":
                return self._lagging(fault, time, readings)
            case "delayed":
                back = round(fault.value * self._rate)
                places = np.arange(known.size - readings.size, known.size) - back
                return np.where(places < 0, np.nan, known[np.maximum(places, 0)])
            case _:
                return np.where((time - fault.begin) % fault.value >= 0.5 * fault.value, np.nan, readings)

    def _lagging(self, fault: Injected, time: Array, readings: Array) -> Array:
        share = -math.expm1(-1.0 / (fault.value * self._rate))
        value, out = self._last, readings.copy()
        for place in range(readings.size):
            if time[place] < fault.begin or math.isnan(value):
                value = readings[place]
            elif not math.isnan(readings[place]):
                value += share * (readings[place] - value)
            out[place] = value
        return out


def stamp_shift(faults: Sequence[Injected], time: float, stamp_ns: int, seed: int) -> int:
    """Return by how much [ns] a clock's faults put the stamp `stamp_ns` of an instant `time` [s] after the start off.

    seed: of random stamps.
    """
    fault = active_fault(faults, time, "clock")
    return round(_seconds_off(fault, time, stamp_ns, seed) * 1e9) if fault else 0


def _seconds_off(fault: Injected, time: float, stamp_ns: int, seed: int) -> float:
    elapsed = time - fault.begin
    match fault.kind:
        case "off":
            return -stamp_ns * 1e-9
        case "stuck":
            return -elapsed
        case "garbage":
            generator = np.random.default_rng([seed, 8, round(time * 1e6)])
            return float(generator.uniform(-fault.value, fault.value))
        case "wrong":
            return fault.value
        case "slow":
            return -fault.value * elapsed
        case "delayed":
            return -fault.value
        case _:
            return -_BEHIND if fault.gap(time) else 0.0


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


def _accelerometer_of(scene: Scene) -> Instrument | None:
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
        second = _accelerometer_of(scene)
        self.instruments = (self.laser, second) if second else (self.laser,)
        self.rate = common_rate([item.rate for item in self.instruments])
        self.faults: tuple[Injected, ...] = scene.injected
        self._channels = {
            item.device: [ChannelFaults(_PART_OF.get(name, ""), item.rate, scene.seed) for name in item.channels]
            for item in self.instruments
        }
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
            # the scene itself, and no controller, moves the ceiling
            times, heights = zip(*self._scene.ceiling.heights, strict=True)
            target = float(np.interp((first + ticks) / self.rate, times, heights))
            speed = abs(target - self._plant.height) / (ticks / self.rate)
        elif isfinite(target):
            # a real position sensor may read a closed ceiling a little too low; the grain holds the ceiling up
            target = max(target, 2.0 * self._scene.grain.radius)
        truth = self._plant.advance(ticks, self.rate, target, speed)
        self._next += 1
        readings = tuple(self._read(item, number, first, truth) for item in self.instruments)
        laser = readings[0]
        return StreamBlock(number, laser.first_index, len(laser.data), readings, truth, self._strides["laser"])

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
