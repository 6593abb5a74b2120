# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation from the beam's response alone, where the support is not measured.

Closed damper: beam and grain are one mass, and the transfer function of the simplified model is divided out
(thesis equation 3.43). Open damper: through a table of simulated steady amplitudes at the present height. Either way
the error bar grows by what is not known of the model. The closed beam need not have settled: what its amplitude still
gains is counted.
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from atpid_common.vocabulary import Quality
from atpid_control.identification.estimate import Estimate, IdentificationError
from atpid_control.identification.sine_fit import fit_sine
from atpid_control.identification.window import seed_frequency
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.system import Array

#: Up to this gap, as a share of the beam's amplitude, the damper counts as closed.
_CLOSED_GAP = 0.02
#: Relative standard deviations of stiffness and damping: a calibrated beam's, with a margin [-].
_MODEL_ERROR = (0.005, 0.05)
#: Estimates agree within this many standard deviations.
_AGREE = 3.0
#: A beam this regular is on no branch of the table that scatters more [-].
_REGULAR = 0.02


#: From the height of the open damper [m] to support amplitudes, the beam's steady ones and their spread, each (n,) [m].
_AmplitudeRelation = Callable[[float], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class ClosedBeam:
    """Beam and grain as one mass on spring and damper, driven through both by the support."""

    mass: float  # beam and grain [kg]
    stiffness: float  # [N/m]
    damping: float  # [N s/m]

    def inverse(self, omega: float, growth: float = 0.0) -> complex:
        """Return support over beam displacement at `omega` [rad/s] (equation 3.43).

        A beam whose amplitude still grows, by `growth` [1/s] of its amplitude, needs the support also for that.
        """
        force = self.stiffness + 1j * self.damping * omega
        return (force - self.mass * omega**2 + growth * (2j * self.mass * omega + self.damping)) / force


class ModelInverse:
    """From the beam's motion to the support's, by the model at the present height."""

    def __init__(self, beam: ClosedBeam, closed_height: float, relation: _AmplitudeRelation) -> None:
        """Take the closed beam, the height at which the damper is closed [m], and the relation where it is open."""
        self._beam, self._closed, self._relation = beam, closed_height, relation
        self._past: deque[tuple[float, float, float]] = deque()  # time, amplitude, its std by chance

    @classmethod
    def of_scene(cls, scene: Scene) -> ModelInverse:
        """Return the inverse for a scene's beam and damper; the open damper's table is simulated when first needed.

        Raises IdentificationError for a structure of several modes, or driven by a force.
        """
        if scene.modes is not None:
            raise IdentificationError("origin: given beam; allowed for several modes, or with drive force: support")

        beam = ClosedBeam(scene.total_mass, scene.beam.stiffness, scene.beam.damping)
        return cls(beam, 2.0 * scene.grain.radius, _SimulatedRelation(scene).at)

    def support_of(self, beam: Estimate, height: float) -> Estimate:
        """Return the support's estimate for the beam's estimate `beam` and the ceiling at `height` [m].

        Without a height there is no estimate. Where two support amplitudes would move the beam alike, the estimate is
        their middle, with an error bar over both, and poor.
        """
        if beam.quality == Quality.NONE or not math.isfinite(height):
            return Estimate(time=beam.time, last_index=beam.last_index, origin=beam.origin)
        if height - self._closed <= _CLOSED_GAP * beam.amplitude:
            return self._through_one_mass(beam)
        return self._through_relation(beam, height)

    def _through_one_mass(self, beam: Estimate) -> Estimate:
        omega, growth = 2.0 * math.pi * beam.frequency, beam.growth
        inverse = self._beam.inverse(omega, growth)
        chance, model = self._errors(beam, abs(inverse))
        amplitude = beam.amplitude * abs(inverse)
        phase = math.remainder(beam.phase + cmath.phase(inverse), 2.0 * math.pi)
        moved = replace(beam, phase=phase, phase_std=math.hypot(beam.phase_std, chance, model))
        support = replace(moved, amplitude=amplitude, amplitude_std=amplitude * math.hypot(chance, model))
        return replace(support, quality=self._steadiness(support, amplitude * chance))

    def _errors(self, beam: Estimate, gain: float) -> tuple[float, float]:
        """Return relative standard deviations of the support's amplitude: by chance, and by the model [-].

        Differences over one standard deviation of each cause, not derivatives: at resonance those may vanish.
        """
        omega, growth = 2.0 * math.pi * beam.frequency, beam.growth
        omega_std = 2.0 * math.pi * beam.frequency_std

        def off(*cases: tuple[ClosedBeam, float, float]) -> float:
            return max(abs(abs(model.inverse(at, rate)) / gain - 1.0) for model, at, rate in cases)

        closed, (stiffness, damping) = self._beam, _MODEL_ERROR
        chance = math.hypot(
            beam.amplitude_std / beam.amplitude,
            off((closed, omega + omega_std, growth), (closed, omega - omega_std, growth)),
            off((closed, omega, growth + beam.growth_std), (closed, omega, growth - beam.growth_std)),
        )
        softer, stiffer = (replace(closed, stiffness=closed.stiffness * (1.0 + s * stiffness)) for s in (-1, 1))
        freer, damped = (replace(closed, damping=closed.damping * (1.0 + s * damping)) for s in (-1, 1))
        by_stiffness = off((softer, omega, growth), (stiffer, omega, growth))
        return chance, math.hypot(by_stiffness, off((freer, omega, growth), (damped, omega, growth)))

    def _steadiness(self, support: Estimate, chance: float) -> Quality:
        """Steady, if the support's estimates agree over a whole window, even while the beam is transient."""
        while self._past and self._past[0][0] < support.time - support.window:
            self._past.popleft()
        whole = bool(self._past) and self._past[0][0] <= support.time - 0.8 * support.window
        off = ((abs(amplitude - support.amplitude), math.hypot(chance, std)) for _, amplitude, std in self._past)
        same = all(difference <= _AGREE * std for difference, std in off)
        self._past.append((support.time, support.amplitude, chance))
        if support.quality == Quality.POOR:
            return Quality.POOR
        return Quality.STEADY if whole and same else Quality.TRANSIENT

    def _through_relation(self, beam: Estimate, height: float) -> Estimate:
        support, response, spread = self._relation(height)
        # a beam with a regular response is not on a rumbling branch
        smooth = regular_branch(response, spread) if beam.quality == Quality.STEADY else response
        ends = crossings(support, smooth, spread, beam.amplitude, beam.amplitude_std)
        ends = ends or crossings(support, response, spread, beam.amplitude, beam.amplitude_std)
        unknown = replace(beam, phase=math.nan, phase_std=math.nan)
        if not ends:
            return replace(unknown, quality=Quality.POOR, amplitude=math.nan, amplitude_std=math.nan)
        low, high = min(a for a, _ in ends), max(b for _, b in ends)
        quality = beam.quality if len(ends) == 1 else Quality.POOR
        amplitude = 0.5 * (low + high)
        # the damping's error acts less where the grain takes most of the energy, the stiffness's as in the closed beam
        model = amplitude * math.hypot(*_MODEL_ERROR)
        std = math.hypot(0.5 * (high - low), model)
        return replace(unknown, quality=quality, amplitude=amplitude, amplitude_std=std)


def regular_branch(response: Array, spread: Array) -> Array:
    """Return the responses (n,) [m] with NaN where they scatter; a regular stretch is carried on for one point."""
    regular = spread <= _REGULAR * response
    found = np.where(regular, response, np.nan)
    for here in np.flatnonzero(~regular):
        for step in (1, -1):
            near, far = here + step, here + 2 * step
            if 0 <= far < response.size and regular[near] and regular[far]:
                found[here] = 2.0 * response[near] - response[far]
    return found


def crossings(
    support: Array, response: Array, spread: Array, amplitude: float, std: float
) -> list[tuple[float, float]]:
    """Return the intervals of support amplitude [m] in which the beam's response [m] may be `amplitude` +- `std` [m].

    `support`, `response` and `spread` (n,) [m] make a straight-line table. Intervals that touch are one.
    """
    fine = np.linspace(support[0], support[-1], 20 * support.size)
    middle = np.interp(fine, support, response)
    width = np.hypot(np.interp(fine, support, spread), std) + np.abs(np.gradient(middle))
    with np.errstate(invalid="ignore"):
        inside = np.flatnonzero(np.abs(middle - amplitude) <= width)
    if inside.size == 0:
        return []
    parts = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    return [(float(fine[part[0]]), float(fine[part[-1]])) for part in parts]


#: Heights are tabulated this finely: the ceiling is not positioned better [m].
_HEIGHT_STEP = 0.005
#: Periods simulated and, of these, looked at.
_PERIODS, _LOOKED_AT = 60, 16
#: Samples a period of a simulated trajectory.
_SAMPLES = 40
_POINTS = 40


class _SimulatedRelation:
    """Simulates the standing ceiling at the nearest tabulated height, over the thesis's support amplitudes."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._amplitudes = scene, np.geomspace(0.002, 0.08, _POINTS)
        self._tables: dict[int, tuple[Array, Array, Array]] = {}

    def at(self, height: float) -> tuple[Array, Array, Array]:
        """Return support amplitudes, the beam's and the beam's spread, each (n,) [m]; about 0.1 s a new height."""
        key = round(height / _HEIGHT_STEP)
        if key not in self._tables:
            lowest = 2.0 * self._scene.grain.radius
            tabulated = max(key * _HEIGHT_STEP, lowest)
            results = [self._response(tabulated, float(amplitude)) for amplitude in self._amplitudes]
            known = [(a, *result) for a, result in zip(self._amplitudes, results, strict=True) if result is not None]
            support, response, spread = np.array(known).T
            self._tables[key] = support, response, spread
        return self._tables[key]

    def _response(self, height: float, amplitude: float) -> tuple[float, float] | None:
        """Return the fundamental of the beam's steady motion and its spread [m]; None where it cannot be simulated."""
        from atpid_sim.simulation.simulate import trajectory  # here, since support signals need no simulation

        frequency = self._scene.frequency_hz
        duration = _PERIODS / frequency
        excited = self._scene.with_(height=height, amplitude=amplitude, frequency=frequency, initial=None)
        scene = excited.with_(duration=duration, steady_window=(duration - _LOOKED_AT / frequency, duration))
        rate = _SAMPLES * frequency
        try:
            beam = trajectory(scene, rate, "soft").beam
        except NumericalFailure:
            return None
        found = [
            _fundamental(beam[-(k + 2) * _SAMPLES : len(beam) - k * _SAMPLES], rate)
            for k in range(0, _LOOKED_AT - 1, 2)
        ]
        return float(np.mean(found)), float(np.std(found))


def _fundamental(signal: Array, rate: float) -> float:
    seed = seed_frequency(signal, rate, 0.02 * rate / _SAMPLES * _SAMPLES / 2.0, 0.1 * rate)
    tau = (np.arange(signal.size) - (signal.size - 1)) / rate
    fit = fit_sine(tau, signal, 2.0 * math.pi * seed, 0.0, math.inf)
    return float(0.5 * (signal.max() - signal.min())) if fit is None else fit.amplitude
