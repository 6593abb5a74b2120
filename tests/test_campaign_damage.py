# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A campaign's points that were damaged after they were measured: named, set aside, measured again, or left out."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from documented import ROOT

from atpid_control.campaign.folder import CampaignFolder, Record
from atpid_control.campaign.plan import Campaign, read_campaign
from atpid_control.campaign.run import Done, run_campaign
from atpid_control.campaign.stands import SimulatedStand
from atpid_control.cli import main
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import Progress

CAMPAIGN: dict[str, Any] = {
    "scene": str(ROOT / "scenes/thesis_4_3.yaml"),
    "amplitudes": [0.01],
    "frequency_ratios": [0.96, 1.0],
    "heights": ["closed"],
    "rules": {"measure_periods": 10},
}


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
        """Measure what is missing in a folder."""
        folder, stand = CampaignFolder(out), SimulatedStand(self.campaign, self.scene)
        with folder.open(self.plan):
            return run_campaign(self.campaign, self.scene, folder, lambda _: stand, progress, lambda: False)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Measured:
    place = tmp_path_factory.mktemp("measured")
    (place / "campaign.yaml").write_text(yaml.safe_dump(CAMPAIGN), encoding="utf-8")
    made = Measured(place / "campaign.yaml", *read_campaign(place / "campaign.yaml"), place / "out")
    assert made.run(made.out).measured == 2
    return made


@pytest.fixture
def copy(measured: Measured, tmp_path: Path) -> Path:
    """Return a copy of the campaign's folder."""
    shutil.copytree(measured.out, tmp_path / "out")
    return tmp_path / "out"


def cut(path: Path, length: int) -> None:
    path.write_bytes(path.read_bytes()[:length])


def change_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def replace_by_other(place: Path) -> None:
    shutil.rmtree(place)
    shutil.copytree(place.with_name("0001"), place)


def multiply(path: Path) -> None:
    record = json.loads(path.read_text())
    larger = {key: 1.5 * value if isinstance(value, float) else value for key, value in record.items()}
    path.write_text(json.dumps(larger, indent=1) + "\n")


#: What is done to the folder of point 2, and what is said of it.
DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "bag removed": (lambda place: shutil.rmtree(place / "bag"), "bag_0.mcap: no such file"),
    "bag cut": (lambda place: cut(place / "bag/bag_0.mcap", 5000), "bag/bag_0.mcap: not as measured"),
    "a byte of the bag": (lambda place: change_byte(place / "bag/bag_0.mcap"), "bag/bag_0.mcap: not as measured"),
    "a byte of the metadata": (lambda place: change_byte(place / "bag/metadata.yaml"), "bag/metadata.yaml: not as"),
    "a byte of the record": (lambda place: change_byte(place / "point.json"), ""),
    "a byte of the scene": (lambda place: change_byte(place / "scene.yaml"), "scene.yaml: not as measured"),
    "another point's": (replace_by_other, "it is point 1"),
    "another point's bag": (
        lambda place: shutil.copy(place.with_name("0001") / "bag/bag_0.mcap", place / "bag/bag_0.mcap"),
        "bag/bag_0.mcap: not as measured",
    ),
    "numbers times 1.5": (lambda place: multiply(place / "point.json"), "point.json: not as measured"),
    "record cut": (lambda place: cut(place / "point.json", 200), "point.json: is cut or damaged"),
    "record empty": (lambda place: cut(place / "point.json", 0), "point.json: is cut or damaged"),
    "record removed": (lambda place: (place / "point.json").unlink(), "point.json: no such file"),
    "digests cut": (lambda place: cut(place / "digests.json", 100), "digests.json: is cut or damaged"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_point_is_named_and_set_aside_whole(
    damage: str, measured: Measured, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    act, words = DAMAGES[damage]
    act(copy / "points/0002")
    left = {path.name: path.read_bytes() for path in (copy / "points/0002").iterdir() if path.is_file()}
    folder = CampaignFolder(copy)
    with folder.open(measured.plan):
        assert list(folder.records()) == [1]  # so that point 2 is measured again
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("point 2 is damaged: ")
    assert words in line
    assert line.endswith(f"moved to {copy / 'damaged'}, measured again")
    aside = copy / "damaged/0002-1"
    assert {path.name: path.read_bytes() for path in aside.iterdir() if path.is_file()} == left
    assert not (copy / "points/0002").exists()


@pytest.mark.parametrize("damage", DAMAGES)
def test_results_leave_a_damaged_point_out(damage: str, copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    act, words = DAMAGES[damage]
    act(copy / "points/0002")
    folder = CampaignFolder(copy)
    folder.check()
    assert list(folder.records()) == [1]
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert line.endswith("left out; the same `atpid campaign` measures it again")
    assert (copy / "points/0002").is_dir()


def test_a_damaged_point_is_measured_again_and_both_times_kept(measured: Measured, copy: Path) -> None:
    def record() -> Record:
        kept = CampaignFolder(copy).record(2)
        return {key: value for key, value in kept.items() if key not in ("measured_at", "wall_s")}

    before = record()
    for count in (1, 2):
        multiply(copy / "points/0002/point.json")
        assert measured.run(copy) == Done(2, 2, [], 0)
        assert record() == before  # the simulated stand repeats itself
        assert sorted(path.name for path in (copy / "damaged").iterdir()) == ["0002-1", "0002-2"][:count]


def test_a_point_that_is_damaged_while_the_campaign_runs_is_left_out(
    measured: Measured, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    done = measured.run(copy, lambda _: multiply(copy / "points/0002/point.json"))
    assert done.measured == 1
    assert [record["number"] for record in json.loads((copy / "index.json").read_text())] == [1]
    assert "point.json: not as measured; left out" in capsys.readouterr().err


def test_the_model_and_its_table_are_without_a_damaged_point(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut(copy / "points/0002/point.json", 0)
    assert main(["calibrate", "campaign", str(copy), "--out", str(tmp_path / "model")]) == 0
    assert "point 2 is damaged" in capsys.readouterr().err
    found = json.loads((tmp_path / "model/agreement.json").read_text())
    assert [point["number"] for point in found["points"]] == [1]


def test_points_of_older_versions_are_read_and_said_to_be_unchecked(
    measured: Measured, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (copy / "points/0002/digests.json").unlink()
    folder = CampaignFolder(copy)
    with folder.open(measured.plan):
        assert list(folder.records()) == [1, 2]
    assert capsys.readouterr().err == (
        "note: 1 points have no digests.json, which older versions did not write: not checked\n"
    )
    assert list((copy / "damaged").iterdir()) == []


@pytest.mark.parametrize("content", ["", "[]", "{", "[" * 100_000, "9" * 5000, "\0\0"])
def test_a_plan_that_is_garbage_is_not_called_missing(
    content: str, measured: Measured, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (copy / "campaign.json").write_text(content)
    for command in (["campaign", str(measured.file), "--out"], ["calibrate", "campaign", "--out", str(copy / "m")]):
        assert main([*command, str(copy)]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error == f"error: {copy / 'campaign.json'}: is cut or damaged; copy one of the same campaign there"


@pytest.mark.parametrize(
    "content", ["{}", '{"campaign": 1, "scene": 2}', '{"campaign": {"amplitudes": []}, "scene": {}}']
)
def test_a_plan_of_something_else_is_one_line(content: str, copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (copy / "campaign.json").write_text(content)
    assert main(["calibrate", "campaign", str(copy), "--out", str(copy / "m")]) == 2
    assert "its plan is damaged, or of another version" in capsys.readouterr().err
