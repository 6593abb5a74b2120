# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bench's pure parts: domain, output folder, parameters, processes."""

import json
import signal
import socket
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from atpid_common.middleware import DomainError, named_domain
from atpid_control.commands.bench import stopped
from atpid_control.runs.topics import BLOCK
from atpid_control.stand import outdir, parts
from atpid_control.stand.domain import is_quiet, own_domain
from atpid_control.stand.errors import BenchError, NodeDiedError
from atpid_control.stand.parameters import parameters_in, write_parameters
from atpid_control.stand.processes import Processes
from atpid_control.stand.summary import real_time_factor
from atpid_sim.scene import standard_bench

CONTROLLED = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}


def test_two_benches_get_different_domains_and_the_environment_is_put_back() -> None:
    environment = {"ROS_DOMAIN_ID": "7"}
    with own_domain(environment=environment) as first, own_domain(environment=dict(environment)) as second:
        assert first != second
        assert environment["ROS_DOMAIN_ID"] == str(first)
        assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert environment == {"ROS_DOMAIN_ID": "7"}


def test_a_domain_with_a_participant_is_not_quiet() -> None:
    with own_domain(environment={}) as domain, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        assert is_quiet(domain)
        participant.bind(("", 7400 + 250 * domain + 10))
        assert not is_quiet(domain)


def test_a_domain_out_of_range_or_taken_is_refused() -> None:
    with pytest.raises(BenchError, match="given 400; allowed: 0 to 232"), own_domain(400, {}):
        pass
    with (
        own_domain(environment={}) as taken,
        pytest.raises(BenchError, match=f"ROS domain {taken}: another bench is running there"),
        own_domain(taken, {}),
    ):
        pass


def test_the_domain_the_user_has_set_is_taken() -> None:
    assert named_domain({}) is None
    assert named_domain({"ROS_DOMAIN_ID": ""}) is None
    assert named_domain({"ROS_DOMAIN_ID": "0"}) == 0
    assert named_domain({"ROS_DOMAIN_ID": "77"}) == 77
    for text in ("lab", "-1", "233", "1.5"):
        with pytest.raises(DomainError, match=f"ROS_DOMAIN_ID: given '{text}'; allowed: 0 to 232"):
            named_domain({"ROS_DOMAIN_ID": text})


@pytest.mark.parametrize(
    ("files", "text"),
    [
        ([], "stopped before the recording began; there is no bag"),
        (["bag_0.mcap"], "the bag is not closed: atpid bag repair "),
        (["bag_0.mcap", "metadata.yaml"], "the bag is closed: "),
    ],
)
def test_what_is_left_of_a_run_that_was_stopped(files: list[str], text: str, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    for name in files:
        bag.mkdir(exist_ok=True)
        (bag / name).write_text("")
    assert text in stopped(bag)


def test_an_earlier_run_is_moved_aside_and_nothing_is_lost(tmp_path: Path) -> None:
    assert outdir.prepare(tmp_path) is None
    for number in (1, 2):
        outdir.mark(tmp_path, tmp_path / "scene.yaml")
        (tmp_path / "bag").mkdir()
        (tmp_path / "bag" / "data.mcap").write_text(str(number))
        moved = outdir.prepare(tmp_path)
        assert moved == tmp_path / f"run-000{number}"
        assert not (tmp_path / "bag").exists()
    kept = [(tmp_path / f"run-000{number}" / "bag" / "data.mcap").read_text() for number in (1, 2)]
    assert kept == ["1", "2"]
    assert json.loads((tmp_path / "run-0002" / outdir.MARKER).read_text())["layout"] == 1


def test_a_folder_with_other_files_is_not_changed(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(BenchError, match=r"not the bench's \(thesis.tex\)"):
        outdir.prepare(tmp_path)
    with pytest.raises(BenchError, match=r"File exists|Not a directory"):
        outdir.prepare(tmp_path / "thesis.tex")
    assert (tmp_path / "thesis.tex").read_text() == "mine"


@pytest.mark.parametrize(
    ("ceiling", "expected"),
    [
        ({}, (0.017, 1.0, 0.3, 0.017)),
        ({"height": 0.2}, (0.017, 0.2, 0.3, 0.2)),
        ({"closed": 0.017, "open": 0.2, "start": 0.2, "end": 0.7}, (0.017, 0.2, 0.366, 0.017)),
    ],
)
def test_the_simulated_ceiling_gets_limits_and_speed_from_the_scene(
    ceiling: dict[str, object], expected: dict[str, float]
) -> None:
    scene = standard_bench(ceiling=ceiling or CONTROLLED, duration=1.0)
    found = parts.ceiling_parameters(scene)
    assert tuple(found.values()) == pytest.approx(expected)
    assert tuple(found) == ("lowest", "highest", "speed", "initial_height")


def test_a_closed_damper_gets_a_range_with_some_width() -> None:
    found = parts.ceiling_parameters(standard_bench(ceiling={"height": 0.017}))
    assert found["highest"] > found["lowest"]


def test_parameters_of_a_node_are_found_under_each_way_to_name_it() -> None:
    document = {"/**/a_node": {"ros__parameters": {"x": 1}}, "/**": {"ros__parameters": {"y": 2}}, "b_node": {}}
    assert parameters_in(document, "a_node") == {"x": 1, "y": 2}


def test_a_list_that_stands_twice_is_written_twice(tmp_path: Path) -> None:
    both = ["a.yaml", "b.yaml"]  # an anchor is what rcl cannot read
    write_parameters({"a_node": {"files": both}, "b_node": {"files": both}}, tmp_path / "parameters.yaml")
    text = (tmp_path / "parameters.yaml").read_text()
    assert "&" not in text
    assert text.count("b.yaml") == 2


def script(text: str) -> list[str]:
    return [sys.executable, "-c", f"import signal\n{text}"]


def test_a_node_that_ends_is_named_with_the_reason_and_the_others_are_stopped(tmp_path: Path) -> None:
    commands = [
        ("plant", script("signal.pause()")),
        ("motor_node", script("print('hello'); raise SystemExit('error: no such port')")),
    ]
    said = r"motor_node ended with status 1: no such port "
    with Processes(commands, tmp_path) as nodes:
        nodes["motor_node"].process.wait()
        with pytest.raises(NodeDiedError, match=said):
            nodes.check(except_for="plant")
    assert nodes["plant"].status is not None


def test_nodes_are_interrupted_before_they_are_killed(tmp_path: Path) -> None:
    # as a node does: it handles the signals itself, which are blocked until then
    asks = "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    asks += "signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT, signal.SIGTERM])\n"
    # one write a line, whose end is waited for: `print` to an unbuffered file may be interrupted before the line's end
    text = (
        asks
        + "import os\ntry:\n    os.write(1, b'up\\n'); signal.pause()\nexcept KeyboardInterrupt:\n    print('closed')"
    )
    with Processes([("recorder_node", script(asks + text))], tmp_path) as nodes:
        while "up\n" not in (tmp_path / "recorder_node.log").read_text():
            assert nodes["recorder_node"].status is None
    assert nodes["recorder_node"].reason() == "up / closed"
    assert nodes["recorder_node"].status == 0


