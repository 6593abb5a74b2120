# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learned selection: the height a regression over simulated systems gives, for a beam no map was made for."""

import math
import time
from pathlib import Path

from atpid_common.folders import share_folder
from atpid_control.selection.height_model import INPUTS, LEAST_RATIO, SHARE, HeightModel, inputs_of
from atpid_control.selection.protocol import Excitation, Selection, SelectionError
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import Scene
from atpid_sim.system import Array

#: The shipped model, in the share folder.
SHIPPED = "config/learned/heights.npz"
#: Systems are trained at resonance; how far from it a height still holds (`frequency_tolerance` of selector.yaml) [-].
_ON_RESONANCE = 0.03
#: What is refused is a value beyond the model's range by more than this share.
_SLACK = 1e-9
#: What a user may do instead.
_INSTEAD = "select with direct, or train a model with `atpid learn`"
#: What it holds for where the structure has several modes or a force drives it.
_ONE_MODE = "learned from structures of one mode, shaken at the support: height and amplitude are estimates; use direct"


class LearnedSelector:
    """Evaluates a regression; for a margin it takes the height for the lower end of the amplitude's error bar."""

    method, simulates = "learned", False

    def __init__(self, scene: Scene, model: HeightModel) -> None:
        """Raise SelectionError where the model does not reach the scene's beam, grain or contact."""
        self._scene, self._model = scene, model
        self._damper = DamperResponse(scene)
        self._check_frequency(scene.frequency_hz)
        self._check_system(inputs_of(scene, self._damper, 1.0))
        model.predict(model.inputs[:1])  # solved now, so that the first selection is as fast as the next

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the height of the regression; see `HeightSelector.select`."""
        del height  # the height holds for a ceiling opened from closed, at once or slowly
        amplitude, spread = excitation.amplitude, excitation.spread(margin)
        begun = time.perf_counter()
        if not math.isnan(excitation.frequency):
            self._check_frequency(excitation.frequency)
        self._check_amplitude(amplitude)
        # the best height grows with the amplitude: that of the error bar's lower end is safe for all of it
        lower = max(amplitude - spread, self._amplitudes(amplitude)[0])
        clearance, remaining = self._model.predict(inputs_of(self._scene, self._damper, lower)[None])[0]
        chosen = self._damper.diameter + SHARE * float(clearance) * self._damper.ballistic_clearance(lower)
        price = math.nan if margin > 0.0 else 0.0
        response = float(remaining) * self._damper.closed_amplitude(lower)
        wall = time.perf_counter() - begun
        note = "" if self._scene.modes is None else _ONE_MODE
        return Selection(chosen, response, 1.0 - float(remaining), self.method, wall_s=wall, price=price, note=note)

    def _amplitudes(self, amplitude: float) -> tuple[float, float]:
        """Return smallest and largest support amplitude [m] the model reaches for this system."""
        own = float(inputs_of(self._scene, self._damper, amplitude)[0])
        low, high = self._model.range_of(INPUTS[0])
        return low * amplitude / own, high * amplitude / own

    def _check_amplitude(self, amplitude: float) -> None:
        low, high = self._amplitudes(amplitude)
        if not low * (1.0 - _SLACK) <= amplitude <= high * (1.0 + _SLACK):
            unit = self._scene.driven_by.unit
            covered = f"{low:.4g} to {high:.4g} {unit} for this beam and grain"
            raise SelectionError(
                f"amplitude: given {amplitude:g} {unit}; the learned model covers {covered}; {_INSTEAD}"
            )

    def _check_frequency(self, frequency: float) -> None:
        resonance = self._scene.natural_frequency_hz
        if abs(frequency / resonance - 1.0) > _ON_RESONANCE:
            allowed = f"{resonance:.4g} Hz within {100.0 * _ON_RESONANCE:g} %, where the model was trained"
            raise SelectionError(f"frequency: given {frequency:g} Hz; allowed: {allowed}; {_INSTEAD}")

    def _check_system(self, inputs: Array) -> None:
        for name, value in list(zip(INPUTS, map(float, inputs), strict=True))[1:]:
            low, high = self._model.range_of(name)
            if not low * (1.0 - _SLACK) <= value <= high * (1.0 + _SLACK):
                words = f"{name.replace('_', ' ')}: the scene's is {value:.4g}"
                raise SelectionError(f"{words}; the learned model covers {low:.4g} to {high:.4g}; {_INSTEAD}")
        if inputs[1] < LEAST_RATIO * inputs[2]:
            least = f"{LEAST_RATIO:g} times the beam's damping ratio, {LEAST_RATIO * inputs[2]:.4g}"
            raise SelectionError(f"mass fraction: the scene's is {inputs[1]:.4g}; learned from {least}; {_INSTEAD}")
        if math.isinf(inputs[0]):
            raise SelectionError(f"gravity: the scene's is 0; the learned model was trained with it; {_INSTEAD}")


def learned(scene: Scene, model: Path | None) -> LearnedSelector:
    """Return the selector for a scene, of the model in a file, by default the shipped one.

    Raises ModelError for a file that is no model, SelectionError for a system beyond its range.
    """
    return LearnedSelector(scene, HeightModel.load(model or share_folder("atpid_control") / SHIPPED))
