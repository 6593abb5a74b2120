# SPDX-License-Identifier: Apache-2.0
"""What a design is made for: structure, amplitudes, contact, aim and uncertainties; and its scenes."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from pydantic import Field, ValidationError, model_validator

from atpid_common.errors import InputError
from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.fields import Block, Fraction, Hertz, Length, Mass, Modulus, Number, Words, impossible, within
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.scene.explain import explained

#: Poisson's ratio of grain and walls: the thesis's. The contact stiffness changes by 7 % from 0.2 to 0.3.
POISSON = 0.2
#: Radii are rounded up to this [m].
_RADIUS_STEP = 1e-4
#: Range of the restitution, with its uncertainty [-].
_LEAST_RESTITUTION, _MOST_RESTITUTION = 0.01, 0.99
#: Tolerance of the scene: relative error of the amplitude [-].
_TOLERANCE = 1e-6

Share = Annotated[Number, within(0.0, 0.5, hint="a share: 10 % is 0.1")]


class DesignError(InputError):
    """A design that cannot be made: what was given, what is allowed, what to do."""


class Uncertainty(Block):
    """How far each quantity may lie from its value, to either side; relative but for the height."""

    mass: Share = Field(default=0.02, description="mass of the beam [-]")
    frequency: Share = Field(default=0.02, description="natural frequency; the excitation stays at resonance [-]")
    damping: Share = Field(default=0.1, description="damping ratio of the beam [-]")
    restitution: Share = Field(default=0.2, description="restitution [-]")
    young_modulus: Share = Field(default=0.2, description="Young's modulus of grain and walls [-]")
    detuning: Annotated[Number, within(0.0, 0.03)] = Field(
        default=0.005, description="distance of the excitation from resonance [-]"
    )
    amplitude: Share = Field(default=0.01, description="identified support amplitude [-]")
    height: Annotated[Number, within(0.0, 0.1)] = Field(default=5e-4, description="position of the ceiling [m]")


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


NOMINAL = Deviation()


class Problem(Block):
    """A structure with its excitation, and what is asked of the damper."""

    mass: Mass = Field(description="reduced mass of beam and container, without the grain [kg]")
    frequency: Hertz = Field(description="natural frequency of the beam without the grain [Hz]")
    damping: Annotated[Number, within(5e-4, 0.2)] = Field(description="damping ratio of the beam alone [-]")
    amplitudes: tuple[Length, Length] = Field(description="least and largest support amplitude [m]")
    restitution: Annotated[Number, within(_LEAST_RESTITUTION, 0.95)] = Field(
        default=0.15, description="rebound speed over approach speed, grain and walls [-]"
    )
    young_modulus: Modulus = Field(default=2.1e8, description="Young's modulus of grain and walls [Pa]")
    density: Annotated[Number, within(10.0, 25_000.0)] = Field(default=7850.0, description="of the grain [kg/m^3]")
    gravity: Annotated[Number, within(0.0, 100.0)] = Field(
        default=9.81, description="along the motion; 0 where it is horizontal [m/s^2]"
    )
    max_mass_fraction: Annotated[Fraction, within(0.01, 0.6)] = Field(
        default=0.3, description="largest grain mass over the mass of beam and grain [-]"
    )
    max_height: Length = Field(default=3.0, description="largest height of the ceiling [m]")
    target_reduction: Annotated[Number, within(0.01, 0.99, hint="a share: 80 % is 0.8")] | None = Field(
        default=None, description="efficiency to be kept at every amplitude [-]; default: what the best grain keeps"
    )
    lever: Length = Field(default=0.01, description="lever arm of the motor's drive [m]")
    uncertainty: Uncertainty = Uncertainty()

    @model_validator(mode="after")
    def _rising(self) -> Problem:
        if not self.amplitudes[0] < self.amplitudes[1]:
            given = Words("{:g}:{:g}".format(*self.amplitudes))
            raise impossible("amplitudes", given, "LO:HI, two rising amplitudes in metres, such as 0.001:0.004")
        return self


def problem_of(**given: Any) -> Problem:
    """Return the problem of the options given. Raises DesignError in one line, which names the option."""
    try:
        return Problem(**given)
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


def contact_damping_ratio(restitution: float, fraction: float) -> float:
    """Return beta of Tsuji's law (Eq. 3.23) for a restitution between grain and container.

    The law's own damping ratio is c / sqrt(5 k m) with the reduced mass m = m_g (1 - fraction) and c = 2 beta
    sqrt(k m_g); the restitution follows from it alone (`atpid_sim.contact.tsuji.restitution`).
    """
    return float(0.5 * damping_ratio_for(restitution) * math.sqrt(5.0 * (1.0 - fraction)))


def mapping_of(problem: Problem, fraction: float, amplitude: Any, off: Deviation = NOMINAL) -> dict[str, Any]:
    """Return the blocks of a scene that describe the system with a grain of a mass fraction [-], off by a deviation.

    amplitude: of the support [m], or points of it. The grain's mass is known: another mass of the beam is another mass
    fraction.
    """
    mass, weight = problem.mass * (1.0 + off.mass), grain_mass(problem, fraction)
    share = fraction if off.mass == 0.0 else weight / (mass + weight)
    frequency = problem.frequency * (1.0 + off.frequency)
    restitution = problem.restitution * (1.0 + off.restitution)
    restitution = min(max(restitution, _LEAST_RESTITUTION), _MOST_RESTITUTION)
    detuned = frequency * math.sqrt(1.0 - share) * (1.0 + off.detuning)
    return {
        "beam": {"mass": mass, "frequency": frequency, "damping_ratio": problem.damping * (1.0 + off.damping)},
        "grain": {"mass_fraction": share, "radius": grain_radius(problem, fraction)},
        "contact": {
            "law": "tsuji",
            "young_modulus": problem.young_modulus * (1.0 + off.young_modulus),
            "poisson_ratio": POISSON,
            "damping_ratio": contact_damping_ratio(restitution, share),
        },
        "excitation": {"amplitude": amplitude, "frequency": "resonance" if off.detuning == 0.0 else detuned},
        "gravity": problem.gravity,
        "tolerance": _TOLERANCE,
    }


def scene_of(problem: Problem, fraction: float, amplitude: float, height: float, off: Deviation = NOMINAL) -> Scene:
    """Return the scene of a structure off by a deviation, support amplitude and ceiling [m] off as well.

    It lasts until the closed damper's transient is over. Raises SceneError where a value cannot be.
    """
    mapping = mapping_of(problem, fraction, amplitude * (1.0 + off.amplitude), off)
    diameter = 2.0 * grain_radius(problem, fraction)
    duration = 8.0 * time_constant(problem, fraction) + 40.0 / problem.frequency
    run = {"ceiling": {"height": max(height + off.height, diameter)}, "duration": duration}
    return scene_from_mapping(mapping | run, source="design")


def resonance(problem: Problem, fraction: float) -> float:
    """Return the natural frequency of beam and grain as one mass [Hz]."""
    return problem.frequency * math.sqrt(1.0 - fraction)


def time_constant(problem: Problem, fraction: float) -> float:
    """Return the time constant [s] of the closed damper's free decay, 2 M / c."""
    return 1.0 / (2.0 * math.pi * problem.frequency * problem.damping * (1.0 - fraction))
