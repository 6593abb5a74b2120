# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Identification beside structures of several modes that ring after impacts: the plant's stream into the identifier."""

import math
from collections.abc import Callable

import numpy as np

from atpid_common.vocabulary import Quality
from atpid_control.identification import Identifier
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import Stream
from atpid_sim.scene import Scene
from studies.identification.coverage import Z95
from studies.identification.measure import SETTINGS
from studies.modal import drawn

#: Modes at most; how long a structure is watched [s]; blocks between windows that share no sample.
_MODES, _SECONDS, _APART = 4, 8.0, 15
#: Noise of the lasers [m] and of the load cell [N], one standard deviation.
_LASER, _FORCE = 2e-5, 0.02


def structures(count: int, seed: int, done: Callable[[int], object] | None = None) -> list[str]:
    """Return the lines of the table over `count` random structures; `done` is called with how many are finished."""
    rng, rows = np.random.default_rng(seed), dict[str, list[list[float]]]()
    number = {"support": 0, "force": 0}
    for place in range(count):
        scene = drawn(rng)
        noise = {"laser": {"noise": _LASER}} | ({"load_cell": {"noise": _FORCE}} if scene.drive == "force" else {})
        scene = scene.with_(further_modes=scene.further_modes[: _MODES - 1], sensors=noise, duration=_SECONDS,
                            steady_window=[_SECONDS - 1.0, _SECONDS], tolerance=1e-5)  # fmt: skip
        rows.setdefault(scene.drive, []).extend(_windows(scene))
        number[scene.drive] += 1
        if done is not None:
            done(place + 1)
    lines = [
        f"Structures of two to {_MODES} modes: {count}, seed {seed}.",
        "",
        "| excited by | structures | windows | steady | amplitude, RMS and largest error | held "
        "| frequency, RMS and largest error | held |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for drive, found in rows.items():
        values = np.array(found)
        steady = values[np.isfinite(values[:, 0])]
        cells = [drive, f"{number[drive]}", f"{len(values)}", f"{len(steady)}"]
        for error, ratio in ((steady[:, 0], steady[:, 1]), (steady[:, 2], steady[:, 3])):
            cells += [f"{np.sqrt(np.mean(error**2)):.1e}, {np.abs(error).max():.1e}"]
            cells += [f"{100.0 * np.mean(np.abs(ratio) <= Z95):.1f} %"]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _windows(scene: Scene) -> list[list[float]]:
    """Return relative error and error over its bar of amplitude and frequency in each window; NaN: it is not steady."""
    stream, identifier, found = Stream(scene, Plant(scene)), Identifier(SETTINGS), []
    amplitude, frequency = scene.excitation.amplitude_points[0][1], scene.frequency_hz
    while not stream.finished:
        block = stream.advance(stream.height, 0.0)
        reading = block.readings[0]
        driven, beam = np.ascontiguousarray(reading.data.T)
        last = (reading.first_index + block.scans - 1) / reading.rate
        seen = identifier.push(reading.first_index, reading.rate, driven, beam, last)
        if block.number % _APART != _APART - 1:
            continue
        errors = seen.amplitude - amplitude, seen.frequency - frequency
        found.append([
            errors[0] / amplitude, errors[0] / seen.amplitude_std, errors[1] / frequency, errors[1] / seen.frequency_std
        ] if seen.quality == Quality.STEADY else [math.nan] * 4)  # fmt: skip
    return found
