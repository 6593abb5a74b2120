# SPDX-License-Identifier: Apache-2.0
"""Steady motions without waiting: against runs that have waited, their multipliers, and what has none."""

import json
from pathlib import Path

import numpy as np
import pytest

from atpid_sim.cli import main
from atpid_sim.periodic import SteadyEnding, steady_state
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.integration import Integration, Observation

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml")


def settled(scene: Scene, fidelity: str, rtol: float) -> float:
    """Amplitude of the same scene after 80 s [m]."""
    longer = scene.with_(duration=80.0, steady_window=[79.0, 80.0])
    return Integration(longer, fidelity, rtol).run(Observation(longer.steady_window)).last.amplitude


def test_the_standard_task_is_what_it_settles_to() -> None:
    found = steady_state(STANDARD, "soft", 1e-9).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(STANDARD, "soft", 1e-10), rel=1e-8)
    assert found.error_estimate < 1e-8
    assert found.periods == 1
    assert sorted(found.impacts[:, 1]) == [-1.0, 1.0]
    assert found.followed < 12.0


def test_a_disturbance_dies_out_as_the_multipliers_state() -> None:
    """The run that waits comes nearer by the leading multiplier each period."""
    found = steady_state(STANDARD, "soft", 1e-9).state
    assert found is not None
    leading = abs(found.multipliers[0])
    period = 1.0 / STANDARD.frequency_hz

    def off(end: float) -> float:
        scene = STANDARD.with_(duration=end, steady_window=[end - 2.0 * period, end])
        run = Integration(scene, "soft", 1e-10).run(Observation(scene.steady_window))
        return abs(run.last.amplitude - found.amplitude)

    early, late = 14.0, 14.0 + 20.0 * period
    assert (off(late) / off(early)) ** (1.0 / 20.0) == pytest.approx(leading, rel=0.01)
    assert found.settling_periods == pytest.approx(-1.0 / np.log(leading))


def test_instantaneous_impacts_are_exact() -> None:
    scene = STANDARD.with_(contact={"law": "impact", "restitution": 0.146})
    found = steady_state(scene, "impact", 1e-9).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(scene, "impact", 1e-9), rel=1e-8)


def test_a_sticking_grain_has_a_steady_motion_too() -> None:
    scene = load_scene(SCENES / "sticking.yaml")
    found = steady_state(scene, "soft", 1e-8).state
    assert found is not None
    assert found.amplitude == pytest.approx(settled(scene, "soft", 1e-9), rel=1e-7)


def test_what_has_no_steady_motion_is_named() -> None:
    irregular = load_scene(SCENES / "irregular.yaml")
    assert steady_state(irregular, "soft", 1e-6).ending == SteadyEnding.IRREGULAR
    closed = STANDARD.with_(ceiling={"height": 0.017})
    assert steady_state(closed, "soft", 1e-6).ending == SteadyEnding.IN_CONTACT
    ramp = STANDARD.with_(excitation={"amplitude": [[0.0, 0.01], [16.0, 0.02]], "frequency": "resonance"})
    free = STANDARD.with_(excitation={"free": {"deflection": 0.2}})
    for scene in (ramp, free):
        assert steady_state(scene, "soft", 1e-6).ending == SteadyEnding.CHANGING


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    scene = str(SCENES / "standard.yaml")
    assert main(["simulate", scene, "--steady", "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["amplitude"] == pytest.approx(0.045608444, rel=1e-6)
    assert values["periods"] == 1
    assert 0.0 < values["stability_margin"] < 1.0
    assert main(["simulate", scene, "--steady"]) == 0
    assert "settling_periods" in capsys.readouterr().out
    assert main(["simulate", str(SCENES / "irregular.yaml"), "--steady", "--fidelity", "impact", "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("steady: the transient does not contract")
    assert json.loads(printed.out)["motion"] == "irregular"
