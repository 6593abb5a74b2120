# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""On the simulated stand's own stream: each stage of the bench within a per cent two periods after its ramp or step."""

from pathlib import Path

import pytest
from identification_signals import SETTINGS

from atpid_control.identification import Estimate, Identifier, Quality
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import Stream
from atpid_sim.scene import load_scene

SCENES = Path(__file__).parents[2] / "scenes"


def identified(name: str) -> tuple[list[Estimate], list[float], float]:
    """Return the estimates of a scene with its ceiling closed, the true amplitudes [m] and the frequency [Hz]."""
    scene = load_scene(SCENES / f"{name}.yaml")
    stream, identifier = Stream(scene, Plant(scene)), Identifier(SETTINGS)
    found, truth = [], []
    while not stream.finished:
        block = stream.advance(stream.height, 0.0)
        laser = block.readings[0]
        last = (laser.first_index + len(laser.data) - 1) / laser.rate
        found.append(identifier.push(laser.first_index, laser.rate, laser.data[:, 0], laser.data[:, 1], last))
        truth.append(block.truth.excitation_amplitude)
    return found, truth, scene.frequency_hz


@pytest.mark.parametrize("name", ["thesis_4_3", "stepped_4_8"])
def test_steady_stages_are_right_two_periods_after_they_begin(name: str) -> None:
    found, truth, frequency = identified(name)
    begun = 0.0
    held = 0
    for k in range(1, len(found)):
        if abs(truth[k] - truth[k - 1]) > 1e-12:
            begun = found[k].time  # a step or ramp ended in this block at the latest
        elif found[k].time > begun + 2.0 / frequency and truth[k] > 0.0:
            held += 1
            assert found[k].quality == Quality.STEADY
            assert found[k].amplitude == pytest.approx(truth[k], rel=0.01)
            assert found[k].frequency == pytest.approx(frequency, rel=0.002)
            assert not found[k].changed or found[k].time < begun + 3.0 / frequency
    assert held > 0.6 * len(found)


def test_a_free_decay_has_no_excitation_but_a_beam() -> None:
    found, _, _ = identified("free_decay")
    assert {e.quality for e in found} == {Quality.NONE}
    assert found[20].beam_amplitude > 0.1
