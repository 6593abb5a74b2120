# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid first-run`: on the simulated and the emulated stand, on the stand's own nodes, and on another beam."""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import settings
from matplotlib.figure import Figure

from atpid_common.cli import Parser
from atpid_control.cli import main as atpid
from atpid_control.commands import first_run, stand
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run
from atpid_control.stand.domain import own_domain
from atpid_control.stand.first_run import Expected, Step, rows_of, steps_of
from atpid_driver.emulator import PACKAGES, Emulator, missing_tools
from atpid_driver.standins import Control, build
from atpid_driver.standins.build import environment
from atpid_sim.scene import Scene, load_scene

pytestmark = pytest.mark.slow
LONG = settings.get_current_profile_name() == "long"
ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "scenes/stand_realtime.yaml"


@pytest.fixture(autouse=True, scope="module")
def _any_domain() -> Iterator[None]:
    """A bench of a test claims a domain of its own: the session holds the one it has set."""
    with pytest.MonkeyPatch.context() as change:
        change.delenv("ROS_DOMAIN_ID")
        yield


def beam(scene: Scene, **changed: float) -> Scene:
    return scene.with_(beam=scene.to_mapping()["beam"] | changed)


@pytest.fixture
def stiff(tmp_path: Path) -> Path:
    """The scene's beam nine times as stiff, so that what takes periods takes a third of the time."""
    scene = beam(load_scene(SCENE), stiffness=9.0 * 427.6, damping=3.0 * 0.56).with_(amplitude=0.004)
    path = tmp_path / "stiff.yaml"
    path.write_text(yaml.safe_dump(scene.to_mapping()))
    return path


def shorter(expected: Expected) -> list[Step]:
    """The steps, that of the known motion with 2 s after it: four of the half seconds that show noise."""
    *others, motion = steps_of(expected)
    return [*others, replace(motion, duration=2.0)]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a first run on the simulated bench."""
    out = tmp_path_factory.mktemp("first") / "out"
    with pytest.MonkeyPatch.context() as change:
        change.setattr(first_run, "steps_of", shorter)
        assert atpid(["first-run", str(SCENE), "--simulated", "--yes", "--out", str(out)]) == 0
    return out


def figures(out: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of a first run's numbers, by what they are."""
    steps = json.loads((out / "first_run.json").read_text())["steps"]
    return {row["what"]: row for rows in steps.values() for row in rows}


def test_a_simulated_stand_is_as_its_scene_expects(simulated: Path) -> None:
    found = figures(simulated)
    assert all(row["right"] for row in found.values())
    # by hand: M = 0.3258/0.9 kg, f = sqrt(k/M)/2 pi, zeta = c/(2 sqrt(k M)), closed at resonance sqrt(1 + 1/(2 zeta)^2)
    assert float(found["frequency"]["found"].split()[0]) == pytest.approx(5.470, abs=0.003)
    assert float(found["damping ratio"]["found"].split()[0]) == pytest.approx(0.0225, abs=1e-4)
    assert float(found["beam over excitation"]["found"]) == pytest.approx(22.2, abs=0.1)
    assert found["known motion"]["found"] == "known motion passed"
    page = (simulated / "first_run.html").read_text()
    assert "free decay: damping ratio" in page
    assert '<svg role="img"' in page


@pytest.mark.parametrize(
    ("changed", "differ"),
    [
        ({"stiffness": 480.0}, {"frequency", "excitation's frequency", "beam over excitation"}),
        ({"damping": 0.9}, {"damping ratio", "ratio of successive peaks", "beam over excitation"}),
    ],
)
def test_a_beam_that_is_not_the_scene_s_is_named(simulated: Path, changed: dict[str, float], differ: set[str]) -> None:
    expected = Expected(beam(load_scene(SCENE), **changed))
    runs = {step.name: open_run(simulated / step.name / "run/bag") for step in steps_of(expected)[:3]}
    rows = [row for step in steps_of(expected)[:3] for row in rows_of(step, runs[step.name], expected)]
    assert {row.what for row in rows if not row.right} == differ
    assert all(row.remedy for row in rows)


def test_the_panel_of_the_known_motion_shows_it(simulated: Path) -> None:
    step, axes = steps_of(Expected(load_scene(SCENE)))[3], Figure().add_subplot()
    first_run._draw(axes, step, open_run(simulated / step.name / "run/bag"))
    begin, end = axes.get_xlim()
    (ceiling,) = (line for line in axes.lines if line.get_label() == "ceiling [m]")
    time, height = (np.asarray(values) for values in ceiling.get_data())
    assert np.ptp(height[(begin <= time) & (time <= end)]) == pytest.approx(step.move, abs=0.01)


def test_the_ceiling_moves_before_the_run_and_is_back_when_it_begins(simulated: Path) -> None:
    bag = open_bag(simulated / "4-motion/run/bag")
    events = [event.text for _, event in bag.messages("/events") if event.node == "motor_node"]
    assert events[0] == "known motion: in 1 s the ceiling moves from 0.017 to 0.117 m and back"
    # tried again where a busy machine withdrew the supervisor's permission meanwhile
    assert "known motion passed" in events, events[:10]
    first = next(when for when, block in bag.messages("/sensors/laser") if not block.handshake)
    before = [state for when, state in bag.messages("/ceiling/state") if when < first and state.homed]
    assert max(state.height for state in before) == pytest.approx(0.117)
    assert before[-1].height == 0.017


