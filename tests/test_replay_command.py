# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid replay`: the bag's own parameters, older definitions converted, and what differs listed."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer
from rclpy.serialization import deserialize_message
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.cli import main
from atpid_control.nodes.bag_qos import class_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.parts import find_parts
from atpid_control.runs.playback import compare, load_playback
from atpid_control.runs.read import open_bag
from atpid_control.runs.records import records
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.stand.parameters import parameters_in
from atpid_control.stand.replay_files import write_replay_files

BAG = Path(__file__).resolve().parent.parent / "bags" / "thesis_4_3_short"
BLOCKS = "/sensors/laser"


#: Bags with older definitions are made from one with today's: fields are taken out or renamed.
Change = Callable[[str], str]


def without_handshake(definition: str) -> str:
    """Return the definition as it was before messages had the field `handshake`."""
    return "\n".join(line for line in definition.splitlines() if not line.startswith("bool handshake"))


def older(bag: Path, folder: Path, change: Change = without_handshake, files: dict[str, bytes] | None = None) -> Path:
    """Write `bag` to `folder` with the definitions that `change` returns; `files` replaces those kept in it."""
    shutil.copytree(bag, folder)
    file, opened = find_parts(bag)[0], open_bag(bag)
    store = get_typestore(Stores.EMPTY)
    names: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    made: dict[int, int] = {}
    with find_parts(folder)[0].open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        for record in records(file):
            if isinstance(record, Header):
                writer.start(profile=record.profile, library=record.library)
            elif isinstance(record, Schema) and record.id not in names:
                text = change(record.data.decode())
                found = get_types_from_msg(text, record.name)
                store.register({name: fields for name, fields in found.items() if name not in store.fielddefs})
                names[record.id] = record.name
                made[record.id] = writer.register_schema(record.name, record.encoding, text.encode())
            elif isinstance(record, Channel) and record.id not in channels:
                channels[record.id] = record
                described = record.metadata | {"topic_type_hash": f"RIHS01_{'0' * 64}"}
                writer.register_channel(record.topic, "cdr", made[record.schema_id], described)
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                message = opened.decoder.decode(channel.schema_id, record.data)
                name = names[channel.schema_id]
                data = store.serialize_cdr(_filled(store, name, message), name)
                writer.add_message(record.channel_id, record.log_time, bytes(data), record.publish_time)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Attachment) and files is None:
                writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        for name, content in (files or {}).items():
            writer.add_attachment(0, 0, name, "application/octet-stream", content)
        writer.finish()  # type: ignore[no-untyped-call]
    return folder


def _filled(store: Any, name: str, message: Any) -> Any:
    values = {}
    for field, (kind, described) in store.fielddefs[name][1]:
        value = getattr(message, field, 0)
        if kind == Nodetype.NAME:
            value = _filled(store, described, value)
        elif described[0] == "string":
            value = str(value)
        values[field] = value
    return store.types[name](**values)


def with_parameters(bag: Path, **changes: Any) -> dict[str, bytes]:
    """Return the files kept in `bag`, with parameters of selector_node changed; None takes one out."""
    kept = dict(open_bag(bag).files)
    document = yaml.safe_load(kept["parameters.yaml"])
    (block,) = (entry["ros__parameters"] for key, entry in document.items() if key.endswith("selector_node"))
    block.update(changes)
    for name in [name for name, value in changes.items() if value is None]:
        del block[name]
    kept["parameters.yaml"] = yaml.safe_dump(document).encode()
    return kept


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recorded bag with the definitions of before the field `handshake`."""
    return older(BAG, tmp_path_factory.mktemp("older") / "bag")


def parameters_of(files: Any, node: str) -> dict[str, Any]:
    return parameters_in(yaml.safe_load(files.parameters.read_text()), node)


def test_an_older_bag_is_replayed_with_its_own_parameters(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Estimates are its own; with a dead band as wide as the change of the excitation the ceiling stays where it is.

    That its messages are those of today is tested below, that those give the recorded commands in test_replay.py.
    """
    changed = older(BAG, tmp_path / "bag", without_handshake, with_parameters(BAG, dead_band=0.5))
    assert main(["replay", str(changed), "--out", str(tmp_path / "out")]) == 0
    printed, reported = capfd.readouterr()
    lines = dict(line.split(": ", 1) for line in printed.splitlines() if line.startswith("/"))
    assert lines["/excitation"].split()[:3] == ["160", "of", "160"]
    agreeing = int(lines["/ceiling/command"].split()[0])
    assert agreeing < 160
    assert "difference" in lines["/ceiling/command"]
    assert sum("SampleBlock" in line and "handshake" in line for line in reported.splitlines()) == 1
    summary = json.loads((tmp_path / "out" / "replay.json").read_text())
    assert [topic["agreeing"] for topic in summary["topics"]] == [160, agreeing]
    again = open_bag(tmp_path / "out" / "bag")
    assert len({message.height for _, message in again.messages("/ceiling/command")}) > 1
    assert next(event.kind for _, event in again.messages("/events")) == "started"
    verify(tmp_path / "out" / "bag")


