# SPDX-License-Identifier: Apache-2.0
"""What every computing selector asks of its input, and the simulation it gets for a frequency."""

from __future__ import annotations

import math

from atpid_control.selection.protocol import SelectionError
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import HarmonicExcitation, Scene, SceneError

#: A measured frequency this close to the scene's is the scene's: resonance is 2 % wide [relative].
_SAME = 1e-3


def check_excitation(amplitude: float, amplitude_std: float, frequency: float, margin: float) -> None:
    """Raise SelectionError, in one line, for numbers no height can be given for."""
    if not (math.isfinite(amplitude) and amplitude > 0.0):
        raise SelectionError(f"amplitude: given {amplitude:g} m; allowed is a number above 0; the ceiling stays")
    if not (math.isfinite(amplitude_std) and amplitude_std >= 0.0):
        raise SelectionError(f"amplitude_std: given {amplitude_std:g} m; allowed is a number from 0; the ceiling stays")
    if not (math.isnan(frequency) or 0.0 < frequency < math.inf):
        raise SelectionError(f"frequency: given {frequency:g} Hz; allowed is a number above 0, or NaN for the scene's")
    if not (math.isfinite(margin) and margin >= 0.0):
        raise SelectionError(f"margin: given {margin:g}; allowed is a number of standard deviations from 0")


def response_at(damper: DamperResponse, scene: Scene, frequency: float, rtol: float) -> DamperResponse:
    """Return the damper's response, or that of the same system at another frequency [Hz]; NaN: the scene's own."""
    if math.isnan(frequency) or abs(frequency / damper.frequency - 1.0) < _SAME:
        return damper
    if not isinstance(scene.excitation, HarmonicExcitation):
        raise SelectionError("frequency: heights are selected for a tone; the scene's excitation has no amplitude")
    try:
        return DamperResponse(scene.with_(frequency=frequency), rtol)
    except SceneError as error:
        raise SelectionError(str(error)) from None
