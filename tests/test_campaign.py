# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Campaigns: what a file may have, when a point is settled or bad, and that a kill at any instant loses nothing."""

import json
import math
import random
import signal
import subprocess
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from documented import ROOT
from graph_runs import without_domain
from page_visit import visited

from atpid_common.vocabulary import Mode, Quality, Severity
from atpid_control.analysis.signals import Signals
from atpid_control.campaign.folder import CampaignFolder
from atpid_control.campaign.judge import Judge, is_random
from atpid_control.campaign.model import StandModel, by_steady_tone, model_of
from atpid_control.campaign.plan import Point, Rules, points_of, read_campaign
from atpid_control.campaign.run import run_campaign
from atpid_control.campaign.stands import Stand
from atpid_control.cli import main
from atpid_control.identification import Estimate
from atpid_control.runs.run import open_run
from atpid_sim.robust import restitution
from atpid_sim.scene import load_scene

CAMPAIGN: dict[str, Any] = {
    "scene": str(ROOT / "scenes/thesis_4_3.yaml"),
    "amplitudes": [0.01],
    "frequency_ratios": [0.98, 1.0],
    "heights": ["closed", 0.15, 0.2],
    "grain_masses": [0.0362, 0.06],
}


def campaign_file(folder: Path, **changes: Any) -> Path:
    path = folder / "campaign.yaml"
    values = {key: value for key, value in (CAMPAIGN | changes).items() if value is not None}
    path.write_text(yaml.safe_dump(values), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"amplitudes": []}, "amplitudes"),
        ({"frequencies": [5.4]}, "exactly one of both"),
        ({"heights": [1.5]}, "the ceiling's range"),
        ({"heights": ["open"]}, "heights"),
        ({"heights": None}, "one of them at least"),
        ({"heights": [0.1, 0.1]}, "each value once"),
        ({"stand": "real"}, "a parameter file of excitation_node"),
        ({"rules": {"settle_limit": 0.0}}, "settle_limit"),
        ({"colour": "red"}, "allowed: scene, stand, "),
        ({"order_": "random"}, "did you mean order?"),
        ({"foo": 1}, "foo: unknown key; allowed: scene, stand, "),
        ({"scene": str(ROOT / "scenes/standard.yaml")}, "one a controller moves"),
    ],
)
def test_a_file_that_cannot_be_is_one_line(
    changes: dict[str, Any], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", str(campaign_file(tmp_path, **changes)), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr().err
    assert words in printed
    assert printed.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("order", ["settling", "random"])
def test_every_point_is_there_once_and_a_grain_is_changed_once(order: str, tmp_path: Path) -> None:
    changes = {"order": order, "heights": ["none", "closed", 0.1, 0.2], "methods": ["lookup"], "repeats": 2}
    campaign, scene = read_campaign(campaign_file(tmp_path, **changes))
    points = points_of(campaign, scene)
    assert sorted(point.number for point in points) == list(range(1, len(points) + 1))
    assert len(points) == 2 * (2 * 4 + 1) * 2  # without a grain there are no masses of it
    grains = [point.grain_mass for point in points]
    assert sum(a != b for a, b in pairwise(grains)) == 2
    assert points == points_of(campaign, scene)
    if order == "settling":
        keys = ("frequency", "ceiling", "amplitude", "repeat")
        inside = [(a, b) for a, b in pairwise(points)
                  if a.grain_mass == b.grain_mass and "none" not in (a.ceiling, b.ceiling)]  # fmt: skip
        assert all(sum(getattr(a, key) != getattr(b, key) for key in keys) == 1 for a, b in inside)


class Motion:
    """Estimates of a beam whose amplitude is a function of time, judged until the judge is done."""

    def __init__(self, beam: Any, **changes: Any) -> None:
        self.judge = Judge(Rules(settle_limit=30.0), 0.01, 5.0, 0.2)
        for number in range(1, 2000):
            now = 0.05 * number
            values = {"amplitude": 0.01, "frequency": 5.0, "quality": Quality.STEADY, "lost": 0} | {
                key: value(now) for key, value in changes.items() if key != "height"
            }
            estimate = Estimate(time=now, amplitude_std=1e-6, frequency_std=1e-4, beam_amplitude=beam(now), **values)
            self.judge.push(estimate, changes.get("height", lambda _: 0.2)(now), moving=False)
            if self.judge.over:
                break


def test_a_beam_that_still_decays_or_beats_has_not_settled() -> None:
    regular = Motion(lambda _: 0.1).judge
    assert regular.bad == ""
    assert regular.settled_after == pytest.approx(3.0, abs=0.5)
    for rate, frequency in ((1.0, 0.0), (0.5, 0.16), (0.5, 0.46)):

        def beam(time: float, rate: float = rate, frequency: float = frequency) -> float:
            return 0.1 + 0.05 * math.exp(-rate * time) * math.cos(2.0 * math.pi * frequency * time)

        judge = Motion(beam).judge
        assert judge.bad == ""
        assert 0.05 * math.exp(-rate * judge.begin) < 0.02 * 0.1, (rate, frequency)


def test_an_irregular_motion_is_a_result() -> None:
    chance = np.random.default_rng(1)
    assert Motion(lambda _: 0.1 * (1.0 + 0.1 * chance.standard_normal())).judge.bad == ""
    assert sum(is_random(chance.standard_normal(8)) for _ in range(1000)) > 300


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"amplitude": lambda _: 0.011}, "amplitude 0.011, wanted 0.01"),
        ({"frequency": lambda _: 5.1}, "frequency 5.1 Hz"),
        ({"quality": lambda _: Quality.POOR}, "the excitation is poor"),
        ({"quality": lambda t: Quality.STEADY if t < 4.0 else Quality.NONE}, "while measured: the excitation is none"),
        ({"lost": lambda t: 3 * (t > 4.0)}, "3 samples lost"),
        ({"height": lambda _: 0.3}, "the ceiling is at 0.3000 m"),
        ({"height": lambda _: math.nan}, "not known"),
        ({"amplitude": lambda t: 0.01 if t < 5.0 else 0.012}, "while measured: amplitude 0.012"),
    ],
)
def test_what_is_not_as_it_has_to_be_makes_a_point_bad(changes: dict[str, Any], words: str) -> None:
    assert words in Motion(lambda _: 0.1, **changes).judge.bad


