# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Campaigns: what a file may have, when a point is settled or bad, and what a kill or damaged files leave."""

import json
import math
import random
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml
from documented import ROOT
from graph_runs import wait_until, without_domain
from page_visit import visited

from atpid_campaign.campaign.folder import CampaignFolder, Record
from atpid_campaign.campaign.model import StandModel, by_steady_tone, model_of
from atpid_campaign.campaign.plan import Campaign, Point, Rules, points_of, read_campaign
from atpid_campaign.campaign.result import Judge, is_random
from atpid_campaign.campaign.run import Done, run_campaign
from atpid_campaign.campaign.stands import SimulatedStand, Stand
from atpid_common.testing import PATIENCE
from atpid_common.vocabulary import Quality, Severity
from atpid_control.analysis.signals import Signals
from atpid_control.cli import main
from atpid_control.identification import Estimate
from atpid_control.runs.run import open_run
from atpid_sim.robust import restitution
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.batch import Progress

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
        ({"frequencies": [5.4]}, "frequencies and frequency_ratios"),
        ({"heights": [1.5]}, "1.5"),
        ({"stand": "real"}, "excitation_node"),
        ({"rules": {"settle_limit": 0.0}}, "settle_limit"),
        ({"colour": "red"}, "allowed: scene, stand, "),
        ({"scene": str(ROOT / "scenes/standard.yaml")}, "controller"),
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
        ({"amplitude": lambda _: 0.011}, "amplitude 0.011.* 0.01$"),
        ({"frequency": lambda _: 5.1}, "frequency 5.1 Hz"),
        ({"quality": lambda _: Quality.POOR}, "poor"),
        ({"quality": lambda t: Quality.STEADY if t < 4.0 else Quality.NONE}, "measured.* none"),
        ({"lost": lambda t: 3 * (t > 4.0)}, "3 samples"),
        ({"height": lambda _: 0.3}, "ceiling.* 0.3000 m"),
        ({"height": lambda _: math.nan}, "ceiling.*not known"),
        ({"amplitude": lambda t: 0.01 if t < 5.0 else 0.012}, "measured.*amplitude 0.012"),
    ],
)
def test_what_is_not_as_it_has_to_be_makes_a_point_bad(changes: dict[str, Any], words: str) -> None:
    assert re.search(words, Motion(lambda _: 0.1, **changes).judge.bad)


def test_alarms_spoil_a_point_and_rumble_does_not() -> None:
    judge = Judge(Rules(), 0.01, 5.0, 0.2)
    judge.on_event(Severity.ALARM, "rumble", "irregular")
    judge.on_event(Severity.WARNING, "refused", "out of the map")
    assert not judge.over
    judge.on_event(Severity.WARNING, "dropped", "3 scans")
    assert judge.bad == "dropped: 3 scans"


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


def done_points(out: Path) -> set[Path]:
    return set((out / "points").glob("[0-9]*"))


