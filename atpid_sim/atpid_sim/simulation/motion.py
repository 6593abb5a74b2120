# SPDX-License-Identifier: Apache-2.0
"""The kind of motion in the steady window of a run."""

from __future__ import annotations

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.scene import FreeExcitation, Scene
from atpid_sim.simulation.integration import Array, is_closed, negligible_displacement

#: Change from period to period, relative to the amplitude, above which the motion is irregular (rumble).
_IRREGULAR = 0.05
#: Share of a period in contact above which the grain sticks (thesis Eq. 4.5: t_c < gamma T / 2 with gamma = 0.1).
_STICKING = 0.1

_STROBES = 64


def classify(scene: Scene, state: State, samples: Array, amplitude: float) -> str:
    """Return closed, no_ceiling, irregular, optimal, sticking or mixed.

    Optimal: every period one impact on the floor and one on the ceiling, and no sticking (criteria 4.3 and 4.5). A free
    decay is never called irregular: its amplitude changes from period to period whatever the grain does.
    """
    if is_closed(scene):
        return "closed"
    window = scene.steady_window[1] - scene.steady_window[0]
    periods = window * scene.frequency_hz
    driven = not isinstance(scene.excitation, FreeExcitation)
    if driven and amplitude > negligible_displacement(scene) and _period_variation(samples, amplitude) > _IRREGULAR:
        return "irregular"
    floor, ceiling = state.n[columns.WINDOW_FLOOR], state.n[columns.WINDOW_CEILING]
    if ceiling == 0:
        return "no_ceiling" if floor > 0 else "sticking"
    touching = state.y[columns.CONTACT_TIME] / window
    if abs(floor - periods) <= 1.0 and abs(ceiling - periods) <= 1.0 and touching < _STICKING:
        return "optimal"
    return "sticking" if touching > 2.0 * _STICKING else "mixed"


def _period_variation(samples: Array, amplitude: float) -> float:
    """Return the root mean square change between successive periods (or pairs), relative to the amplitude."""
    beam = samples[columns.S_BEAM]
    if len(beam) < 4 * _STROBES:
        return 0.0
    changes = [np.sqrt(np.mean((beam[lag:] - beam[:-lag]) ** 2)) for lag in (_STROBES, 2 * _STROBES)]
    return float(min(changes) / amplitude)