def test_the_parameters_of_the_bag_are_those_of_the_replay(tmp_path: Path) -> None:
    changed = older(BAG, tmp_path / "bag", str, with_parameters(BAG, margin=1.25, sigmas=5.0))
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


def notes_of(folder: Path, files: dict[str, bytes]) -> tuple[str, ...]:
    """Return where a replay of the bag with these files in it differs from the run."""
    return write_replay_files(older(BAG, folder / "bag", str, files), folder / "kept").notes


def test_what_cannot_be_as_it_was_is_listed_parameter_by_parameter(tmp_path: Path) -> None:
    notes = notes_of(tmp_path / "changed", with_parameters(BAG, dead_band=None, wisdom=3))
    assert [note.split()[:2] for note in notes if "dead_band" in note] == [["selector_node:", "dead_band"]]
    assert any({"dead_band", "0.01"} <= set(note.replace(",", "").split()) for note in notes)
    assert any({"wisdom", "3"} <= set(note.split()) for note in notes)
    kept = {name: data for name, data in open_bag(BAG).files.items() if name != "parameters.yaml"}
    (note,) = [note for note in notes_of(tmp_path / "without", kept) if note.startswith("selector_node: ")]
    assert {"dead_band 0.01", "margin 3.0"} <= set(note.rpartition(": ")[2].split(", "))


def test_what_a_node_reported_to_the_recorder_counts_more_than_its_file(tmp_path: Path) -> None:
    own = {"/**/selector_node": {"ros__parameters": {"margin": 2.5}}}
    kept = with_parameters(BAG, margin=1.0) | {"selector_node.yaml": yaml.safe_dump(own).encode()}
    files = write_replay_files(older(BAG, tmp_path / "bag", str, kept), tmp_path / "kept")
    assert parameters_of(files, "selector_node")["margin"] == 2.5


@pytest.mark.parametrize(("ending", "option"), [("scene.yaml", "--scene"), (".npz", "--map")])
def test_a_file_the_bag_does_not_keep_is_asked_for(tmp_path: Path, ending: str, option: str) -> None:
    kept = {name: data for name, data in open_bag(BAG).files.items() if not name.endswith(ending)}
    bag = older(BAG, tmp_path / "bag", str, kept)
    with pytest.raises(BagError, match=rf"^[^\n]*\({option}\)$|^[^\n]*{option}[^\n]*$"):
        write_replay_files(bag, tmp_path / "kept")


def test_a_message_that_cannot_be_converted_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = older(BAG, tmp_path / "bag", lambda text: text.replace("uint64 first_index", "string first_index"))
    with pytest.raises(BagError, match=r"first_index of .*SampleBlock.* string.* uint64"):
        load_playback(bag, ["sensors/*"])
    assert main(["replay", str(bag), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_whatever_reads_bags_reads_older_ones(old: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
    assert {"device", "header.frame_id"} <= set(note.split())
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
    assert {"handshake", "backlog", "later"} <= set(note.split())


def test_the_comparison_finds_what_differs(tmp_path: Path) -> None:
    before = open_run(BAG)
    assert [(found.agreeing, found.first_difference) for found in compare(before, before)] == [(160, ""), (160, "")]
    after = replace(before, tables={name: one for name, one in before.tables.items() if name != "ceiling/command"})
    commands = next(found for found in compare(before, after) if found.topic == "/ceiling/command")
    assert (commands.recorded, commands.agreeing) == (160, 0)
    assert {"0.000", "no", "answer"} <= set(commands.first_difference.split())


@pytest.mark.parametrize("rate", ["-1", "fast", "nan"])
def test_an_impossible_rate_is_refused(rate: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(BAG), "--out", str(tmp_path), "--rate", rate]) == 2
    assert {rate, "0", "1000"} <= set(re.findall(r"[\w-]+", capsys.readouterr().err))