def test_a_recording_of_something_else_is_named(simulated: Path) -> None:
    expected = Expected(load_scene(SCENE))
    noise, decay, resonance = steps_of(expected)[:3]
    (row,) = rows_of(decay, open_run(simulated / resonance.name / "run/bag"), expected)
    assert row.found.startswith("no free decay")
    assert not row.right
    loud = rows_of(noise, open_run(simulated / resonance.name / "run/bag"), expected)
    assert {row.what for row in loud if not row.right} >= {"beam_displacement at rest", "excitation identified"}


def board_or_skip() -> None:
    if missing := missing_tools():
        text = f"left out: the emulated board; missing {', '.join(missing)}: apt-get install {PACKAGES}"
        pytest.fail(text) if os.environ.get("CI") == "true" else pytest.skip(text)


def at_once(expected: Expected) -> list[Step]:
    """One step for three: the known motion, then a free decay, of which half the time is long after its end."""
    noise, decay, _, motion = steps_of(expected)
    each = [step.rows for step in (noise, decay, motion)]
    return [replace(decay, move=motion.move, rows=lambda run, by: chain.from_iterable(rows(run, by) for rows in each))]


def test_the_emulated_stand_unattended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but the tone, for which tests/test_emulated_stand.py is, from one stand: starting one costs more than a run.

    The beam is 81 times as stiff: its decay has a time constant of 0.14 s, in a recording of 3.6 s. A long run has the
    command's own four steps.
    """
    board_or_skip()
    if not LONG:
        monkeypatch.setattr(first_run, "steps_of", at_once)
    file = tmp_path / "stiff.yaml"
    scene = beam(load_scene(SCENE), stiffness=81.0 * 427.6, damping=9.0 * 0.56).with_(amplitude=0.001)
    file.write_text(yaml.safe_dump(scene.to_mapping()))
    status = atpid(["first-run", str(file), "--emulated-stand", "--yes", "--out", str(tmp_path / "out")])
    found = figures(tmp_path / "out")
    assert [row for row in found.values() if not row["right"]] == []
    assert status == 0
    assert set(found) >= {
        "support_displacement at rest", "beam_displacement at rest", "excitation identified", "frequency",
        "damping ratio", "ratio of successive peaks", "known motion", "ceiling's travel", "lost scans",
    }  # fmt: skip
    assert float(found["ceiling's travel"]["found"].split()[0]) == pytest.approx(0.1, abs=0.003)


def test_a_person_is_asked_and_a_stand_needs_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert atpid(["first-run", str(SCENE), "--yes", "--out", str(tmp_path / "a")]) == 2
    assert "a person has to act" in capsys.readouterr().err
    with (tmp_path / "answers").open("w+") as answers:
        answers.write("what\ns\ns\nq\n")
        answers.seek(0)
        monkeypatch.setattr(sys, "stdin", answers)
        assert atpid(["first-run", str(SCENE), "--out", str(tmp_path / "b")]) == 0
    said = capsys.readouterr().err
    assert said.count("Enter: go on, s: skip, q: stop") == 4
    assert "Pull the tip by at most 0.22 m" in said
    notes = json.loads((tmp_path / "b/first_run.json").read_text())["notes"]
    assert notes == ["skipped: noise floor", "skipped: free decay", "stopped before: closed damper at resonance"]


@contextmanager
def devices(folder: Path) -> Iterator[tuple[list[str], dict[str, str]]]:
    """The stand's own nodes' devices: the emulated board, and a T7 whose two inputs have the same sine."""
    control = Control(folder / "device")
    variables = environment(build(), ljm_control=control.path, ljm_source="sine:amplitude=0.2,offset=3,frequency=16.41")
    motor, levels = folder / "motor.yaml", folder / "levels.yaml"
    usual = yaml.safe_load((ROOT / "atpid_driver/config/motor_serial.yaml").read_text())
    usual["/**/motor_node"]["ros__parameters"]["port"] = str(folder / "board")
    motor.write_text(yaml.dump(usual))
    levels.write_text(yaml.dump({"/**/supervisor_node": {"ros__parameters": {"beam_displacement_abort": 0.9}}}))
    with Emulator(folder / "board", eeprom=folder / "eeprom") as board:
        board.pace(1.0)
        yield ["--motor-config", str(motor), "--params-file", str(levels)], variables
    control.close()


def test_the_stand_s_own_nodes_for_one_step(stiff: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    board_or_skip()
    monkeypatch.setattr(first_run, "_HANDS", 1.0)  # a stand-in needs no hands
    with devices(tmp_path) as (words, variables), (tmp_path / "answers").open("w+") as answers, own_domain():
        answers.write("s\ns\n\nq\n")
        answers.seek(0)
        monkeypatch.setattr(sys, "stdin", answers)
        for name, value in variables.items():
            monkeypatch.setenv(name, str(value))
        assert atpid(["first-run", str(stiff), "--out", str(tmp_path / "out"), *words]) == 1
    found = figures(tmp_path / "out")
    assert found["beam over excitation"]["found"] == "1"  # both lasers see the same
    assert not found["beam over excitation"]["right"]
    assert found["excitation's frequency"]["right"]
    assert found["lost scans"]["right"]


def test_the_options_of_the_stand_are_handed_on() -> None:
    parser = Parser()
    first_run.add_arguments(parser)
    given: argparse.Namespace = parser.parse_args([str(SCENE), "--ni", "--motor-config", "m.yaml"])
    made = first_run._options(stand, vars(given) | {"seconds": 3.0})
    assert (made.ni, made.motor_config, made.seconds, made.live) == (True, Path("m.yaml"), 3.0, False)
