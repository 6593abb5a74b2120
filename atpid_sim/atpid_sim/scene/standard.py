# SPDX-License-Identifier: Apache-2.0
"""The standard bench of thesis section 3.4, which studies and figures start from."""

from __future__ import annotations

from atpid_sim.scene.scene import Scene, scene_from_mapping

_STANDARD: dict[str, object] = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
    "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "excitation": {"amplitude": 0.01, "frequency": "resonance"},
    "ceiling": {"height": 0.2},
    "gravity": 9.81,
    "duration": 16.0,
    "tolerance": 1e-6,
}


def standard_bench(**changes: object) -> Scene:
    """Return the standard bench with the ceiling at 0.2 m, with some keys of the scene changed.

    Raises SceneError where a change does not fit.
    """
    return scene_from_mapping({**_STANDARD, **changes}, source="standard bench")