def test_a_campaign_killed_at_any_instant_loses_nothing_and_agrees_with_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two kills: within the second point, and, of the run that goes on from there, within its second one."""
    path = campaign_file(tmp_path, grain_masses=None, heights=["closed", 0.2])
    out, chance = tmp_path / "out", random.Random(5)
    command, environment = ["atpid", "campaign", str(path), "--out", str(out)], without_domain()
    before: dict[str, int] = {}
    for _ in range(2):
        running = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        begun = done_points(out)
        wait_until(lambda begun=begun: done_points(out) > begun, running)  # type: ignore[misc]
        time.sleep(chance.uniform(0.0, 1.0))  # within the next point
        running.kill()
        assert running.wait() == -signal.SIGKILL
        for place in done_points(out):
            record = (place / "point.json").stat()
            assert before.setdefault(place.name, record.st_mtime_ns) == record.st_mtime_ns  # none is measured again
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=4.0 * PATIENCE)
    assert done.returncode == 0, done.stderr
    assert re.search(r"\b4 of 4\b.*\b0 skipped", done.stdout)
    places = [out / f"points/{number:04d}" for number in range(1, 5)]
    assert sorted((out / "points").iterdir()) == places
    assert all((out / "points" / name / "point.json").stat().st_mtime_ns == made for name, made in before.items())
    index = json.loads((out / "index.json").read_text())
    assert [record["number"] for record in index] == list(range(1, 5))
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

    monkeypatch.setattr("atpid_campaign.campaign.model.model_of", kept)
    assert main(["calibrate", "campaign", str(campaign), "--out", str(out)]) == 0
    written = load_scene(out / "model.yaml")
    assert written.beam.stiffness == pytest.approx(found[0].beam.stiffness, rel=1e-9)
    return found[0]


class Measured(NamedTuple):
    """A campaign of two points, and its folder."""

    file: Path
    campaign: Campaign
    scene: Scene
    out: Path

    @property
    def plan(self) -> dict[str, Any]:
        """What the command keeps in the folder."""
        given = self.campaign.model_dump(mode="json", exclude={"scene"})
        return {"campaign": given, "scene": self.scene.to_mapping()}

    def run(self, out: Path, progress: Progress = lambda _: None) -> Done:
        folder, stand = CampaignFolder(out), SimulatedStand(self.campaign, self.scene)
        with folder.open(self.plan):
            return run_campaign(self.campaign, self.scene, folder, lambda _: stand, progress, lambda: False)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Measured:
    place = tmp_path_factory.mktemp("measured")
    rules, ratios = {"measure_periods": 10}, [0.96, 1.0]
    file = campaign_file(place, frequency_ratios=ratios, heights=["closed"], grain_masses=None, rules=rules)
    made = Measured(file, *read_campaign(file), place / "out")
    assert made.run(made.out).measured == 2
    return made


@pytest.fixture
def copy(measured: Measured, tmp_path: Path) -> Path:
    shutil.copytree(measured.out, tmp_path / "out")
    return tmp_path / "out"


def cut(name: str, length: int) -> Callable[[Path], object]:
    def act(place: Path) -> None:
        content = (place / name).read_bytes()
        (place / name).write_bytes(content[:length])

    return act


def change_byte(name: str) -> Callable[[Path], object]:
    def act(place: Path) -> None:
        content = bytearray((place / name).read_bytes())
        content[len(content) // 2] ^= 1
        (place / name).write_bytes(content)

    return act


def replace_by_other(place: Path) -> None:
    shutil.rmtree(place)
    shutil.copytree(place.with_name("0001"), place)


def multiply(place: Path) -> None:
    record = json.loads((place / "point.json").read_text())
    larger = {key: 1.5 * value if isinstance(value, float) else value for key, value in record.items()}
    (place / "point.json").write_text(json.dumps(larger, indent=1) + "\n")


BAG = "bag/bag_0.mcap"
#: What is done to the folder of point 2, and the file that is named.
DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "bag removed": (lambda place: shutil.rmtree(place / "bag"), "bag_0.mcap"),
    "a byte of the bag": (change_byte(BAG), BAG),
    "a byte of the record": (change_byte("point.json"), ""),
    "a byte of the scene": (change_byte("scene.yaml"), "scene.yaml"),
    "another point's": (replace_by_other, "point 1"),
    "another point's bag": (lambda place: shutil.copy(place.with_name("0001") / BAG, place / BAG), BAG),
    "numbers times 1.5": (multiply, "point.json"),
    "record cut": (cut("point.json", 200), "point.json"),
    "record removed": (lambda place: (place / "point.json").unlink(), "point.json"),
    "digests cut": (cut("digests.json", 100), "digests.json"),
}


def files_of(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir() if path.is_file()}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_point_is_left_out_of_results_and_named_and_set_aside_whole(
    damage: str, measured: Measured, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    act, named = DAMAGES[damage]
    place, aside = copy / "points/0002", copy / "damaged/0002-1"
    act(place)
    left = files_of(place)
    results = CampaignFolder(copy)
    results.check()
    assert list(results.records()) == [1]
    assert place.is_dir()
    folder = CampaignFolder(copy)
    with folder.open(measured.plan):
        assert list(folder.records()) == [1]  # so that point 2 is measured again
    left_out, moved = capsys.readouterr().err.splitlines()
    for line in (left_out, moved):
        assert line.startswith("point 2 ")
        assert named in line
    assert f" {aside.parent}," in moved
    assert files_of(aside) == left
    assert not place.exists()


def test_a_damaged_point_is_measured_again_and_both_times_kept(measured: Measured, copy: Path) -> None:
    def record() -> Record:
        kept = CampaignFolder(copy).record(2)
        return {key: value for key, value in kept.items() if key not in ("measured_at", "wall_s")}

    before = record()
    for count in (1, 2):
        multiply(copy / "points/0002")
        assert measured.run(copy) == Done(2, 2, [], 0)
        assert record() == before  # the simulated stand repeats itself
        assert sorted(path.name for path in (copy / "damaged").iterdir()) == ["0002-1", "0002-2"][:count]


def test_a_point_that_is_damaged_while_the_campaign_runs_is_left_out(
    measured: Measured, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    done = measured.run(copy, lambda _: multiply(copy / "points/0002"))
    assert done.measured == 1
    assert [record["number"] for record in json.loads((copy / "index.json").read_text())] == [1]
    assert "point.json" in capsys.readouterr().err


@pytest.mark.parametrize("content", ["", "[]", "{", "[" * 100_000, "\0\0"])
def test_a_plan_that_is_garbage_is_not_called_missing(
    content: str, measured: Measured, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (copy / "campaign.json").write_text(content)
    for command in (["campaign", str(measured.file), "--out"], ["calibrate", "campaign", "--out", str(copy / "m")]):
        assert main([*command, str(copy)]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith(f"error: {copy / 'campaign.json'}: ")
        assert "damaged" in error


@pytest.mark.parametrize("content", ["{}", '{"campaign": {"amplitudes": []}, "scene": {}}'])
def test_a_plan_of_something_else_is_one_line(content: str, copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (copy / "campaign.json").write_text(content)
    assert main(["calibrate", "campaign", str(copy), "--out", str(copy / "m")]) == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert re.search("plan.*version", printed)
