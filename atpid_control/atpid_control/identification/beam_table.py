# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The beam's steady amplitude against the support's, simulated for each height at its first use."""

import math

import numpy as np

from atpid_control.identification.sine_fit import fit_sine
from atpid_control.identification.window import seed_frequency
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.system import Array

#: Heights are tabulated this finely: the ceiling is not positioned better [m].
HEIGHT_STEP = 0.005
#: Periods simulated and, of these, looked at.
PERIODS, LOOKED_AT = 60, 16
#: Samples a period of a simulated trajectory.
SAMPLES = 40
POINTS = 40


class SimulatedRelation:
    """Simulates the standing ceiling at the nearest tabulated height, over the thesis's support amplitudes."""

    def __init__(self, scene: Scene) -> None:
        """Take the scene's beam, damper and frequency."""
        self._scene, self._amplitudes = scene, np.geomspace(0.002, 0.08, POINTS)
        self._tables: dict[int, tuple[Array, Array, Array]] = {}

    def at(self, height: float) -> tuple[Array, Array, Array]:
        """Return support amplitudes, the beam's and the beam's spread, each (n,) [m]; about 0.1 s a new height."""
        key = round(height / HEIGHT_STEP)
        if key not in self._tables:
            lowest = 2.0 * self._scene.grain.radius
            tabulated = max(key * HEIGHT_STEP, lowest)
            results = [self._response(tabulated, float(amplitude)) for amplitude in self._amplitudes]
            known = [(a, *result) for a, result in zip(self._amplitudes, results, strict=True) if result is not None]
            support, response, spread = np.array(known).T
            self._tables[key] = support, response, spread
        return self._tables[key]

    def _response(self, height: float, amplitude: float) -> tuple[float, float] | None:
        """Return the fundamental of the beam's steady motion and its spread [m]; None where it cannot be simulated."""
        from atpid_sim.simulation.simulate import trajectory  # here, since support signals need no simulation

        frequency = self._scene.frequency_hz
        duration = PERIODS / frequency
        scene = self._scene.with_(
            height=height, amplitude=amplitude, frequency=frequency, duration=duration, initial=None,
            steady_window=(duration - LOOKED_AT / frequency, duration),
        )  # fmt: skip
        rate = SAMPLES * frequency
        try:
            beam = trajectory(scene, rate, "soft").beam
        except NumericalFailure:
            return None
        found = [
            _fundamental(beam[-(k + 2) * SAMPLES : len(beam) - k * SAMPLES], rate) for k in range(0, LOOKED_AT - 1, 2)
        ]
        return float(np.mean(found)), float(np.std(found))


def _fundamental(signal: Array, rate: float) -> float:
    seed = seed_frequency(signal, rate, 0.02 * rate / SAMPLES * SAMPLES / 2.0, 0.1 * rate)
    tau = (np.arange(signal.size) - (signal.size - 1)) / rate
    fit = fit_sine(tau, signal, 2.0 * math.pi * seed, 0.0, math.inf)
    return float(0.5 * (signal.max() - signal.min())) if fit is None else fit.amplitude
