# SPDX-License-Identifier: Apache-2.0
"""One point of a map: the best height, or the reason why there is none."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from atpid_sim.maps.best import best_height
from atpid_sim.maps.response import DamperResponse
from atpid_sim.outcome import NumericalFailure


def values_at(damper: DamperResponse, amplitude: float, hysteresis: float) -> dict[str, Any]:
    """Return the fields of `Best` at a support amplitude [m]; None, with `failure`, where a run fails.

    One amplitude that cannot be simulated, as where the grain is pressed deeper into a wall than its radius, must not
    cost the others.
    """
    try:
        return asdict(best_height(damper, amplitude, hysteresis))
    except NumericalFailure as error:
        return {
            "height": None, "amplitude": None, "efficiency": None, "reproducible": False, "evaluations": 0,
            "failure": str(error),
        }  # fmt: skip
