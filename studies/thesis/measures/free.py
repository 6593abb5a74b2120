# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Free decays: decrements, spectrum, work of the first impact, energy."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from atpid_sim.simulation.quantities import amplitude_spectrum, decrements
from atpid_sim.system import Array
from studies.theory.energy import contact_force, total_energy, work_on_grain
from studies.theory.impacts import CEILING, FLOOR, visits
from studies.thesis.measured import Measured, curve
from studies.thesis.measures.motion import FINE, beam_of, soft, structure_of
from studies.thesis.points import Job

#: Samples a period: each peak is then within 1e-5 of the true one.
_SAMPLES = 800.0


def decay(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the ratios of successive upper peaks (Eq. 2.1)."""
    del options
    scene = job.scene
    motion = soft(scene, _SAMPLES * scene.natural_frequency_hz)
    rested = motion.beam + scene.static_deflection
    ratios = decrements(rested)
    numbers = np.arange(1, len(ratios) + 1, dtype=float)
    return Measured(
        {"decrement": float(ratios.max()), "at_period": float(numbers[int(np.argmax(ratios))])},
        {"beam": curve(motion.time, rested), "decrements": np.array([numbers, ratios])},
    )


def dominant_frequency(frequencies: Array, amplitudes: Array) -> float:
    """Return the frequency [Hz] of the highest peak of a spectrum (m,), a parabola's vertex."""
    top = 1 + int(np.argmax(amplitudes[1:-1]))
    left, middle, right = amplitudes[top - 1 : top + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(frequencies[top] + shift * frequencies[1])


def spectrum(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the frequency of a decay, and for how many cycles the grain strikes both walls in turn at first."""
    scene = job.scene
    rate = _SAMPLES * scene.natural_frequency_hz
    motion = soft(scene, rate)
    rested = motion.beam + scene.static_deflection
    frequencies, amplitudes = amplitude_spectrum(rested, rate)
    shown = frequencies < float(options["highest"])
    early = motion.time < float(options["shown"])
    diameter = 2.0 * scene.grain.radius
    return Measured(
        {
            "frequency": dominant_frequency(frequencies, amplitudes),
            "natural": scene.natural_frequency_hz,
            "periodic": float(_regular_cycles(motion.impacts, 1.0 / scene.natural_frequency_hz)),
        },
        {
            "beam": curve(motion.time, rested),
            "spectrum": curve(frequencies[shown], amplitudes[shown], 4000),
            "floor": curve(motion.time[early], rested[early]),
            "grain": curve(motion.time[early], motion.grain[early] + scene.static_deflection),
            "ceiling": curve(motion.time[early], rested[early] + motion.ceiling[early] - diameter),
        },
    )


def _regular_cycles(impacts: Any, period: float) -> int:
    """Return how many cycles floor, ceiling, floor there are at first, each a period long to a quarter of it."""
    found = visits(impacts, period)
    first = next((place for place, visit in enumerate(found) if visit.wall == FLOOR), len(found))
    count = 0
    for floor, ceiling, again in zip(found[first::2], found[first + 1 :: 2], found[first + 2 :: 2], strict=False):
        alternate = (floor.wall, ceiling.wall, again.wall) == (FLOOR, CEILING, FLOOR)
        if not alternate or abs(again.begin - floor.begin - period) > 0.25 * period:
            break
        count += 1
    return count


def first_impact(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return the work on the grain in its first visit to the floor (Fig. 3.9)."""
    del options
    scene = job.scene
    motion = soft(scene, FINE)
    beam, series = structure_of(scene), beam_of(motion)
    period = 1.0 / scene.natural_frequency_hz
    found = visits(motion.impacts, period)
    begin = min((visit.begin for visit in found if visit.wall == FLOOR), default=0.0)
    end = min([*(visit.begin for visit in found if visit.begin > begin), begin + period])
    part = series.between(begin - 2.0 / FINE, end - 5.0 / FINE)
    work = work_on_grain(beam, part)
    touching = np.abs(contact_force(beam, part)) > 1e-3
    last = int(np.flatnonzero(touching)[-1]) if touching.any() else 0
    return Measured({"work": float(work[last])}, {"work": curve(part.time[: last + 1] - begin, work[: last + 1], 4000)})


def free_energy(job: Job, options: Mapping[str, Any]) -> Measured:
    """Return how much of the beam's total energy is left after a time, and its largest rise (Fig. 3.10)."""
    scene = job.scene
    motion = soft(scene, FINE)
    energy = total_energy(structure_of(scene), beam_of(motion))
    place = int(float(options["after"]) * FINE)
    drops = energy - np.minimum.accumulate(energy)
    return Measured(
        {"final_energy": 100.0 * float(energy[place] / energy[0]), "growth": 100.0 * float(drops.max() / energy[0])},
        {"energy": curve(motion.time[:place], energy[:place], 4000)},
    )
