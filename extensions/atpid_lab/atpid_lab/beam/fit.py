# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""k/m and c/m by output error: the model's motion, driven by the measured support, laid through the measured beam.

Start and rest position enter linearly and are solved for exactly, so only two numbers are searched.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

from atpid_common.errors import InputError
from atpid_control.analysis.signals import Signals
from atpid_control.identification.window import seed_frequency
from atpid_sim.scene.yaml12 import write_yaml
from atpid_sim.system import Array


def free_columns(count: int, step: float, stiffness: float, damping: float) -> Array:
    """Return the two free motions and a constant (3, n): from any initial state, about any rest position.

    `stiffness` and `damping` are k/m [1/s^2] and c/m [1/s], `step` in [s]. The beam must be underdamped.
    """
    t = np.arange(count) * step
    envelope, omega = np.exp(-0.5 * damping * t), damped_frequency(stiffness, damping)
    return np.stack([envelope * np.cos(omega * t), envelope * np.sin(omega * t), np.ones(count)])


def forced(support: Array, step: float, stiffness: float, damping: float) -> Array:
    """Return the beam's motion (n,) [m] from rest under the support's (n,) [m], straight between its samples.

    The difference equation is exact for such an input (first-order hold), so no step size enters.
    """
    numerator, denominator = _difference_equation(step, stiffness, damping)
    return np.asarray(lfilter(numerator, denominator, support - support[0]), dtype=np.float64)


def damped_frequency(stiffness: float, damping: float) -> float:
    """Return the angular frequency of the decay [rad/s]; NaN where the beam is not underdamped."""
    square = stiffness - 0.25 * damping * damping
    return math.sqrt(square) if square > 0.0 else math.nan


def _difference_equation(step: float, stiffness: float, damping: float) -> tuple[Array, Array]:
    """Return numerator and denominator of the first-order-hold equivalent of (k + c s) / (s^2 + c s + k) for m = 1.

    With H(s)/s^2 expanded in partial fractions 1/s^2 + free motion, its samples' z transform times (1 - z)^2/(z T).
    """
    omega, half = damped_frequency(stiffness, damping), 0.5 * damping
    decay = math.exp(-half * step)
    turn_cos, turn_sin = decay * math.cos(omega * step), decay * math.sin(omega * step)
    denominator = np.array([1.0, -2.0 * turn_cos, decay * decay])
    # ramp response of H: r(t) = t - exp(-d t) sin(w t) / w: both the ramp and the free part start at 0
    first, second = step - turn_sin / omega, 2.0 * step - 2.0 * turn_cos * turn_sin / omega
    third = 3.0 * step - (turn_cos * 2.0 * turn_cos * turn_sin + turn_sin * (turn_cos**2 - turn_sin**2)) / omega
    ramp = np.array([0.0, first, second, third])
    # the numerator is what makes the difference equation answer a unit ramp with these samples
    series = np.convolve(np.convolve(denominator, [1.0, -2.0, 1.0]), ramp)[1:4] / step
    return series, denominator


class BeamCalibrationError(InputError):
    """A recording that does not determine the beam's parameters, or impossible masses."""


TAU = 2.0 * math.pi
#: A residual above this share of the motion's own size means that the beam did not move as one mass; of the residual
#: only what lies below so many natural frequencies counts, since a sensor's noise is no motion.
_MISFIT, _MISFIT_BAND = 0.05, 3.0
#: A support that lowers the residual by less than this is taken for noise.
_EXPLAINS = 0.02
#: Damping ratios the search starts from and is held between.
START, LEAST, MOST = 0.02, 1e-6, 0.7
#: Periods a recording must last for its decay to be determined.
PERIODS = 5.0


@dataclass(frozen=True)
class BeamFit:
    """The beam's parameters by one recording, per unit of the moving mass."""

    stiffness: float  # k/m [1/s^2]
    damping: float  # c/m [1/s]
    covariance: Array  # of these two (2, 2)
    residual: float  # root mean square of measured minus modelled motion [m]
    misfit: float  # the part of it that is as slow as the beam itself [m]
    amplitude: float  # root mean square of the measured motion [m]
    driven: bool  # the support's motion was needed to explain the beam's
    samples: int
    origin: str = ""  # of the samples, such as `laser`

    @property
    def frequency(self) -> float:
        """Natural frequency sqrt(k/m)/2 pi [Hz]."""
        return math.sqrt(self.stiffness) / TAU

    @property
    def damping_ratio(self) -> float:
        """Damping ratio c/(2 sqrt(k m)) [-]."""
        return 0.5 * self.damping / math.sqrt(self.stiffness)


