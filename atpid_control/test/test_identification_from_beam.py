# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation from the beam alone: closed and open damper, still swinging up, and where it cannot be told."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from identification_signals import PERIOD, RATE, SETTINGS

from atpid_control.identification import Estimate, Identifier, Origin, Quality
from atpid_control.identification.from_beam import ClosedBeam, ModelInverse, crossings, regular_branch
from atpid_sim.scene import load_scene
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

SCENE = load_scene(Path(__file__).parents[2] / "scenes" / "closed_damper.yaml").with_(
    duration=12.0, steady_window=(10.0, 12.0)
)
CLOSED, TRUE = 0.017, 0.01


@cache
def beam(height: float) -> Array:
    motion = trajectory(SCENE.with_(height=height), RATE).beam
    size = 0.5 * (motion[-1000:].max() - motion[-1000:].min())
    noise: Array = np.random.default_rng(1).normal(0.0, size / np.sqrt(2.0) * 0.01, motion.size)
    return motion + noise


def inferred(height: float, told: float | None = None, stiffness: float = 1.0) -> list[Estimate]:
    scene = SCENE.with_(beam={**SCENE.beam.model_dump(), "stiffness": stiffness * SCENE.beam.stiffness})
    identifier, signal = Identifier(SETTINGS, ModelInverse.of_scene(scene)), beam(height)
    return [
        identifier.push(first, RATE, None, signal[first : first + 50], (first + 49) / RATE, height=told or height)
        for first in range(0, signal.size, 50)
    ]


def test_the_closed_damper_is_inverted_within_its_error_bar_while_the_amplitude_grows() -> None:
    found = inferred(CLOSED)
    late = [e for e in found if e.time > 2.0]  # the beam itself needs 6 s to settle
    assert {e.origin for e in found} == {Origin.BEAM}
    assert all(abs(e.amplitude - TRUE) < 2.5 * e.amplitude_std for e in late)
    assert np.median([abs(e.amplitude / TRUE - 1.0) for e in late]) < 0.01
    assert sum(e.quality == Quality.STEADY for e in late) > 0.8 * len(late)
    # the model's own uncertainty is most of the error bar, and said
    assert 0.03 < np.median([e.amplitude_std / e.amplitude for e in late]) < 0.08


@pytest.mark.parametrize("height", [0.08, 0.15])
def test_the_open_damper_is_inverted_by_simulated_amplitudes(height: float) -> None:
    late = [e for e in inferred(height) if e.time > 8.0]
    assert {e.quality for e in late} == {Quality.STEADY}
    assert all(abs(e.amplitude - TRUE) < min(2.0 * e.amplitude_std, 0.03 * TRUE) for e in late)
    assert all(np.isnan(e.phase) for e in late)


def test_where_two_regular_motions_look_alike_the_answer_is_poor_and_holds_both() -> None:
    """At 0.2 m the beam swings by 0.046 m under 0.0045 m and under 0.01 m of support."""
    late = [e for e in inferred(0.2) if e.time > 8.0]
    assert {e.quality for e in late} == {Quality.POOR}
    assert all(abs(e.amplitude - TRUE) < 2.0 * e.amplitude_std for e in late)


def test_a_wrong_model_is_covered_by_the_error_bar() -> None:
    late = [e for e in inferred(CLOSED, stiffness=1.005) if e.time > 8.0]
    assert all(abs(e.amplitude - TRUE) < 3.0 * e.amplitude_std for e in late)


def test_without_a_height_there_is_no_estimate() -> None:
    identifier = Identifier(SETTINGS, ModelInverse.of_scene(SCENE))
    estimates = [
        identifier.push(first, RATE, None, beam(CLOSED)[first : first + 50], 0.0) for first in range(0, 3000, 50)
    ]
    assert {e.quality for e in estimates} == {Quality.NONE}
    assert estimates[-1].beam_amplitude > 0.1


def test_the_transfer_is_that_of_one_mass() -> None:
    closed = ClosedBeam(0.362, 427.6, 0.56)
    resonance = np.sqrt(427.6 / 0.362)
    ratio = 0.56 / (2.0 * np.sqrt(427.6 * 0.362))
    assert 1.0 / abs(closed.inverse(resonance)) == pytest.approx(np.hypot(1.0, 2.0 * ratio) / (2.0 * ratio), rel=1e-9)
    assert abs(closed.inverse(1e-6)) == pytest.approx(1.0, rel=1e-9)


def test_two_support_amplitudes_for_one_response_are_a_wide_and_poor_answer() -> None:
    class Folded:
        def at(self, height: float) -> tuple[Array, Array, Array]:
            del height
            support = np.linspace(0.0, 0.1, 21)
            return support, support * (0.1 - support) * 40.0, np.full(21, 1e-4)

    inverse = ModelInverse(ClosedBeam(0.362, 427.6, 0.56), CLOSED, Folded().at)
    beam_seen = Estimate(
        quality=Quality.STEADY, amplitude=0.08, amplitude_std=1e-4, frequency=1.0 / PERIOD, frequency_std=1e-3,
        phase=0.0, phase_std=0.01, window=2 * PERIOD, growth=0.0, growth_std=0.01, origin=Origin.BEAM,
    )  # fmt: skip
    answer = inverse.support_of(beam_seen, 0.2)
    assert answer.quality == Quality.POOR
    assert answer.amplitude_std > 0.02
    assert np.isnan(inverse.support_of(Estimate(**{**vars(beam_seen), "amplitude": 0.3}), 0.2).amplitude)


def test_intervals_and_branches() -> None:
    support = np.linspace(0.0, 1.0, 11)
    ends = crossings(support, support, np.zeros(11), 0.5, 0.01)
    assert len(ends) == 1
    assert ends[0][0] < 0.5 < ends[0][1] < 0.52
    assert crossings(support, support, np.zeros(11), 2.0, 0.01) == []
    branch = regular_branch(np.array([5.0, 5.0, 3.0, 4.0, 5.0]), np.array([1.0, 1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(branch, [np.nan, 2.0, 3.0, 4.0, 5.0])
