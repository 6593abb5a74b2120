# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scene of one leg of a soak: a random but seeded schedule of amplitudes, pauses and faults."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from atpid_control.stand.errors import BenchError
from atpid_sim.scene import Scene

#: Support amplitudes [m] as shares of the scene's largest; how long a stage and a pause last, and a change takes [s].
_SHARES, _STAGE, _PAUSE, _CHANGE = (0.25, 1.0), (5.0, 40.0), (3.0, 10.0), (1.0, 3.0)
#: Share of the stages that are pauses.
_PAUSES = 0.2
#: From one fault to the next, and how long one lasts [s].
_BETWEEN, _LASTS = (20.0, 60.0), (0.5, 5.0)

Fault = Mapping[str, Any]


def leg_mapping(scene: Scene, duration: float, seed: int, leg: int, faults: Sequence[Fault] = ()) -> dict[str, Any]:
    """Return the scene of leg number `leg` as a mapping: `scene` for `duration` [s] with a schedule of its own.

    faults: kinds of fault to draw from, each the keys of one of the scene's `faults` without `from` and `to`. Raises
    BenchError for a scene whose excitation or ceiling has no place for a schedule, and for faults it cannot act.
    """
    if not (scene.excitation.is_tone and scene.ceiling.controlled):
        raise BenchError("soak: the scene's excitation has to be harmonic, and its ceiling moved by a controller")
    if faults and "faults" not in Scene.model_fields:
        raise BenchError("--faults: given, but scenes of this version have no key `faults`; leave it out")
    random = np.random.default_rng([seed, leg])
    mapping = scene.model_dump(mode="json", exclude_unset=True, by_alias=True)
    mapping["excitation"] = {
        "amplitude": points(random, duration, scene.excitation.largest_amplitude),
        "frequency": scene.excitation.tone_frequency,
    }
    mapping |= {
        "duration": duration,
        "steady_window": [max(0.0, duration - 2.0), duration],
        "seed": int(random.integers(2**31)),
    }
    return mapping | ({"faults": fault_times(random, duration, faults)} if faults else {})


def points(random: np.random.Generator, duration: float, largest: float) -> list[list[float]]:
    """Return the points [time [s], amplitude [m]] of stages, pauses and the changes between them."""
    found, time, amplitude = [[0.0, 0.0]], 0.0, 0.0
    while time < duration:
        change = random.uniform(*_CHANGE)
        pause = amplitude > 0.0 and random.random() < _PAUSES
        amplitude = 0.0 if pause else round(largest * random.uniform(*_SHARES), 5)
        length = random.uniform(*(_PAUSE if pause else _STAGE))
        found += [[round(time + change, 3), amplitude], [round(time + change + length, 3), amplitude]]
        time += change + length
    within = [point for point in found if point[0] < duration]
    return [*within, [duration, within[-1][1]]]


def fault_times(random: np.random.Generator, duration: float, faults: Sequence[Fault]) -> list[dict[str, Any]]:
    """Return faults drawn from `faults`, one after the other, each with its begin and end [s]."""
    found: list[dict[str, Any]] = []
    time = random.uniform(*_BETWEEN)
    while faults and time < duration - _LASTS[1]:
        end = time + random.uniform(*_LASTS)
        drawn = dict(faults[int(random.integers(len(faults)))])
        found.append(drawn | {"from": round(time, 3), "to": round(end, 3)})
        time = end + random.uniform(*_BETWEEN)
    return found


def legs_of(hours: float, leg_hours: float) -> list[float]:
    """Return the durations [s] of the legs; the last may be shorter."""
    whole = math.ceil(hours / leg_hours - 1e-9)
    lengths = [3600.0 * min(leg_hours, hours - number * leg_hours) for number in range(whole)]
    return [round(length, 3) for length in lengths]