def test_alarms_spoil_a_point_and_rumble_does_not() -> None:
    judge = Judge(Rules(), 0.01, 5.0, 0.2)
    judge.on_event(Severity.ALARM, "rumble", "irregular")
    judge.on_event(Severity.WARNING, "refused", "out of the map")
    assert not judge.over
    judge.on_event(Severity.WARNING, "dropped", "3 scans")
    assert judge.bad == "dropped: 3 scans"
    assert Mode.FAULT  # the mode with which the motor's fault is named


class BrokenStand(Stand):
    """A stand of which every attempt is bad; it measures nothing."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def measure(self, point: Point, folder: Path, judge: Judge) -> None:
        self.asked.append(point.number)
        (folder / "bag").mkdir()
        judge.bad = f"attempt {self.asked.count(point.number)}"


def test_a_bad_point_is_repeated_then_skipped_and_named(tmp_path: Path) -> None:
    campaign, scene = read_campaign(campaign_file(tmp_path, grain_masses=None, rules={"repeat_bad": 2}))
    folder, stand = CampaignFolder(tmp_path / "out"), BrokenStand()
    with folder.open({"campaign": 1}):
        done = run_campaign(campaign, scene, folder, lambda _: stand, lambda *_: None, lambda: False)
    assert (done.points, done.measured, len(done.skipped), done.attempts_bad) == (6, 0, 6, 12)
    assert "attempt 3" in done.skipped[0]
    assert [stand.asked.count(number) for number in range(1, 7)] == [3] * 6
    with folder.open({"campaign": 1}):  # nothing is left
        run_campaign(campaign, scene, folder, lambda _: stand, lambda *_: None, lambda: False)
    assert len(stand.asked) == 18


def test_another_campaign_and_other_files_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", str(campaign_file(tmp_path)), "--out", str(tmp_path)]) == 2
    assert "holds other files (campaign.yaml)" in capsys.readouterr().err


@pytest.mark.slow
def test_a_campaign_killed_at_any_instant_loses_nothing_and_agrees_with_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two kills: within the second point, and, of the run that goes on from there, within its second one."""
    path, out, chance = campaign_file(tmp_path, grain_masses=None), tmp_path / "out", random.Random(5)
    command, environment = ["atpid", "campaign", str(path), "--out", str(out)], without_domain()
    before: dict[str, int] = {}
    for _ in range(2):
        running = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        begun = len(list((out / "points").glob("[0-9]*")))
        deadline = time.monotonic() + 120.0
        while running.poll() is None and len(list((out / "points").glob("[0-9]*"))) == begun:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        time.sleep(chance.uniform(0.0, 1.0))  # within the next point
        running.kill()
        assert running.wait() == -signal.SIGKILL
        for place in (out / "points").glob("[0-9]*"):
            record = (place / "point.json").stat()
            assert before.setdefault(place.name, record.st_mtime_ns) == record.st_mtime_ns  # none is measured again
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=400.0)
    assert done.returncode == 0, done.stderr
    assert "6 of 6 points measured, 0 skipped" in done.stdout
    places = [out / f"points/{number:04d}" for number in range(1, 7)]
    assert sorted((out / "points").iterdir()) == places
    assert all((out / "points" / name / "point.json").stat().st_mtime_ns == made for name, made in before.items())
    index = json.loads((out / "index.json").read_text())
    assert [record["number"] for record in index] == list(range(1, 7))
    for place in places:
        assert not open_run(place / "bag").unread
        assert (place / "report/report.html").is_file()
    found = json.loads((out / "comparison.json").read_text())
    assert len(found) == len(places)
    assert [one["apart"] for one in found if abs(one["apart"]) > 2.0] == []
    model, scene = calibrated(out, tmp_path / "model", monkeypatch), load_scene(Path(CAMPAIGN["scene"]))
    for name in ("mass", "stiffness", "damping"):
        value, std = getattr(model.beam, name), getattr(model.beam, f"{name}_std")
        assert value == pytest.approx(getattr(scene.beam, name), abs=3.0 * std), name
        assert std < 0.01 * value
    assert model.restitution == pytest.approx(restitution(scene), abs=4.0 * model.restitution_std)
    wrong = {name: findings for name, findings in visited(out / "index.html").items() if findings}
    assert wrong == {}


