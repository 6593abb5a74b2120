# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The closed form of one mass against textbook solutions and its own equation."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_mass_reference import ClosedForm, NoClosedFormError, steady_amplitude, undamped_amplitude

from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.simulate import simulate

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml")
RAMPS = [[0.0, 0.0], [0.5, 0.015], [6.0, 0.015], [8.0, 0.04]]


def scene(damping: float = 0.56, **excitation: Any) -> Scene:
    beam = {"mass": 0.3258, "stiffness": 427.6, "damping": damping}
    return STANDARD.with_(beam=beam, excitation=excitation or {"amplitude": 0.01, "frequency": "resonance"})


def test_the_steady_amplitude_is_the_transfer_function_s() -> None:
    motion = ClosedForm(STANDARD)
    expected = steady_amplitude(motion.body, 0.01, STANDARD.frequency_hz)
    assert undamped_amplitude(STANDARD) == pytest.approx(expected, rel=1e-4)
    late = STANDARD.with_(duration=60.0, steady_window=[58.0, 60.0])
    assert undamped_amplitude(late) == pytest.approx(expected, rel=1e-9)
    assert expected == pytest.approx(0.2224, abs=5e-5)  # figure 3.11: 0.23 m, with the static deflection


@pytest.mark.parametrize(("text", "expected"), [(0.0175, 1.0), (0.28, 1.0)])
def test_a_free_decay_is_the_textbook_s(text: float, expected: float) -> None:
    """Underdamped: successive peaks fall by exp(decay T)."""
    motion = ClosedForm(scene(damping=text * 32.0, free={"deflection": 0.2}))
    decay = 0.5 * motion.body.damping / motion.body.mass
    damped = math.sqrt(motion.body.stiffness / motion.body.mass - decay**2)
    times = 2.0 * math.pi / damped * np.arange(5.0)
    x = motion.at(times).x + STANDARD.static_deflection
    assert x == pytest.approx(0.2 * np.exp(-decay * times) * expected, rel=1e-9)


@pytest.mark.parametrize("ratio", [0.999999, 1.0, 1.000001, 3.0, 1e4])
def test_critical_and_heavy_damping(ratio: float) -> None:
    mass, stiffness = STANDARD.total_mass, STANDARD.beam.stiffness
    motion = ClosedForm(scene(damping=2.0 * ratio * math.sqrt(stiffness * mass), free={"deflection": 0.2}))
    times = np.linspace(0.0, 0.5, 11)
    y = motion.at(times).x + STANDARD.static_deflection
    natural = math.sqrt(stiffness / mass)
    if ratio < 1.1:
        assert y == pytest.approx(0.2 * (1.0 + natural * times) * np.exp(-natural * times), abs=1e-6)
    assert (np.diff(y) < 0.0).all()
    assert motion.ledger(16.0).residual < 1e-6


def test_an_undamped_beam_at_resonance_grows_without_end() -> None:
    motion = ClosedForm(scene(damping=0.0, amplitude=0.01, frequency="resonance"))
    omega = 2.0 * math.pi * STANDARD.frequency_hz
    times = np.linspace(0.0, 16.0, 101)
    expected = 0.005 * (np.sin(omega * times) - omega * times * np.cos(omega * times)) - STANDARD.static_deflection
    assert motion.at(times).x == pytest.approx(expected, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 50.0), st.floats(0.05, 200.0), st.booleans(), st.booleans())
def test_the_closed_form_satisfies_its_equation(
    damping: float, frequency: float, ramps: bool, with_grain: bool
) -> None:
    amplitude: Any = RAMPS if ramps else 0.01
    motion = ClosedForm(scene(damping=damping, amplitude=amplitude, frequency=frequency), with_grain)
    times = np.random.default_rng(1).uniform(0.0, 16.0, 200)
    at, body = motion.at(times), motion.body
    force = body.stiffness * (at.support - at.x) + body.damping * (at.support_rate - at.v) - body.mass * body.gravity
    assert at.a == pytest.approx(force / body.mass, rel=1e-9, abs=1e-8 * (np.abs(at.a).max() + 1.0))
    # and x, v, a are each other's derivatives, across the kinks as well
    h = 1e-4 / max(frequency, 6.0)
    ahead, behind = motion.at(times + h), motion.at(np.maximum(times - h, 0.0))
    span = times + h - np.maximum(times - h, 0.0)
    assert (ahead.x - behind.x) / span == pytest.approx(at.v, abs=1e-4 * (np.abs(at.v).max() + 1e-9))
    assert (ahead.v - behind.v) / span == pytest.approx(at.a, abs=2e-3 * (np.abs(at.a).max() + 1e-9))


@pytest.mark.parametrize("name", ["closed_damper", "thesis_4_3", "stand_realtime", "free_decay", "stepped_4_8"])
def test_the_energy_ledger_closes(name: str) -> None:
    loaded = load_scene(SCENES / f"{name}.yaml")
    ledger = ClosedForm(loaded).ledger(loaded.duration)
    assert ledger.residual < 1e-12
    assert ledger.beam_loss > 0.0


def test_amplitudes_of_the_closed_damper_in_section_4_3() -> None:
    """The thesis reads 0.3, 0.85 and 0.65 m off figure 4.5; the second includes the transient's overshoot."""
    motion = ClosedForm(load_scene(SCENES / "thesis_4_3.yaml"))
    assert motion.amplitude(4.0, 6.0) == pytest.approx(0.33, abs=0.01)
    assert motion.amplitude(12.0, 13.0) == pytest.approx(0.88, abs=0.02)
    assert motion.amplitude(18.0, 20.0) == pytest.approx(0.67, abs=0.01)


def test_a_grain_stays_down_only_under_weak_excitation() -> None:
    assert ClosedForm(STANDARD.with_(amplitude=1e-4)).stays_down()
    assert not ClosedForm(STANDARD).stays_down()
    assert not ClosedForm(STANDARD.with_(amplitude=1e-6, gravity=0.0)).stays_down()


def test_the_phase_keeps_its_digits_over_a_million_periods() -> None:
    long = STANDARD.with_(duration=2e5, steady_window=[199998.0, 200000.0])
    assert undamped_amplitude(long) == pytest.approx(
        steady_amplitude(ClosedForm(long).body, 0.01, long.frequency_hz), rel=1e-8
    )


def test_a_sweep_has_no_closed_form() -> None:
    with pytest.raises(NoClosedFormError, match="excitation: given sweep; allowed here: a tone or a free decay"):
        ClosedForm(scene(sweep={"amplitude": 0.001, "from": 4.0, "to": 7.0}))


@pytest.mark.parametrize("name", ["closed_damper", "thesis_4_3", "free_decay"])
def test_the_engine_agrees(name: str) -> None:
    """The compiled level is written with sines and rows, this closed form with complex numbers."""
    loaded = load_scene(SCENES / f"{name}.yaml").with_(height=0.017)
    assert simulate(loaded, "simplified", check=False).amplitude == pytest.approx(undamped_amplitude(loaded), rel=1e-9)
