# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bench's parts: domain, output folder, parameters, processes, watch, and the latency of its recorded run."""

import json
import os
import re
import signal
import socket
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from recorded import block, make

from atpid_common.interrupt import Interrupt
from atpid_common.testing import test_every_file_has_its_notice  # noqa: F401  # is a test here too
from atpid_control.recording.session import RecordingSession
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.run import open_run
from atpid_control.runs.topics import BLOCK, DEFAULT, parse
from atpid_control.stand import outdir, parts
from atpid_control.stand.domain import is_quiet, own_domain
from atpid_control.stand.nodes import composition
from atpid_control.stand.parameters import BenchError, NodeDiedError, parameters_in, write_parameters
from atpid_control.stand.processes import Processes
from atpid_control.stand.summary import real_time_factor
from atpid_control.views.report.latency import STAGES, latency_of, summary_line
from atpid_sim.scene import standard_bench

CONTROLLED = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}


def test_two_benches_get_different_domains_and_the_environment_is_put_back() -> None:
    environment = {"ROS_DOMAIN_ID": "7"}
    with own_domain(environment=environment) as first, own_domain(environment=dict(environment)) as second:
        assert first != second
        assert environment["ROS_DOMAIN_ID"] == str(first)
        assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert environment == {"ROS_DOMAIN_ID": "7"}


def test_a_domain_with_a_participant_is_not_quiet_and_one_out_of_range_or_taken_is_refused() -> None:
    with own_domain(environment={}) as domain, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        assert is_quiet(domain)
        participant.bind(("", 7400 + 250 * domain + 10))
        assert not is_quiet(domain)
        for number, said in ((domain, rf"\b{domain}\b.*running"), (400, "400.* 0 .* 232")):
            with pytest.raises(BenchError, match=said), own_domain(number, {}):
                pass


def test_an_earlier_run_is_moved_aside_and_nothing_is_lost(tmp_path: Path) -> None:
    assert outdir.prepare(tmp_path) is None
    for number in (1, 2):
        outdir.mark(tmp_path, tmp_path / "scene.yaml")
        (tmp_path / "bag").mkdir()
        (tmp_path / "bag" / "data.mcap").write_text(str(number))
        assert outdir.prepare(tmp_path) == tmp_path / f"run-000{number}"
        assert not (tmp_path / "bag").exists()
    kept = [(tmp_path / f"run-000{number}" / "bag" / "data.mcap").read_text() for number in (1, 2)]
    assert kept == ["1", "2"]
    assert json.loads((tmp_path / "run-0002" / outdir.MARKER).read_text())["layout"] == 1


def test_a_folder_with_other_files_or_of_another_bench_is_not_changed(tmp_path: Path) -> None:
    file = tmp_path / "thesis.tex"
    file.write_text("mine")
    for place, said in ((tmp_path, r"\(thesis\.tex\)"), (file, "thesis.tex")):
        with pytest.raises(BenchError, match=said):
            outdir.prepare(place)
    assert file.read_text() == "mine"
    with outdir.claimed(tmp_path), pytest.raises(BenchError, match="running"), outdir.claimed(tmp_path):
        pass
    with outdir.claimed(tmp_path):
        pass


@pytest.mark.parametrize(
    ("ceiling", "expected"),
    [
        (CONTROLLED, (0.017, 1.0, 0.3, 0.017)),
        ({"height": 0.2}, (0.017, 0.2, 0.3, 0.2)),
        ({"closed": 0.017, "open": 0.2, "start": 0.2, "end": 0.7}, (0.017, 0.2, 0.366, 0.017)),
    ],
)
def test_the_simulated_ceiling_is_limited_by_the_scene(ceiling: dict[str, object], expected: tuple[float, ...]) -> None:
    found = parts.ceiling_parameters(standard_bench(ceiling=ceiling, duration=1.0))
    assert tuple(found.values()) == pytest.approx(expected)
    assert tuple(found) == ("lowest", "highest", "speed", "initial_height")
    closed = parts.ceiling_parameters(standard_bench(ceiling={"height": 0.017}))
    assert closed["highest"] > closed["lowest"]  # a range with some width


def test_parameters_of_a_node_are_found_under_each_way_to_name_it_and_written_without_anchors(tmp_path: Path) -> None:
    document = {"/**/a_node": {"ros__parameters": {"x": 1}}, "/**": {"ros__parameters": {"y": 2}}, "b_node": {}}
    assert parameters_in(document, "a_node") == {"x": 1, "y": 2}
    both = ["a.yaml", "b.yaml"]  # an anchor is what rcl cannot read
    write_parameters({"a_node": {"files": both}, "b_node": {"files": both}}, tmp_path / "parameters.yaml")
    text = (tmp_path / "parameters.yaml").read_text()
    assert "&" not in text
    assert text.count("b.yaml") == 2


#: Begins as a node does: it handles a signal itself, which is blocked until then, and says when it does.
NODE = """
import os, signal
signal.signal(signal.SIGINT, {handler})
signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT, signal.SIGTERM])
try:
    os.write(1, b'up\\n')
    signal.pause()
except KeyboardInterrupt:
    print('closed')
"""
PAUSE = "import signal; signal.pause()"


def script(text: str) -> list[str]:
    return [sys.executable, "-c", text]


def node(handler: str = "signal.default_int_handler") -> list[str]:
    return script(NODE.format(handler=handler))


def until_up(nodes: Processes, folder: Path, name: str) -> None:
    while "up\n" not in (folder / f"{name}.log").read_text():
        assert nodes[name].status is None


