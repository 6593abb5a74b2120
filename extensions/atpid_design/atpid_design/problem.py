# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a design is made for: structure, amplitudes, contact, aim, uncertainties; and the structures within these."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError, model_validator

from atpid_common.errors import InputError
from atpid_common.files import Document
from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.fields import Fraction, Hertz, Mass, Modulus, Number, SceneBlock, Words, impossible, within
from atpid_sim.kernel_inputs import Contact, contact_of
from atpid_sim.maps import DamperResponse
from atpid_sim.modal import Modes
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.scene.scene import explained
from atpid_sim.scene.structure import FurtherMode
from atpid_sim.system import Array

#: Poisson's ratio of grain and walls: the thesis's. The contact stiffness changes by 7 % from 0.2 to 0.3.
POISSON = 0.2
#: Accelerations are shown over this [m/s^2], whatever the gravity along the motion.
STANDARD_GRAVITY = 9.80665
#: Radii are rounded up to this [m].
_RADIUS_STEP = 1e-4
#: Range of the restitution, with its uncertainty [-].
_LEAST_RESTITUTION, _MOST_RESTITUTION = 0.01, 0.99
#: Tolerance of the scene: relative error of the amplitude [-].
_TOLERANCE = 1e-6
#: Relative tolerance of the runs: 0.2 % of an amplitude is resolved.
RTOL = 1e-5

#: What amplitudes may be, and the largest of a support [m].
RISING = (
    "LO:HI, two rising amplitudes in metres, such as 0.001:0.004, at most 1; 1 mm is 0.001; of a force in newtons, at "
    "most 1000"
)
_LARGEST_SUPPORT = 1.0
#: Frequencies of a range that a design is made at: so far apart, relative, and at most so many. The box of the natural
#: frequency fills in what lies between them.
_APART, _MOST_FREQUENCIES = 0.03, 6
#: Frequencies of the excitation over the natural one for which heights are selected [-].
_LOWEST, _HIGHEST = 0.5, 2.0

Share = Annotated[Number, within(0.0, 0.5, hint="a share: 10 % is 0.1")]
_DriveAmplitude = Annotated[Number, within(1e-6, 1e3, hint="in metres or newtons: 1 mm is 0.001")]
_BuiltLength = Annotated[Number, within(1e-6, 10.0, hint="in metres: 10 mm is 0.01")]
Target = Annotated[Number, within(0.01, 0.99, hint="a share: 80 % is 0.8")] | None


class DesignError(InputError):
    """A design that cannot be made: what was given, what is allowed, what to do."""


class Uncertainty(SceneBlock):
    """How far each quantity may lie from its value, to either side; relative but for the height."""

    mass: Share = Field(default=0.02, description="mass of the beam [-]")
    frequency: Share = Field(default=0.02, description="natural frequency [-]")
    damping: Share = Field(default=0.1, description="damping ratio of the beam [-]")
    restitution: Share = Field(default=0.2, description="restitution [-]")
    young_modulus: Share = Field(default=0.2, description="Young's modulus of grain and walls [-]")
    detuning: Annotated[Number, within(0.0, 0.03)] = Field(
        default=0.005, description="distance of the excitation from its frequency [-]"
    )
    amplitude: Share = Field(default=0.01, description="identified amplitude of support or force [-]")
    height: Annotated[Number, within(0.0, 0.1, hint="in metres: 0.5 mm is 0.0005")] = Field(
        default=5e-4, description="position of the ceiling [m]"
    )


class Deviation(NamedTuple):
    """A structure that differs from the given one, by the names and units of `Uncertainty`."""

    mass: float = 0.0
    frequency: float = 0.0
    damping: float = 0.0
    restitution: float = 0.0
    young_modulus: float = 0.0
    detuning: float = 0.0
    amplitude: float = 0.0
    height: float = 0.0
    further: tuple[tuple[float, float, float], ...] = ()  # mass, frequency, damping of each mode beside the first


NOMINAL = Deviation()
#: Amplitude of the support [m], or points of it (t [s], amplitude).
Level = float | list[list[float]]
#: Frequency of the excitation [Hz]; None: the structure's resonance with the damper closed.
Tone = float | None


