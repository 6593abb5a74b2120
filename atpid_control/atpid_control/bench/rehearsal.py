# SPDX-License-Identifier: Apache-2.0
"""Warm-up of the compiled parts before the graph starts: on a fresh machine compiling takes long.

In lockstep everything is loaded afterwards; in real time every node finds it in the compiler's cache.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.console import Console

from atpid_common.waiting import COMPILING, announced
from atpid_control.identification import Identifier
from atpid_control.loop.settings import identification_settings
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import Stream
from atpid_sim.scene import Scene

_RATE, _BLOCK, _BLOCKS = 1000.0, 50, 60


def rehearse(scene: Scene, identifier: Mapping[str, Any]) -> None:
    """Compute one block of the scene's plant, and identify a made-up tone with the identifier's parameters."""
    console = Console(stderr=True)
    with console.status(COMPILING) if console.is_terminal else announced(COMPILING):
        Stream(scene, Plant(scene)).advance(scene.ceiling.heights[0][1], 0.0)
        _identify(scene.frequency_hz, identifier)


def _identify(frequency: float, parameters: Mapping[str, Any]) -> None:
    """Feed a tone that changes, with noise, hum and a gap, so that every path of the identification is taken."""
    trial = Identifier(identification_settings(parameters.__getitem__))
    time = np.arange(_BLOCK * _BLOCKS) / _RATE
    tone = np.where(time < 1.5, 1.0, 1.5) * np.sin(2.0 * np.pi * frequency * time)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(time))
    signal = tone + noise + np.where(time < 2.0, 0.0, 0.05 * np.sin(100.0 * np.pi * time))
    signal[1100:1103] = np.nan
    for first in range(0, len(time), _BLOCK):
        samples = signal[first : first + _BLOCK]
        trial.push(first, _RATE, samples, samples, float(time[first + _BLOCK - 1]))
