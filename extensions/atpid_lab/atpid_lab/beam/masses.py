# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From k/m and c/m to the scene's beam block, with the one mass that has to be given."""

import math
from dataclasses import dataclass

import numpy as np

from atpid_lab.beam.fit import BeamCalibrationError, BeamFit


@dataclass(frozen=True)
class BeamParameters:
    """The beam without the grain, each value with its standard deviation."""

    mass: float  # [kg]
    mass_std: float
    stiffness: float  # [N/m]
    stiffness_std: float
    damping: float  # [N s/m]
    damping_std: float

    def to_yaml(self) -> str:
        """Return a scene's `beam:` block; error bars are in a comment, since a scene has values only."""
        return (
            f"# standard deviations: mass {self.mass_std:.2g} kg, stiffness {self.stiffness_std:.2g} N/m, "
            f"damping {self.damping_std:.2g} N s/m\n"
            f"beam: {{mass: {_number(self.mass)}, stiffness: {_number(self.stiffness)}, "
            f"damping: {_number(self.damping)}}}\n"
        )


def from_known_mass(
    fit: BeamFit, moving_mass: float, moving_mass_std: float = 0.0, grain_mass: float = 0.0
) -> BeamParameters:
    """Return the parameters where the moving mass is `moving_mass` [kg], `grain_mass` [kg] of it the grain's.

    Raises CalibrationError for impossible masses.
    """
    _check(moving_mass, grain_mass)
    relative = moving_mass_std / moving_mass
    stiffness, damping = fit.stiffness * moving_mass, fit.damping * moving_mass
    return BeamParameters(
        mass=moving_mass - grain_mass,
        mass_std=moving_mass_std,
        stiffness=stiffness,
        stiffness_std=math.hypot(stiffness * relative, moving_mass * math.sqrt(fit.covariance[0, 0])),
        damping=damping,
        damping_std=math.hypot(damping * relative, moving_mass * math.sqrt(fit.covariance[1, 1])),
    )


def from_added_mass(plain: BeamFit, loaded: BeamFit, added: float, grain_mass: float = 0.0) -> BeamParameters:
    """Return the parameters from two recordings, the second with `added` [kg] more on the beam.

    m = added b/(a - b) with a and b the two k/m: the mass is as good as the difference of two nearly equal numbers, so
    add a tenth of the mass or more. Raises CalibrationError where the added mass did not clearly lower k/m.
    """
    if not added > 0.0:
        raise BeamCalibrationError(f"added mass: given {added:g} kg; allowed: above 0")
    a, b = plain.stiffness, loaded.stiffness
    variance = np.array([plain.covariance[0, 0], loaded.covariance[0, 0]])
    if not a - b > 4.0 * math.sqrt(float(variance.sum())):
        raise BeamCalibrationError(
            f"added mass: k/m is {a:.6g} without and {b:.6g} 1/s^2 with it; the second recording must be slower "
            "beyond its error; add more mass"
        )
    moving = added * b / (a - b)
    slope = np.array([-moving / (a - b), added * a / (a - b) ** 2])
    moving_std = math.sqrt(float(slope**2 @ variance))
    _check(moving, grain_mass)
    stiffness = moving * a
    # k = added a b/(a - b): its error follows from both, not from the mass's alone
    k_slope = added / (a - b) ** 2 * np.array([-b * b, a * a])
    return BeamParameters(
        mass=moving - grain_mass, mass_std=moving_std,
        stiffness=stiffness, stiffness_std=math.sqrt(float(k_slope**2 @ variance)),
        damping=moving * plain.damping,
        damping_std=math.hypot(moving_std * plain.damping, moving * math.sqrt(plain.covariance[1, 1])),
    )  # fmt: skip


def _check(moving: float, grain: float) -> None:
    if not (math.isfinite(moving) and moving > 0.0):
        raise BeamCalibrationError(f"moving mass: given {moving:g} kg; allowed: above 0")
    if not 0.0 <= grain < moving:
        raise BeamCalibrationError(
            f"grain mass: given {grain:g} kg; allowed: at least 0 and below the moving {moving:g} kg"
        )


def _number(value: float) -> str:
    """Write a number with seven digits so that every YAML reader takes it for one."""
    text = f"{value:.7g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa}{'' if '.' in mantissa else '.0'}e{int(exponent):+d}"
    return text if "." in text else text + ".0"