def test_a_node_that_ends_is_named_with_the_reason_and_the_others_are_stopped(tmp_path: Path) -> None:
    ends = "print('hello'); raise SystemExit('error: missing')"
    with Processes([("plant", script(PAUSE)), ("motor_node", script(ends))], tmp_path) as nodes:
        nodes["motor_node"].process.wait()
        with pytest.raises(NodeDiedError, match=r"^motor_node .*\b1: missing "):
            nodes.check(except_for="plant")
    assert nodes["plant"].status is not None


def test_the_motor_is_interrupted_before_anything_else_is_ended(tmp_path: Path) -> None:
    with Processes([("motor_node", node()), ("other", script(PAUSE))], tmp_path) as nodes:
        with nodes.motor_first():
            until_up(nodes, tmp_path, "motor_node")
        assert nodes["motor_node"].process.wait(60.0) == 0
        assert nodes["other"].status is None


def test_a_killed_node_is_reported_with_its_signal_and_what_is_unusual(tmp_path: Path) -> None:
    lines = ["[INFO] [1.0] [plant_node]: begun", "[WARN] [2.0] [plant_node]: odd"]
    log = "\n".join(lines)
    text = f"import os\nprint({log!r}, flush=True)\nos.kill(os.getpid(), 9)"
    with Processes([("plant_node", script(text))], tmp_path) as nodes:
        nodes["plant_node"].process.wait()
        with pytest.raises(NodeDiedError, match=rf"^plant_node .*-9: .*SIGKILL / {re.escape(lines[1])} \(") as died:
            nodes.check("")
    assert lines[0] not in str(died.value)


def test_an_executable_that_is_missing_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="setup"), Processes([("x_node", [str(tmp_path / "x")])], tmp_path):
        pass


def test_stopping_is_not_cut_short_by_a_second_interrupt(tmp_path: Path) -> None:
    text = node("lambda *_: (os.kill(os.getppid(), signal.SIGINT), exit(0))")
    before = signal.getsignal(signal.SIGINT)
    with Processes([("a", text), ("b", text)], tmp_path) as nodes:
        for name in "ab":
            until_up(nodes, tmp_path, name)
    assert [nodes[name].status for name in "ab"] == [0, 0]
    assert signal.getsignal(signal.SIGINT) is before


def test_the_real_time_factor_is_data_over_wall_time() -> None:
    table = SimpleNamespace(rate=None, type=BLOCK, topic="/sensors/laser")
    fields = {"stamp": [0, 4], "first_index": [0, 1], "scans": [1, 1], "rate": [1e9, 1e9], "received": [3e-9, 5e-9]}
    arrays = {name: np.array(values) for name, values in fields.items()}
    bag: Any = SimpleNamespace(result={"real_time_factor": "12.5"}, start_ns=0, tables={"blocks": (table, arrays)})
    assert [real_time_factor(bag, mode) for mode in ("real time", "lockstep")] == [2.0, 12.5]


def test_a_signal_that_comes_after_a_turn_has_looked_for_one_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Turns follow each other hundreds of times a second, so that a signal comes there once in a hundred times."""

    class Late(Interrupt):
        def __exit__(self, *given: object) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            super().__exit__(*given)

    monkeypatch.setattr(composition, "Interrupt", Late)
    with patch.dict(os.environ), composition.watching(lambda _: None) as (_, listen), pytest.raises(KeyboardInterrupt):
        listen()


START, RATE, SCANS = 1_700_000_000_123_456_789, 1000.0, 50
MS = 1_000_000


def recorded(folder: Path, delays: list[tuple[int, int, int]]) -> Path:
    """Record blocks whose messages arrive so many ns after the last sample, the block and the estimate."""
    topics = [type(topic)(f"/{topic.name}", topic.type) for topic in parse(DEFAULT, False)]
    session = RecordingSession(
        folder, new_run(None, clock="real time"), topics, lockstep=False, offered=lambda _topic: (Qos(),)
    )
    for k, (to_block, to_estimate, to_command) in enumerate(delays):
        last = START + round((k * SCANS + SCANS - 1) / RATE * 1e9)
        now = last + to_block
        session.receive("/sensors/laser", block(k * SCANS, np.zeros((SCANS, 2)), RATE, START), now)
        session.receive("/excitation", make("Excitation", last, "plant:laser"), now + to_estimate)
        session.receive("/ceiling/command", make("CeilingCommand", last, "plant:laser"), now + to_estimate + to_command)
    session.close()
    return folder


def test_each_stage_is_measured_from_the_last_sample_on(tmp_path: Path) -> None:
    delays = [(2 * MS, 3 * MS, 1 * MS)] * 198 + [(2 * MS, 40 * MS, 1 * MS), (2 * MS, 3 * MS, 300 * MS)]
    run = open_run(recorded(tmp_path / "bag", delays))
    latency = latency_of(run)
    longest = {"sample_to_block": (2, 2), "block_to_estimate": (3, 40), "estimate_to_command": (1, 300),
               "sample_to_command": (6, 305)}  # fmt: skip
    assert tuple(latency) == STAGES == tuple(longest)
    for name, (usual, most) in longest.items():
        assert latency[name] == pytest.approx({"p50": 1e-3 * usual, "p99": 1e-3 * usual, "max": 1e-3 * most})
    assert re.findall(r"(\d+\.\d)", summary_line(latency)) == ["6.0", "6.0", "305.0", "2.0", "3.0", "1.0"]
    sensors = {name: table for name, table in run.tables.items() if name != "ceiling/command"}
    none = latency_of(replace(run, tables=sensors))
    assert (none, summary_line(none)) == ({}, "")