def fit_beam(signals: Signals) -> BeamFit:
    """Fit one recording: the beam's response to the support, whose samples are NaN throughout where not measured.

    A support that explains nothing (a decay recorded with its sensor's noise) is left out. Raises CalibrationError for
    a recording that is too short, has gaps in the support, or is no motion of one mass.
    """
    beam, rate = signals.response, signals.rate
    support = signals.excitation if np.isfinite(signals.excitation).any() else None
    valid = ~np.isnan(beam)
    lowest = PERIODS * rate / beam.size
    if valid.sum() < 50 or lowest > 0.1 * rate:
        given = f"given {int(valid.sum())} valid samples"
        raise BeamCalibrationError(f"recording: {given}; needed: {PERIODS:g} periods of the beam")
    if support is not None and np.isnan(support).any():
        remedy = "choose a part without any with --from and --to"
        raise BeamCalibrationError(f"support: given a recording with gaps; {remedy}")
    seed = seed_frequency(beam, rate, lowest, 0.2 * rate)
    if math.isnan(seed):
        raise BeamCalibrationError(f"recording: the beam does not move between {lowest:.3g} and {0.2 * rate:.3g} Hz")
    sources = (None, support) if support is not None else (None,)
    candidates = [_search(beam, valid, source, rate, seed) for source in sources]
    best = candidates[0] if candidates[-1].residual > (1.0 - _EXPLAINS) * candidates[0].residual else candidates[-1]
    if not best.misfit < _MISFIT * best.amplitude:
        raise BeamCalibrationError(
            f"recording: {best.misfit / best.amplitude:.0%} of the motion is none of one mass on a spring; close the "
            "damper, and choose the part after the release with --from and --to"
        )
    return replace(best, origin=signals.origin)


def _search(beam: Array, valid: NDArray[np.bool_], support: Array | None, rate: float, seed: float) -> BeamFit:
    step, omega = 1.0 / rate, TAU * seed

    def residual(logarithms: Array) -> Array:
        """Return measured minus best modelled motion at the valid samples (n,) [m], by log k/m and log c/m (2,)."""
        stiffness, damping = (float(value) for value in np.exp(logarithms))
        target = beam if support is None else beam - forced(support, step, stiffness, damping)
        columns = free_columns(target.size, step, stiffness, damping)[:, valid]
        coefficients, *_ = np.linalg.lstsq(columns.T, target[valid], rcond=None)
        return np.asarray(target[valid] - coefficients @ columns, dtype=np.float64)

    # logarithms: both are positive, and their relative errors are what matters
    bounds = ([math.log(0.25 * omega**2), math.log(LEAST * omega)], [math.log(4.0 * omega**2), math.log(MOST * omega)])
    starts = [np.log([omega**2, 2.0 * ratio * omega]) for ratio in (START, 0.2 * START, 5.0 * START)]
    start = min(starts, key=lambda at: float(np.sum(residual(at) ** 2)))
    found = least_squares(residual, start, bounds=bounds, x_scale=[1e-3, 1e-1], xtol=1e-12, ftol=1e-12)
    stiffness, damping = (float(value) for value in np.exp(found.x))
    left = residual(found.x)
    variance = float(left @ left) / max(left.size - 5, 1)
    # the Jacobian of the projected problem has the linear parameters already taken out
    natural, ratio = math.sqrt(stiffness) / TAU, 0.5 * damping / math.sqrt(stiffness)
    colour, misfit = _spectrum(left, rate, natural, ratio)
    scale = np.diag([stiffness, damping])
    covariance = scale @ np.linalg.pinv(found.jac.T @ found.jac) @ scale * variance * colour
    amplitude, driven = float(np.std(beam[valid])), support is not None
    return BeamFit(stiffness, damping, covariance, math.sqrt(variance), misfit, amplitude, driven, left.size)


def _spectrum(left: Array, rate: float, frequency: float, ratio: float) -> tuple[float, float]:
    """Return how coloured the residual is at resonance, one at least, and its slow part's root mean square [m].

    The support's own noise, and whatever the model leaves out, reach the beam through its resonance: there the
    residual's power exceeds that of white noise of the same variance, and the parameters' variance with it.
    """
    power = np.abs(np.fft.rfft(left - left.mean())) ** 2
    f = np.arange(power.size) * rate / left.size
    near = np.abs(f - frequency) < max(2.0 * ratio * frequency, 3.0 * rate / left.size)
    colour = float(power[near].mean() / power[1:].mean()) if near.any() else 1.0
    slow = power[(f > 0.0) & (f < _MISFIT_BAND * frequency)].sum()
    return max(1.0, colour), math.sqrt(2.0 * float(slow)) / left.size


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
        found = {name: float(f"{getattr(self, name):.7g}") for name in ("mass", "stiffness", "damping")}
        return (
            f"# standard deviations: mass {self.mass_std:.2g} kg, stiffness {self.stiffness_std:.2g} N/m, "
            f"damping {self.damping_std:.2g} N s/m\n{write_yaml({'beam': found})}"
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
    stiffness_std = math.hypot(stiffness * relative, moving_mass * math.sqrt(fit.covariance[0, 0]))
    damping_std = math.hypot(damping * relative, moving_mass * math.sqrt(fit.covariance[1, 1]))
    return BeamParameters(moving_mass - grain_mass, moving_mass_std, stiffness, stiffness_std, damping, damping_std)


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
    stiffness_std = math.sqrt(float(k_slope**2 @ variance))
    damping = moving * plain.damping
    damping_std = math.hypot(moving_std * plain.damping, moving * math.sqrt(plain.covariance[1, 1]))
    return BeamParameters(moving - grain_mass, moving_std, stiffness, stiffness_std, damping, damping_std)


def _check(moving: float, grain: float) -> None:
    if not (math.isfinite(moving) and moving > 0.0):
        raise BeamCalibrationError(f"moving mass: given {moving:g} kg; allowed: above 0")
    if not 0.0 <= grain < moving:
        allowed = f"at least 0 and below the moving {moving:g} kg"
        raise BeamCalibrationError(f"grain mass: given {grain:g} kg; allowed: {allowed}")
