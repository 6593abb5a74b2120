# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What another processor rounds otherwise decides nothing: not when a height is commanded, not how long a window is.

A tone without noise, whose period is a whole number of blocks or of samples, meets every threshold exactly. Its samples
are disturbed in their last digits, as another processor's arithmetic does.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from atpid_control.identification import Identifier
from atpid_control.loop.controller import SelectingController
from atpid_control.loop.rumble import RumbleSettings, RumbleWatch
from atpid_control.loop.settings import control_settings, identification_settings, settings_of
from atpid_control.selection.lookup import LookupSelector
from atpid_control.stand.parameters import parameters_in
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene
from atpid_sim.system import Array

ROOT = Path(__file__).resolve().parents[2]
SCENE = load_scene(ROOT / "scenes/thesis_4_3.yaml")
HEIGHTS = HeightMap.load(ROOT / "atpid_control/config/maps/standard.npz")
RATE, BLOCK, DURATION = 1000.0, 50, 5.0
#: Of the support [m] over the time [s]: to an amplitude of the map's grid, by its dead band further, to the map's end.
COURSE = ((0.0, 0.0), (0.5, 0.02), (2.0, 0.02), (2.1, 0.0202), (3.2, 0.0202), (3.5, 0.08))
#: A whole number of blocks, samples, half samples in a period; of fortieths of one in two samples; of none of these.
FREQUENCIES = (5.0, 8.0, 16.0, 6.25, 7.772772992954316)


def parameters(name: str) -> dict[str, Any]:
    return parameters_in(yaml.safe_load((ROOT / f"atpid_control/config/{name}.yaml").read_text()), f"{name}_node")


def decided(frequency: float, samples: Array) -> list[tuple[Any, ...]]:
    """Return what is decided at each block about the support's samples (n,) [m]; the beam moves five times as far."""
    selecting, identifying = parameters("selector"), parameters("identifier")
    identifier = Identifier(identification_settings(identifying.__getitem__))
    watch = RumbleWatch(settings_of(RumbleSettings, identifying.__getitem__, "rumble_"))
    settings = control_settings(selecting.__getitem__, frequency)
    machine = SelectingController(settings, LookupSelector(SCENE, HEIGHTS), (0.017, 1.0))
    decisions = []
    for first in range(0, samples.size, BLOCK):
        block, time = samples[first : first + BLOCK], (first + BLOCK - 1) / RATE
        estimate = identifier.push(first, RATE, block, 5.0 * block, time)
        rumble = watch.push(first, RATE, 5.0 * block, estimate.frequency)
        command = machine.answer(time, estimate, 0.3).command
        known = (estimate.quality, estimate.changed, estimate.used, estimate.lost)
        height = str(round(command.height, 6))  # NaN equals itself as a word
        decisions.append((round(time, 3), command.sequence, command.reason, height, rumble.periods, *known))
    return decisions


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_the_last_digits_of_the_samples_decide_nothing(frequency: float) -> None:
    time = np.arange(int(DURATION * RATE)) / RATE
    times, amplitudes = np.array(COURSE).T
    clean = np.interp(time, times, amplitudes) * np.sin(2.0 * math.pi * frequency * time)
    expected = decided(frequency, clean)
    commanded = [sequence for _, sequence, *_ in expected]
    assert commanded[-1] >= 2, "the heights follow this course"
    for seed in range(6):
        last_digits = 1.0 + np.finfo(float).eps * np.random.default_rng(seed).integers(-2, 3, time.size)
        assert decided(frequency, clean * last_digits) == expected
