# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid replay`: the bag's own parameters, older definitions converted, and what differs listed."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from older_bags import older, with_parameters, without_handshake
from rclpy.serialization import deserialize_message

from atpid_control.cli import main
from atpid_control.commands.replay import namespace_of
from atpid_control.nodes.bag_qos import class_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.playback import compare, load_playback
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.stand.parameters import parameters_in
from atpid_control.stand.replay_files import write_replay_files

pytestmark = pytest.mark.slow

BAG = Path(__file__).resolve().parent.parent / "bags" / "thesis_4_3_short"
BLOCKS = "/sensors/laser"


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recorded bag with the definitions of before the field `handshake`."""
    return older(BAG, tmp_path_factory.mktemp("older") / "bag")


def parameters_of(files: Any, node: str) -> dict[str, Any]:
    return parameters_in(yaml.safe_load(files.parameters.read_text()), node)


def test_a_bag_of_older_definitions_is_replayed_with_its_own_parameters(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Estimates are its own; with a dead band as wide as the change of the excitation the ceiling stays where it is.

    That its messages are those of today is tested below, that those give the recorded commands in test_replay.py.
    """
    changed = older(BAG, tmp_path / "bag", without_handshake, with_parameters(BAG, dead_band=0.5))
    assert main(["replay", str(changed), "--out", str(tmp_path / "out")]) == 0
    printed, reported = capfd.readouterr()
    assert "/excitation: 160 of 160 agree\n" in printed
    line = next(line for line in printed.splitlines() if line.startswith("/ceiling/command: "))
    agreeing = int(line.split()[1])
    assert agreeing < 160
    assert "first difference: " in line
    assert " is now " in line
    line = "SampleBlock was recorded with another definition"
    assert sum(line in text for text in reported.splitlines()) == 1
    assert "handshake is not in the bag and keeps its default" in reported
    summary = json.loads((tmp_path / "out" / "replay.json").read_text())
    assert [topic["agreeing"] for topic in summary["topics"]] == [160, agreeing]
    again = open_bag(tmp_path / "out" / "bag")
    assert len({message.height for _, message in again.messages("/ceiling/command")}) > 1
    assert next(event.kind for _, event in again.messages("/events")) == "started"
    verify(tmp_path / "out" / "bag")


def test_the_parameters_of_the_bag_are_those_of_the_replay(tmp_path: Path) -> None:
    changed = older(BAG, tmp_path / "bag", lambda text: text, with_parameters(BAG, margin=1.25, sigmas=5.0))
    files = write_replay_files(changed, tmp_path / "kept", record=tmp_path / "again", rate=2.0)
    selector = parameters_of(files, "selector_node")
    assert (selector["margin"], selector["sigmas"]) == (1.25, 5.0)
    assert selector["scene"] == str(tmp_path / "kept" / "scene.yaml")
    assert selector["lockstep"] is True
    assert selector["map"] == str(files.height_map)
    assert Path(selector["map"]).read_bytes() == open_bag(BAG).files[Path(selector["map"]).name]
    replay = parameters_of(files, "replay_node")
    assert (replay["bag"], replay["rate"], replay["expect_recorder"]) == (str(changed), 2.0, True)
    assert parameters_of(files, "recorder_node")["bag"] == str(tmp_path / "again")


def test_what_cannot_be_as_it_was_is_listed_parameter_by_parameter(tmp_path: Path) -> None:
    files = with_parameters(BAG, dead_band=None, wisdom=3)
    changed = older(BAG, tmp_path / "bag", lambda text: text, files)
    notes = write_replay_files(changed, tmp_path / "kept").notes
    assert "selector_node: dead_band is not in the bag, 0.01 is used" in notes
    assert "selector_node: wisdom was 3 and does not exist any more" in notes


def test_a_bag_without_parameters_lists_those_that_are_used(tmp_path: Path) -> None:
    kept = {name: data for name, data in open_bag(BAG).files.items() if name != "parameters.yaml"}
    notes = write_replay_files(older(BAG, tmp_path / "bag", lambda text: text, kept), tmp_path / "kept").notes
    line = next(line for line in notes if line.startswith("selector_node: the bag keeps none of its parameters"))
    assert "dead_band 0.01" in line
    assert "margin " in line


def test_what_a_node_reported_to_the_recorder_counts_more_than_its_file(tmp_path: Path) -> None:
    own = {"/**/selector_node": {"ros__parameters": {"margin": 2.5}}}
    kept = with_parameters(BAG, margin=1.0) | {"selector_node.yaml": yaml.safe_dump(own).encode()}
    files = write_replay_files(older(BAG, tmp_path / "bag", lambda text: text, kept), tmp_path / "kept")
    assert parameters_of(files, "selector_node")["margin"] == 2.5