@pytest.mark.parametrize(("ratio", "left"), [(0.95, 0.0), (0.98, 0.005), (1.0, 0.002)])
def test_what_is_left_of_the_motion_before_is_in_the_error(ratio: float, left: float) -> None:
    """Closed form, 12 phases each; left: of the free vibration when a part begins, relative to the steady one [-]."""
    chance, mass, stiffness, damping, rate = np.random.default_rng(1), 0.362, 427.6, 0.56, 1000.0
    natural, decay = math.sqrt(stiffness / mass), 0.5 * damping / mass
    omega = ratio * natural
    times = np.arange(0.0, 40.0 * math.pi / omega, 1.0 / rate)
    spring = stiffness + 1j * omega * damping
    response = spring / (spring - mass * omega**2)
    off = []
    for turn, other in chance.uniform(0.0, 2.0 * math.pi, (12, 2)):
        drive = 0.01 * np.exp(1j * (omega * times + turn))
        free = np.exp(-decay * times) * np.cos(math.sqrt(natural**2 - decay**2) * times + other)
        beam = (response * drive).real + left * 0.01 * abs(response) * free
        noise = 20e-6 * chance.standard_normal((2, len(times)))
        found, covariance = by_steady_tone(Signals(rate, drive.real + noise[0], beam + noise[1], start=3.0))
        off.append((found - [natural**2, 2.0 * decay]) / np.sqrt(np.diag(covariance)))
    deviations = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all((deviations > 0.3) & (deviations < 1.8))  # of their standard deviations


def calibrated(campaign: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> StandModel:
    """Make the model of a campaign by the command; return what it found, to all digits and with its deviations."""
    found: list[StandModel] = []

    def kept(*given: Any) -> StandModel:
        found.append(model_of(*given))
        return found[0]

    monkeypatch.setattr("atpid_control.campaign.model.model_of", kept)
    assert main(["calibrate", "campaign", str(campaign), "--out", str(out)]) == 0
    written = load_scene(out / "model.yaml")
    assert written.beam.stiffness == pytest.approx(found[0].beam.stiffness, rel=1e-9)
    return found[0]