class Problem(SceneBlock):
    """A structure with its excitation, and what is asked of the damper."""

    mass: Mass = Field(description="reduced mass of beam and container, without the grain [kg]")
    frequency: Hertz = Field(description="natural frequency of the beam without the grain [Hz]")
    damping: Annotated[Number, within(5e-4, 0.2, hint="a ratio: 0.8 % is 0.008")] = Field(
        description="damping ratio of the beam alone [-]"
    )
    amplitudes: tuple[_DriveAmplitude, _DriveAmplitude] = Field(
        description="least and largest amplitude of the support [m], or of the force [N]"
    )
    drive: Literal["support", "force"] = Field(
        default="support", description="what shakes the structure: its support, or a force on it [N]"
    )
    further_modes: tuple[FurtherMode, ...] = Field(default=(), description="modes beside that of mass and frequency")
    excitation_frequency: tuple[Hertz, Hertz] | None = Field(
        default=None,
        description="frequency of the excitation, or the range in which it drifts [Hz]; default: the resonance of the "
        "structure with the closed damper",
    )
    restitution: Annotated[Number, within(_LEAST_RESTITUTION, 0.95)] = Field(
        default=0.15, description="rebound speed over approach speed, grain and walls [-]"
    )
    young_modulus: Modulus = Field(default=2.1e8, description="Young's modulus of grain and walls [Pa]")
    density: Annotated[Number, within(10.0, 25_000.0)] = Field(default=7850.0, description="of the grain [kg/m^3]")
    gravity: Annotated[Number, within(0.0, 100.0)] = Field(
        default=9.81, description="along the motion; 0 where it is horizontal [m/s^2]"
    )
    side_friction: Annotated[Number, within(0.0, 10.0)] = Field(
        default=0.3,
        description="friction coefficient of the grain on a side wall, where gravity is not along the motion [-]",
    )
    slope: Annotated[Number, within(0.0, 1e6)] = Field(
        default=0.0,
        description="rotation of the container over its displacement, of a cantilever 1.5 over the length [rad/m]",
    )
    max_mass_fraction: Annotated[Fraction, within(0.01, 0.6)] = Field(
        default=0.3, description="largest grain mass over the mass of beam and grain [-]"
    )
    max_height: _BuiltLength = Field(default=3.0, description="largest height of the ceiling [m]")
    target_efficiency: Target = Field(
        default=None, description="least efficiency, against the closed damper, at every amplitude [-]"
    )
    target_reduction: Target = Field(
        default=None, description="least reduction, against the structure without the damper, at every amplitude [-]"
    )
    lever: _BuiltLength = Field(default=0.01, description="lever arm of the motor's drive [m]")
    motor_speed: Annotated[Number, within(1.0, 1e5)] = Field(default=3000.0, description="of the motor [1/min]")
    yield_strength: Modulus | None = Field(default=None, description="of the softer of grain and walls [Pa]")
    uncertainty: Uncertainty = Uncertainty()

    @model_validator(mode="after")
    def _rising(self) -> Problem:
        if not self.amplitudes[0] < self.amplitudes[1] <= (_LARGEST_SUPPORT if self.drive == "support" else math.inf):
            raise impossible("amplitudes", Words("{:g}:{:g}".format(*self.amplitudes)), RISING)
        if self.excitation_frequency is not None:
            low, high = self.excitation_frequency
            least, most = _LOWEST * self.frequency, _HIGHEST * self.frequency
            if not least <= low <= high <= most:
                given = Words(f"{low:g}:{high:g}" if low != high else f"{low:g}")
                raise impossible(
                    "excitation_frequency",
                    given,
                    f"HZ, or LO:HI with LO below HI, from {least:g} to {most:g} Hz, half to twice --frequency",
                )
        return self

    @property
    def is_modal(self) -> bool:
        """Whether the structure has several modes or a force drives it (`Scene.modes`)."""
        return bool(self.further_modes) or self.drive == "force"

    @property
    def quantities(self) -> int:
        """How many quantities are uncertain: those of `Uncertainty`, and three of each further mode."""
        return len(Uncertainty.model_fields) + 3 * len(self.further_modes)

    @property
    def unit(self) -> tuple[float, str]:
        """What amplitudes of the drive are multiplied by where they are shown, and their unit."""
        return (1e3, "mm") if self.drive == "support" else (1.0, "N")

    def level(self, amplitude: float) -> str:
        """Return an amplitude of the drive in words."""
        scale, unit = self.unit
        return f"±{scale * amplitude:.3g} {unit}"

    @property
    def aim(self) -> Literal["efficiency", "reduction"]:
        """What grains are chosen by: the reduction where the excitation's frequency or such a target is given."""
        own = self.excitation_frequency is None and self.target_reduction is None
        return "efficiency" if own else "reduction"

    @property
    def frequencies(self) -> list[Tone]:
        """Frequencies of the excitation to design for [Hz]; None: the resonance of each structure, damper closed."""
        if self.excitation_frequency is None:
            return [None]
        low, high = self.excitation_frequency
        if low == high:
            return [low]
        count = min(2 + int(math.log(high / low) / _APART), _MOST_FREQUENCIES)
        return [low, *map(float, np.geomspace(low, high, count)[1:-1]), high]