def test_every_parameter_of_the_nodes_is_one_the_replay_can_name(tmp_path: Path) -> None:
    """Otherwise a parameter that exists would be reported as unknown."""
    import rclpy
    from rclpy.parameter import Parameter

    from atpid_control.stand.nodes.composition import node_class
    from atpid_control.stand.replay_files import IDENTIFIER, SELECTOR

    files = write_replay_files(BAG, tmp_path / "kept")
    rclpy.init()
    try:
        for part in (IDENTIFIER, SELECTOR):
            overrides = [Parameter(key, value=value) for key, value in parameters_of(files, part.name).items()]
            node = node_class(part.package, part.name)(parameter_overrides=overrides)
            declared = set(node.get_parameters_by_prefix("")) - {"use_sim_time", "start_type_description_service"}
            node.close()
            node.destroy_node()
            assert declared <= {*part.configured(), "scene", "map", "lockstep", "method"}
    finally:
        rclpy.try_shutdown()


@pytest.mark.parametrize(
    ("ending", "words"), [("scene.yaml", "no scene is kept.*--scene"), (".npz", "not kept.*--map")]
)
def test_a_file_the_bag_does_not_keep_is_asked_for(tmp_path: Path, ending: str, words: str) -> None:
    kept = {name: data for name, data in open_bag(BAG).files.items() if not name.endswith(ending)}
    bag = older(BAG, tmp_path / "bag", lambda text: text, kept)
    with pytest.raises(BagError, match=words) as caught:
        write_replay_files(bag, tmp_path / "kept")
    assert "\n" not in str(caught.value)


def test_a_message_that_cannot_be_converted_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def renamed(definition: str) -> str:
        return definition.replace("uint64 first_index", "string first_index")

    bag = older(BAG, tmp_path / "bag", renamed)
    with pytest.raises(
        BagError, match=r"field first_index of .*SampleBlock was recorded as string, installed is uint64"
    ):
        load_playback(bag, ["sensors/*"])
    assert main(["replay", str(bag), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_everything_that_reads_bags_reads_older_ones(
    old: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verify(old).by_topic[BLOCKS] == 160
    assert main(["bag", "extract", str(old), "--out", str(tmp_path / "kept")]) == 0
    assert main(["bag", "extract", str(old), "--out", str(tmp_path / "kept"), "--support", "1:2"]) == 0
    assert main(["bag", "report", str(old), "--out", str(tmp_path / "report")]) == 0
    assert (tmp_path / "report" / "report.html").is_file()
    command = ["calibrate", "beam", str(old), "--moving-mass", "0.362", "--grain-mass", "0.0362"]
    status = main(command)
    assert status == main([*command[:2], str(BAG), *command[3:]])
    before, after = (next(bag.messages(BLOCKS))[1] for bag in map(open_bag, (old, BAG)))
    assert not hasattr(before, "handshake")
    assert after.handshake is False
    assert np.array_equal(before.data, after.data)


def test_converted_messages_are_those_that_are_recorded_today(old: Path) -> None:
    """Field by field, so that the loop cannot tell an older bag; bytes that only fill are not compared."""
    patterns = ["sensors/*", "ceiling/state"]
    converted, recorded = load_playback(old, patterns), load_playback(BAG, patterns)
    assert len(converted.notes) == 2
    (note,) = recorded.notes  # the bag is older than the field `device`
    assert note.endswith("is converted: device was recorded as header.frame_id")
    assert [item.answer_ns for item in converted.items] == [item.answer_ns for item in recorded.items]
    for one, other in zip(converted.items, recorded.items, strict=True):
        kind = class_of(recorded.topics[other.topic])
        assert deserialize_message(one.data, kind) == deserialize_message(other.data, kind)


def test_fields_in_another_order_are_converted_too(tmp_path: Path) -> None:
    def reordered(definition: str) -> str:
        text = without_handshake(definition)
        return text.replace("uint64 dropped", "uint64 later").replace("uint64 backlog", "uint64 dropped")

    playback = load_playback(older(BAG, tmp_path / "bag", reordered), ["sensors/*"])
    (note,) = playback.notes
    assert "handshake is not in the bag" in note
    assert "backlog is not in the bag" in note
    assert "later is left out" in note


def test_the_comparison_finds_what_differs(tmp_path: Path) -> None:
    before = open_run(BAG)
    assert [(found.agreeing, found.first_difference) for found in compare(before, before)] == [(160, ""), (160, "")]
    after = replace(before, tables={name: one for name, one in before.tables.items() if name != "ceiling/command"})
    commands = next(found for found in compare(before, after) if found.topic == "/ceiling/command")
    assert (commands.recorded, commands.agreeing) == (160, 0)
    assert commands.first_difference == "0.000 s after the first, no answer"


def test_a_namespace_is_that_of_the_bag(old: Path) -> None:
    bag = open_bag(old)
    assert namespace_of(bag) == ""
    bag.types = {f"/stand{topic}": kind for topic, kind in bag.types.items()}
    assert namespace_of(bag) == "/stand"


@pytest.mark.parametrize("rate", ["-1", "fast", "nan"])
def test_an_impossible_rate_is_refused(rate: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(BAG), "--out", str(tmp_path), "--rate", rate]) == 2
    assert f"given {rate}; allowed: 0 to 1000" in capsys.readouterr().err
