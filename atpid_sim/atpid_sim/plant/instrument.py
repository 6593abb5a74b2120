# SPDX-License-Identifier: Apache-2.0
"""Sensors of the plant's exact signals: white noise of each, NaN outside the range."""

from dataclasses import dataclass

import numpy as np

from atpid_sim.scene import Scene
from atpid_sim.scene.sensors import Sensor
from atpid_sim.system import Array


@dataclass(frozen=True)
class Instrument:
    """One simulated device: which channels it reads, every how many ticks, and with how much noise."""

    device: str
    channels: tuple[str, ...]
    units: tuple[str, ...]
    sensor: Sensor
    seed: int
    number: int

    def read(self, block: int, signals: Array) -> Array:
        """Return the readings (n_scans, n_channels) [SI] of exact `signals` of the same shape, NaN where saturated.

        Noise is seeded by scene, device, channel and block: a run repeats, whatever was read before.
        """
        readings = signals.copy()
        for channel in range(len(self.channels)) if self.sensor.noise > 0.0 else ():
            generator = np.random.default_rng([self.seed, self.number, channel, block])
            readings[:, channel] += self.sensor.noise * generator.standard_normal(len(readings))
        if self.sensor.saturation is not None:
            low, high = self.sensor.saturation
            readings[(readings < low) | (readings > high)] = np.nan
        return readings


def laser_of(scene: Scene) -> Instrument:
    """Return the two laser channels: support and beam displacement [m]."""
    channels = ("support_displacement", "beam_displacement")
    return Instrument("laser", channels, ("m", "m"), scene.sensors.laser, scene.seed, 0)


def accelerometer_of(scene: Scene) -> Instrument | None:
    """Return the accelerometer on the beam [m/s^2], if the scene has one."""
    sensor = scene.sensors.accelerometer
    return Instrument("accelerometer", ("beam_acceleration",), ("m/s^2",), sensor, scene.seed, 1) if sensor else None
