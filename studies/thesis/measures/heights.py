# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Amplitude over the height of the ceiling, and the best height."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from atpid_sim.maps import DamperResponse
from atpid_sim.maps.ratings import FLAT
from atpid_sim.simulation.simulate import simulate
from studies.thesis.measured import Measured
from studies.thesis.points import Job
from studies.thorough_search import thorough_best

#: Tolerance of the runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-5


def landscape(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the best of a grid of heights (Eqs 3.71 to 3.73); of equally good ones the lowest."""
    low, high, count = options["heights"]
    heights = np.linspace(float(low), float(high), int(count))
    opening = job.scene.to_mapping()["ceiling"]
    found, undamped = [], 0.0
    for height in heights:
        run = simulate(job.scene.with_(ceiling=opening | {"open": float(height)}), rtol=_RTOL, check=False)
        found.append(run.amplitude)
        undamped = run.undamped_amplitude
    amplitudes = np.array(found)
    best = int(np.flatnonzero(amplitudes <= (1.0 + FLAT) * amplitudes.min())[0])
    reductions = 100.0 * (1.0 - amplitudes / undamped)
    return Measured(
        {
            "best_height": float(heights[best]),
            "best_amplitude": float(amplitudes[best]),
            "best_reduction": float(reductions[best]),
            "at_limit": "yes" if best >= len(heights) - 2 else "no",
        },
        {"amplitude": np.array([heights, amplitudes]), "reduction": np.array([heights, reductions])},
    )


def best(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the best height over all approach paths (docs/selection.md)."""
    del options
    amplitude = float(job.point["amplitude"])
    damper = DamperResponse(job.scene, _RTOL)
    found = thorough_best(damper, amplitude)
    return Measured({
        "best_height": found.height,
        "best_amplitude": found.amplitude,
        "best_reduction": 100.0 * found.efficiency,
        "undamped": damper.closed_amplitude(amplitude),
    })  # fmt: skip
