# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Plausibility of a scene: values that are possible but unusual, as after a wrong unit. They are run all the same."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from atpid_sim.contact.materials import mismatch
from atpid_sim.contact.spec import ElasticSpec
from atpid_sim.scene.excitation import RandomExcitation, ShockExcitation, TonesExcitation
from atpid_sim.scene.model import SceneValues

#: Largest support amplitude in use [m]: the thesis goes to 0.08 m.
LARGEST_AMPLITUDE = 0.2

#: Acceleration of gravity [m/s^2]; what of it is not along the motion presses the grain on a side wall.
STANDARD_GRAVITY = 9.80665
#: Limits of the straight motion that is computed: deceleration by friction on a side wall over the acceleration of the
#: closed damper [-], and rotation of the container at its amplitude [rad] (docs/horizontal.md).
FRICTION_LIMIT, SLOPE_LIMIT = 0.005, 0.03

_MILLIMETRES = "lengths are in metres"


class Quantity(NamedTuple):
    """A value of a scene, or one computed from it, and its usual range; `hint` names a frequent cause."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    hint: str = ""

    def warning(self) -> str | None:
        """Return the line that states value and usual range; None inside the range."""
        if self.low <= self.value <= self.high:
            return None
        usual = f"{_shown(self.low)} to {_shown(self.high)}"
        if math.isinf(self.high) or self.low == 0.0:
            usual = f"at least {_shown(self.low)}" if math.isinf(self.high) else f"at most {_shown(self.high)}"
        unit = f" {self.unit}" if self.unit else ""
        hint = f"; {self.hint}" if self.hint else ""
        return f"{self.name}: {_shown(self.value)}{unit} is unusual (usual: {usual}{unit}){hint}"


def _shown(value: float) -> str:
    """Return four digits, without an exponent up to a million."""
    return f"{float(f'{value:.4g}'):.10g}" if 1e-3 <= abs(value) < 1e6 else f"{value:.4g}"


def warnings_of(scene: SceneValues) -> list[str]:
    """Return one line for each unusual value of the scene: key, value, usual range."""
    parts = (_structure, _excitation, _sideways, _ceiling, _measurement)
    quantities = (quantity for part in parts for quantity in part(scene))
    lines = [line for quantity in quantities if (line := quantity.warning()) is not None]
    if isinstance(scene.contact, ElasticSpec):
        other = mismatch(_grain_density(scene), scene.contact.young_modulus)
        lines += [f"contact.young_modulus: {other}"] if other else []
    return lines


def _grain_density(scene: SceneValues) -> float:
    """Return the density of the grain, a sphere [kg/m^3]."""
    return scene.grain_mass / (4.0 / 3.0 * math.pi * scene.grain.radius**3)


def _structure(scene: SceneValues) -> Iterator[Quantity]:
    critical = 2.0 * math.sqrt(scene.beam.stiffness * scene.total_mass)
    heavy = f"a grain of {1e3 * scene.grain_mass:.4g} g and {1e3 * scene.grain.radius:.4g} mm radius"
    yield Quantity("beam.mass", scene.beam.mass, 1e-3, 1e4, "kg", "masses are in kilograms")
    yield Quantity("beam, resonance with the damper closed", scene.natural_frequency_hz, 0.1, 1e3, "Hz")
    yield Quantity(
        "beam.damping, as a damping ratio", scene.beam.damping / critical, 1e-5, 0.5, "", "0.01 is one per cent"
    )
    yield Quantity("beam, static deflection", scene.static_deflection, 0.0, 0.5, "m", "too heavy or too soft?")
    yield Quantity("grain.radius", scene.grain.radius, 2e-4, 0.2, "m", _MILLIMETRES)
    yield Quantity("grain, density", _grain_density(scene), 100.0, 23_000.0, "kg/m^3", heavy)
    if scene.gravity != 0.0:
        yield Quantity("gravity", scene.gravity, 1.0, 30.0, "m/s^2")
    if isinstance(scene.contact, ElasticSpec):
        modulus = scene.contact.young_modulus
        yield Quantity("contact.young_modulus", modulus, 1e4, 1.3e12, "Pa", "rubber 2e6, steel 2.1e11")


def _excitation(scene: SceneValues) -> Iterator[Quantity]:
    excitation = scene.excitation
    if excitation.is_free:
        yield Quantity("excitation.free.deflection", abs(excitation.deflection), 0.0, 1.0, "m", _MILLIMETRES)
    if isinstance(excitation, ShockExcitation):
        travel = abs(excitation.shock.travel_of(scene.natural_frequency_hz))
        hint = "the velocity of the pulse times half the compensation"
        yield Quantity("excitation.shock, displacement in the end", travel, 0.0, LARGEST_AMPLITUDE, "m", hint)
    if isinstance(excitation, RandomExcitation):
        grown = scene.steady_window[0] / excitation.random.rise_in(scene.duration)
        yield Quantity("steady_window, its begin over the rise of the random motion", grown, 1.0, math.inf, "")
    if isinstance(excitation, TonesExcitation):
        for part in excitation.tones:
            ratio = 1.0 if isinstance(part.frequency, str) else part.frequency / scene.natural_frequency_hz
            yield Quantity("excitation.tones, frequency over the resonance", ratio, 0.1, 10.0, "")
    amplitude = scene.excitation.largest_amplitude
    if amplitude > 0.0 and scene.drive == "support":
        yield Quantity("excitation, amplitude", amplitude, 1e-6, LARGEST_AMPLITUDE, "m", _MILLIMETRES)
    if excitation.is_tone:
        tones = [frequency for _, frequency in excitation.frequency_points] or [scene.frequency_hz]
        for tone in dict.fromkeys((min(tones), max(tones))):
            yield Quantity("excitation.frequency over the resonance", tone / scene.natural_frequency_hz, 0.1, 10.0, "")
        name = "excitation, steady amplitude of the beam with the damper closed"
        yield Quantity(name, scene.linear_amplitude(amplitude, grain=True), 0.0, 5.0, "m")


def friction_number(friction: float, gravity: float, acceleration: float) -> float:
    """Return the deceleration of a grain that slides on a side wall over an acceleration [m/s^2] of the beam [-].

    gravity: along the motion [m/s^2]; the rest of the standard gravity acts on the side wall.
    """
    return friction * math.sqrt(max(STANDARD_GRAVITY**2 - gravity**2, 0.0)) / max(acceleration, 1e-300)


def _sideways(scene: SceneValues) -> Iterator[Quantity]:
    points = scene.excitation.amplitude_points if scene.excitation.is_tone else ()
    sizes = [scene.linear_amplitude(amplitude, grain=True) for _, amplitude in points if amplitude > 0.0]
    if not sizes:
        return
    least = (2.0 * math.pi * scene.frequency_hz) ** 2 * min(sizes)
    slides = friction_number(scene.container.side_friction or 0.0, scene.gravity, least)
    turns = scene.container.slope * max(sizes) if scene.container.slope else 0.0
    name = "container.side_friction, deceleration over the closed damper's acceleration"
    hint = "sliding and rolling are left out: smoother walls, larger amplitudes, or measure (docs/horizontal.md)"
    yield Quantity(name, slides, 0.0, FRICTION_LIMIT, "", hint)
    name = "container.slope, rotation at the closed damper's amplitude"
    hint = "impacts on side walls are left out: a longer beam, or two in parallel (docs/horizontal.md)"
    yield Quantity(name, turns, 0.0, SLOPE_LIMIT, "rad", hint)


def _ceiling(scene: SceneValues) -> Iterator[Quantity]:
    ceiling, heights = scene.ceiling, scene.ceiling.heights
    speeds = [abs(h1 - h0) / (t1 - t0) for (t0, h0), (t1, h1) in pairwise(heights)]
    highest = max(height for _, height in heights)
    if ceiling.controlled:
        highest, speeds = ceiling.range[1], [ceiling.speed]
    yield Quantity("ceiling, largest height", highest, 0.0, 3.0, "m", _MILLIMETRES)
    if ceiling.controlled:
        yield Quantity("ceiling.speed", ceiling.speed, 1e-3, 5.0, "m/s", _MILLIMETRES)
    elif speeds:
        yield Quantity("ceiling, largest speed", max(speeds), 0.0, 5.0, "m/s")


def _measurement(scene: SceneValues) -> Iterator[Quantity]:
    amplitude, laser = scene.excitation.largest_amplitude, scene.sensors.laser
    if scene.excitation.is_tone:
        begin, end = scene.steady_window
        periods = (end - begin) * scene.frequency_hz
        yield Quantity("steady_window, in periods", periods, 2.0, math.inf, "", "amplitudes are taken in it")
        yield Quantity("sensors.laser.rate, samples a period", laser.rate / scene.frequency_hz, 20.0, math.inf, "")
    if amplitude > 0.0 and scene.drive == "support":
        yield Quantity("sensors.laser.noise over the amplitude", laser.noise / amplitude, 0.0, 0.2, "", _MILLIMETRES)
