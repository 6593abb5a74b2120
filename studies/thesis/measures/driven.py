# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A driven beam in its steady window: amplitude, motion type, forces; specific damping on the way there."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from atpid_sim.kernel_inputs import contact_of
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import undamped_amplitude
from atpid_sim.simulation.quantities import efficiency, half_peak_to_peak, peaks
from atpid_sim.simulation.simulate import Trajectory
from atpid_sim.system import Array
from studies.theory.energy import contact_force, natural_frequency
from studies.theory.impacts import CEILING, FLOOR, Visit, motion_type, sticks, visits
from studies.thesis.measured import Measured, curve
from studies.thesis.measures.motion import FINE, beam_of, soft, structure_of
from studies.thesis.points import Job

#: Samples a period of the curves and amplitudes of `steady`.
_SAMPLES = 200


def constants(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return what a scene's numbers alone give: natural frequencies and contact constants."""
    del options
    scene = job.scene
    stiffness, damping = contact_of(scene).parameters[:2]
    return Measured({
        "natural": scene.natural_frequency_hz,
        "natural_bare": natural_frequency(scene.beam.mass, scene.beam.stiffness),
        "stiffness": float(stiffness),
        "contact_damping": float(damping),
    })  # fmt: skip


def steady(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the amplitude in the steady window, the reduction, and the motion type there."""
    del options
    scene = job.scene
    motion = soft(scene, _SAMPLES * scene.frequency_hz)
    begin, end = scene.steady_window
    rested = motion.beam + scene.static_deflection
    window = (motion.time >= begin) & (motion.time <= end)
    undamped = undamped_amplitude(scene)
    amplitude = half_peak_to_peak(rested[window])
    return Measured(
        {
            "amplitude": amplitude,
            "undamped": undamped,
            "reduction": 100.0 * efficiency(amplitude, undamped),
            "largest": float(np.abs(rested[window]).max()),
            "natural": scene.natural_frequency_hz,
            **_motion(scene, motion),
        },
        _curves(scene, motion),
    )


def _motion(scene: Scene, motion: Trajectory) -> dict[str, float | str]:
    """Return the motion type and the walls the grain sticks to; closed where it cannot move."""
    begin, end = scene.steady_window
    period = 1.0 / scene.frequency_hz
    if motion.ceiling[-1] <= 2.0 * scene.grain.radius * (1.0 + 1e-9):
        return {"motion": "closed", "sticks_to": "both"}
    found = [visit for visit in visits(motion.impacts, period) if begin <= visit.begin < end]
    return {"motion": motion_type(motion.impacts, begin, end, period), "sticks_to": _walls(found)}


def _walls(found: list[Visit]) -> str:
    stuck = sticks(found, FLOOR), sticks(found, CEILING)
    return {(True, True): "both", (True, False): "floor", (False, True): "ceiling"}.get(stuck, "none")


def _curves(scene: Scene, motion: Trajectory) -> dict[str, Any]:
    rested = motion.beam + scene.static_deflection
    last = motion.time >= motion.time[-1] - 4.0 / scene.frequency_hz
    time, floor = motion.time[last], rested[last]
    return {
        "beam": curve(motion.time, rested, 4000),
        "floor": curve(time, floor),
        "grain": curve(time, motion.grain[last] + scene.static_deflection),
        "ceiling": curve(time, floor + motion.ceiling[last] - 2.0 * scene.grain.radius),
    }


def forces(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return largest forces and overlaps in the steady window, and the walls the grain sticks to (Fig. 3.17)."""
    del options
    scene = job.scene
    motion = soft(scene, FINE)
    begin, end = scene.steady_window
    kept = (motion.time >= begin) & (motion.time <= end)
    force = contact_force(structure_of(scene), beam_of(motion))[kept]
    lower = (motion.beam - motion.grain)[kept]
    upper = (2.0 * scene.grain.radius + motion.grain - motion.beam - motion.ceiling)[kept]
    shown = motion.time[kept] < begin + 2.0 / scene.frequency_hz
    time = motion.time[kept][shown]
    return Measured(
        {
            "floor_force": float(force.max()),
            "ceiling_force": float(-force.min()),
            "floor_overlap": float(lower.max()),
            "ceiling_overlap": float(upper.max()),
            **_speeds(motion, begin, end),
            **_motion(scene, motion),
        },
        {
            "floor_force": curve(time, np.maximum(force[shown], 0.0), 20000),
            "ceiling_force": curve(time, np.maximum(-force[shown], 0.0), 20000),
            "floor_overlap": curve(time, np.maximum(lower[shown], 0.0), 20000),
            "ceiling_overlap": curve(time, np.maximum(upper[shown], 0.0), 20000),
        },
    )


def _speeds(motion: Trajectory, begin: float, end: float) -> dict[str, float]:
    """Return the largest closing speed on each wall [m/s]: the overlap's rate at first contact."""
    late = motion.impacts[(motion.impacts["time"] >= begin) & (motion.impacts["time"] < end)]
    walls = (("floor_speed", FLOOR), ("ceiling_speed", CEILING))
    return {name: float(late["speed"][late["wall"] == wall].max(initial=0.0)) for name, wall in walls}


def specific_damping(displacement: Array) -> Array:
    """Return the specific damping coefficient (k,) [-] between successive upper peaks (Eq. 3.62).

    displacement (n,) [m] is that from rest; the coefficient is negative where the motion grows.
    """
    found = peaks(displacement)
    return np.asarray(1.0 - (found[1:] / found[:-1]) ** 2)


def damping(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the specific damping coefficient while the ceiling opens and the beam settles (Fig. 3.16)."""
    scene = job.scene
    begin, end = (float(value) for value in options["window"])
    motion = soft(scene, _SAMPLES * scene.frequency_hz)
    kept = (motion.time >= begin) & (motion.time <= end)
    found = specific_damping((motion.beam + scene.static_deflection)[kept])
    times = begin + (np.arange(len(found)) + 0.5) / scene.frequency_hz
    return Measured(
        {
            "largest_damping": float(found.max()),
            "least_damping": float(found.min()),
            "damping_at": float(times[int(np.argmax(found))]) if len(found) else math.nan,
        },
        {"damping": np.array([times, found])},
    )