def problem_of(**given: object) -> Problem:
    """Return the problem of the options given. Raises DesignError in one line, which names the option."""
    try:
        return Problem.model_validate(given)
    except ValidationError as error:
        key, _, rest = explained(error.errors(include_url=False)).partition(":")
        raise DesignError(f"--{key.replace('_', '-').replace('.', ' ')}:{rest}") from None


def grain_mass(problem: Problem, fraction: float) -> float:
    """Return the grain's mass [kg] for a mass fraction [-]."""
    return problem.mass * fraction / (1.0 - fraction)


def grain_radius(problem: Problem, fraction: float) -> float:
    """Return the radius [m] of a sphere of that mass, rounded up to a tenth of a millimetre."""
    volume = grain_mass(problem, fraction) / problem.density
    radius = math.pow(3.0 * volume / (4.0 * math.pi), 1.0 / 3.0)
    return round(math.ceil(radius / _RADIUS_STEP) * _RADIUS_STEP, 6)


def mapping_of(
    problem: Problem, fraction: float, amplitude: Level, off: Deviation = NOMINAL, frequency: Tone = None
) -> Document:
    """Return the blocks of a scene that describe the system with a grain of a mass fraction [-], off by a deviation.

    amplitude: of the support [m], or points of it; frequency: of the excitation [Hz], None: the structure's resonance.
    The grain's mass is known: another mass of the beam is another mass fraction.
    """
    mass, weight = problem.mass * (1.0 + off.mass), grain_mass(problem, fraction)
    share = fraction if off.mass == 0.0 else weight / (mass + weight)
    natural = problem.frequency * (1.0 + off.frequency)
    restitution = problem.restitution * (1.0 + off.restitution)
    restitution = min(max(restitution, _LEAST_RESTITUTION), _MOST_RESTITUTION)
    further = _further(problem, off)
    container = weight / (weight + 1.0 / sum(1.0 / each for each in (mass, *(one["mass"] for one in further))))
    # beta of Tsuji's law (Eq. 3.23), whose own damping ratio, from which alone the restitution follows, is
    # c / sqrt(5 k m) with the reduced mass m = m_g (1 - met) and c = 2 beta sqrt(k m_g)
    met = container if further else share  # of the grain in its mass and what an impulse meets
    beta = float(0.5 * damping_ratio_for(restitution) * math.sqrt(5.0 * (1.0 - met)))
    mapping: Document = {
        "beam": {"mass": mass, "frequency": natural, "damping_ratio": problem.damping * (1.0 + off.damping)},
        "grain": {"mass_fraction": share, "radius": grain_radius(problem, fraction)},
        "contact": {
            "law": "tsuji",
            "young_modulus": problem.young_modulus * (1.0 + off.young_modulus),
            "poisson_ratio": POISSON,
            "damping_ratio": beta,
        },
        "excitation": {"amplitude": amplitude, "frequency": "resonance"},
        "gravity": problem.gravity,
        "tolerance": _TOLERANCE,
    }
    if problem.is_modal:
        mapping |= {"further_modes": further, "drive": problem.drive}
    if frequency is None and off.detuning != 0.0:
        frequency = _standing(mapping).natural_frequency_hz if further else natural * math.sqrt(1.0 - share)
    if frequency is not None:
        mapping["excitation"]["frequency"] = frequency * (1.0 + off.detuning)
    return mapping


def _further(problem: Problem, off: Deviation) -> list[dict[str, float]]:
    """Return the blocks of the further modes, off by a deviation; without one of theirs they are as given."""
    found = []
    offs = off.further or ((0.0, 0.0, 0.0),) * len(problem.further_modes)
    for mode, (mass, frequency, damping) in zip(problem.further_modes, offs, strict=True):
        heavier, faster = 1.0 + mass, 1.0 + frequency
        own = {"mass": heavier * mode.mass, "stiffness": heavier * faster**2 * mode.stiffness}
        own["damping"] = heavier * faster * (1.0 + damping) * mode.damping
        found.append(own | {"drive_factor": mode.drive_factor})
    return found