def test_the_motor_is_interrupted_before_anything_else_is_ended(tmp_path: Path) -> None:
    motor = "signal.signal(signal.SIGINT, lambda *_: exit(0))\n"
    motor += "signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])\nprint('up', flush=True)\nsignal.pause()"
    with Processes([("motor_node", script(motor)), ("other", script("signal.pause()"))], tmp_path) as nodes:
        with nodes.motor_first():
            while "up" not in (tmp_path / "motor_node.log").read_text():
                assert nodes["motor_node"].status is None
        assert nodes["motor_node"].process.wait(60.0) == 0
        assert nodes["other"].status is None


def test_a_killed_node_is_reported_with_its_signal_and_what_is_unusual(tmp_path: Path) -> None:
    log = "[INFO] [1.0] [plant_node]: begun\n[WARN] [2.0] [plant_node]: odd"
    text = f"import os\nprint({log!r}, flush=True)\nos.kill(os.getpid(), 9)"
    with Processes([("plant_node", script(text))], tmp_path) as nodes:
        nodes["plant_node"].process.wait()
        expected = r"plant_node ended with status -9: by SIGKILL / \[WARN\] \[2.0\] \[plant_node\]: odd \(whole log"
        with pytest.raises(NodeDiedError, match=expected):
            nodes.check("")


def test_an_executable_that_is_missing_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="make setup"), Processes([("x_node", [str(tmp_path / "x")])], tmp_path):
        pass


def test_stopping_is_not_cut_short_by_a_second_interrupt(tmp_path: Path) -> None:
    answer = "lambda *_: (os.kill(os.getppid(), signal.SIGINT), exit(0))"
    text = f"import os\nsignal.signal(signal.SIGINT, {answer})\nprint('up', flush=True)\nsignal.pause()"
    before = signal.getsignal(signal.SIGINT)
    with Processes([("a", script(text)), ("b", script(text))], tmp_path) as nodes:
        for name in "ab":
            while "up" not in (tmp_path / f"{name}.log").read_text():
                assert nodes[name].status is None
    assert [nodes[name].status for name in "ab"] == [0, 0]
    assert signal.getsignal(signal.SIGINT) is before


def test_the_real_time_factor_is_data_over_wall_time() -> None:
    table = SimpleNamespace(rate=None, type=BLOCK, topic="/sensors/laser")
    fields = {"stamp": [0, 4], "first_index": [0, 1], "scans": [1, 1], "rate": [1e9, 1e9], "received": [3e-9, 5e-9]}
    arrays = {name: np.array(values) for name, values in fields.items()}
    bag: Any = SimpleNamespace(result={"real_time_factor": "12.5"}, start_ns=0, tables={"blocks": (table, arrays)})
    assert real_time_factor(bag, "real time") == 2.0
    assert real_time_factor(bag, "lockstep") == 12.5


def test_two_benches_do_not_share_a_folder(tmp_path: Path) -> None:
    said = "another bench is running"
    with outdir.claimed(tmp_path), pytest.raises(BenchError, match=said), outdir.claimed(tmp_path):
        pass
    with outdir.claimed(tmp_path):
        pass