def _standing(mapping: Document) -> Scene:
    """Return the scene of a system's blocks with the damper closed."""
    run = {"ceiling": {"height": 2.0 * mapping["grain"]["radius"]}, "duration": 1.0}
    return scene_from_mapping(mapping | run, source="design")


def scene_of(
    problem: Problem, fraction: float, amplitude: float, height: float, off: Deviation = NOMINAL, frequency: Tone = None
) -> Scene:
    """Return the scene of a structure off by a deviation, support amplitude and ceiling [m] off as well.

    It lasts until the closed damper's transient is over. Raises SceneError for an invalid value.
    """
    mapping = mapping_of(problem, fraction, amplitude * (1.0 + off.amplitude), off, frequency)
    diameter = 2.0 * grain_radius(problem, fraction)
    duration = 8.0 * time_constant(problem, fraction) + 40.0 / problem.frequency
    run = {"ceiling": {"height": max(height + off.height, diameter)}, "duration": duration}
    return scene_from_mapping(mapping | run, source="design")


def modes_of(problem: Problem, fraction: float, off: Deviation = NOMINAL) -> Modes | None:
    """Return the modes of a structure off by a deviation with a grain of a mass fraction [-]; None: it has one."""
    if not problem.is_modal:
        return None
    return _standing(mapping_of(problem, fraction, 0.0, off, problem.frequency)).modes


def resonance(problem: Problem, fraction: float) -> float:
    """Return the natural frequency of the structure with the damper closed [Hz]: of one mode, beam and grain as one."""
    if (modes := modes_of(problem, fraction)) is not None:
        return float(modes.joined.frequencies[0])
    return problem.frequency * math.sqrt(1.0 - fraction)


def time_constant(problem: Problem, fraction: float) -> float:
    """Return the time constant [s] of the closed damper's free decay, 2 M / c; of several modes, of the first."""
    if (modes := modes_of(problem, fraction)) is not None:
        return 2.0 * float(modes.joined.mass[0] / modes.joined.damping[0])
    return 1.0 / (2.0 * math.pi * problem.frequency * problem.damping * (1.0 - fraction))


class Case(NamedTuple):
    """A structure, how its support amplitude differs from the identified one, and its ceiling from the command."""

    damper: DamperResponse
    off: Deviation
    contact: Contact

    def amplitude(self, identified: float) -> float:
        """Return the true support amplitude [m] where `identified` [m] is."""
        return identified * (1.0 + self.off.amplitude)

    def height(self, commanded: float) -> float:
        """Return the true height [m] where `commanded` [m] is."""
        return max(commanded + self.off.height, self.damper.diameter)

    def bare(self, identified: float) -> float:
        """Return the amplitude of the same structure without the damper at the same excitation [m]."""
        return self.damper.bare_amplitude(self.amplitude(identified))


def deviation(problem: Problem, point: Array) -> Deviation:
    """Return the deviation at a point (quantities,) of the box, from -1 to 1 in each; a further mode's come last."""
    names = list(Uncertainty.model_fields)
    u = problem.uncertainty
    own = {name: float(side) * getattr(u, name) for side, name in zip(point[: len(names)], names, strict=True)}
    rest = point[len(names) :].reshape(-1, 3) * (u.mass, u.frequency, u.damping)
    return Deviation(**own, further=tuple((m, f, d) for m, f, d in rest.tolist()))


def case(
    problem: Problem, fraction: float, off: Deviation = NOMINAL, rtol: float = RTOL, frequency: Tone = None
) -> Case:
    """Return the case of a deviation with a grain of a mass fraction [-]; frequency: as in `mapping_of`."""
    scene = scene_of(problem, fraction, problem.amplitudes[1], problem.max_height, off, frequency)
    return Case(DamperResponse(scene, rtol), off, contact_of(scene))


def cases(
    problem: Problem, fraction: float, points: Array, frequencies: Sequence[Tone] | None = None
) -> Iterator[Case]:
    """Yield the case of each point (n, quantities) of the box, at n frequencies or the first of the excitation [Hz]."""
    at = frequencies or [problem.frequencies[0]] * len(points)
    return (
        case(problem, fraction, deviation(problem, point), frequency=frequency)
        for point, frequency in zip(points, at, strict=True)
    )


def drawn_frequencies(problem: Problem, count: int, seed: int) -> list[Tone]:
    """Return so many frequencies drawn evenly from the range of the excitation [Hz]."""
    if problem.excitation_frequency is None:
        return [None] * count
    return [float(f) for f in np.random.default_rng(seed).uniform(*problem.excitation_frequency, count)]
