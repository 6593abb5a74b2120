# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The acquisition nodes: lifecycle, handshake, messages, diagnostics, and every fault by name."""

import math
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from acquisition_bench import TIMEOUT, Bench
from atpid_interfaces.msg import CeilingState, Event, RecorderStatus
from lifecycle_msgs.msg import State

from atpid_driver.nodes.acquisition_node import AcquisitionNode
from atpid_driver.nodes.labjack_node import LabJackNode
from atpid_driver.nodes.ni_node import NiNode
from atpid_driver.standins import Control, build

pytestmark = pytest.mark.slow

LIBRARIES = build()


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


@pytest.fixture
def t7(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    control = Control(tmp_path / "t7")
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(control.path))
    monkeypatch.setenv("ATPID_LJM_SOURCE", "sine")
    yield control
    control.close()


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    control = Control(tmp_path / "module")
    monkeypatch.setenv("ATPID_DAQMX_CONTROL", str(control.path))
    monkeypatch.setenv("ATPID_DAQMX_SOURCE", "sine:offset=0,amplitude=0.5,frequency=50")
    yield control
    control.close()


def laser(**changes: object) -> dict[str, object]:
    values: dict[str, object] = {
        "rate": 1000.0,
        "channels": ["support_displacement", "beam_displacement"],
        "terminals": ["AIN0", "AIN1"],
        "calibrations": ["laser_support.yaml", "laser_beam.yaml"],
        "library": str(LIBRARIES / "libLabJackM.so"),
        "handshake": False,
    }
    return values | changes


def acceleration(**changes: object) -> dict[str, object]:
    values: dict[str, object] = {
        "rate": 1280.0,
        "channels": ["beam_acceleration"],
        "terminals": ["ai0"],
        "kinds": ["iepe"],
        "calibrations": ["accelerometer.yaml"],
        "library": str(LIBRARIES / "libnidaqmx.so"),
        "blocks_per_second": 20.0,
        "handshake": False,
    }
    return values | changes


def label(node: AcquisitionNode) -> str:
    return str(node._state_machine.current_state[1])


def test_laser_blocks_are_metres_with_true_stamps_and_skew(bench: Bench, t7: Control) -> None:
    bench.start(LabJackNode, **laser(serial=470012345))
    began = time.time()
    bench.until(lambda: len(bench.blocks) >= 5)
    first, second = bench.blocks[:2]
    assert (first.device, first.header.frame_id) == ("labjack:470012345", "stand")
    assert second.first_index == first.first_index + 50
    assert first.rate == 1000.0
    assert list(first.channels) == ["support_displacement", "beam_displacement"]
    assert list(first.units) == ["m", "m"]
    assert list(first.skew) == [0.0, 15e-6]
    assert abs(first.header.stamp.sec - began) < 5.0
    step = (second.header.stamp.sec - first.header.stamp.sec) * 10**9
    assert step + second.header.stamp.nanosec - first.header.stamp.nanosec == 50_000_000
    data = np.frombuffer(first.data).reshape(-1, 2)
    seconds = (first.first_index + np.arange(50))[:, None] / 1000.0 + np.array([0.0, 15e-6])
    expected = 0.075 * np.sin(2 * np.pi * 5.0 * seconds + np.array([0.0, np.pi / 4]))
    assert np.abs(data - expected).max() < 1e-9
    (started,) = (event for event in bench.events if event.kind == Event.STARTED)
    assert started.text == "labjack:470012345 streams 2 channels at 1000 Hz"
    assert started.header.stamp == first.header.stamp


def test_accelerations_are_metres_per_second_squared(bench: Bench, module: Control) -> None:
    bench.start(NiNode, **acceleration())
    bench.until(lambda: len(bench.blocks) >= 3)
    block = bench.blocks[0]
    assert list(block.units) == ["m/s^2"]
    assert np.abs(np.frombuffer(block.data)).max() == pytest.approx(490.3325, rel=1e-3)


def test_a_handshake_precedes_the_first_sample(bench: Bench, t7: Control) -> None:
    node = bench.start(LabJackNode, **laser(handshake=True, expect_recorder=True))
    bench.until(lambda: len(bench.handshakes) >= 3 and any(event.handshake for event in bench.events))
    assert list(bench.handshakes[0].units) == ["m", "m"]
    assert len(bench.handshakes[0].data) == 0
    assert bench.handshakes[0].header.stamp.sec == 0
    answer = CeilingState()
    answer.handshake = True
    bench.state.publish(answer)
    topics = ["/sensors/laser", "/excitation", "/diagnostics"]
    bench.recorder.publish(RecorderStatus(recording=True, topics=topics, received=[2, 0, 0], written=[0, 0, 0]))
    bench.until(lambda: node._handshake is not None and "excitation" in node._handshake.waiting_for())
    assert not bench.blocks
    bench.recorder.publish(
        RecorderStatus(recording=True, topics=topics, received=[2, 1, 0], written=[0, 0, 0])
    )  # diagnostics are not in the loop
    bench.until(lambda: bench.blocks)
    assert bench.blocks[0].first_index == 0
    count = len(bench.handshakes)
    bench.until(lambda: len(bench.blocks) >= 5)
    assert len(bench.handshakes) == count


def test_an_answer_that_is_no_handshake_starts_nothing(bench: Bench, t7: Control) -> None:
    node = bench.start(LabJackNode, **laser(handshake=True))
    bench.until(lambda: len(bench.handshakes) >= 1)
    answer = CeilingState()
    answer.header.frame_id = "motor_node"
    bench.state.publish(answer)
    seen = len(bench.handshakes)
    bench.until(lambda: len(bench.handshakes) >= seen + 4)
    assert node._handshake is not None
    assert not bench.blocks


def test_life_by_hand(bench: Bench, t7: Control) -> None:
    node = bench.start(LabJackNode, **laser(autostart=False))
    assert label(node) == "unconfigured"
    node.trigger_configure()
    assert label(node) == "inactive"
    node.trigger_activate()
    bench.until(lambda: len(bench.blocks) >= 2)
    node.trigger_deactivate()
    assert label(node) == "inactive"
    assert node._state_machine.current_state[0] == State.PRIMARY_STATE_INACTIVE
    bench.until(lambda: any(status.message == "connected" for status in bench.diagnostics))
    bench.blocks.clear()
    node.trigger_activate()
    bench.until(lambda: bench.blocks)
    assert bench.blocks[0].first_index == 0  # a new stream
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert label(node) == "unconfigured"


def test_diagnostics_come_while_nothing_streams(bench: Bench, t7: Control) -> None:
    bench.start(LabJackNode, **laser(autostart=False))
    bench.until(lambda: bench.diagnostics)
    status = bench.diagnostics[-1]
    assert (status.name, status.hardware_id) == ("labjack_node: acquisition", "none")
    assert status.message == "no device"


def test_diagnostics_carry_serial_rate_backlog_drops_and_drift(bench: Bench, t7: Control) -> None:
    bench.start(LabJackNode, **laser())
    bench.until(lambda: any("streaming" in status.message for status in bench.diagnostics))
    status = bench.diagnostics[-1]
    assert status.hardware_id == "470012345"
    values = {pair.key: pair.value for pair in status.values}
    assert float(values["rate [Hz]"]) == 1000.0
    assert math.isfinite(float(values["backlog [scans]"]))
    names = {"dropped [scans]", "last error", "clock drift [ppm]", "clock offset [s]", "next index", "interruptions"}
    assert names <= values.keys()
    t7.drop(40)
    bench.until(lambda: bench.has_event("40 scans lost"))
    bench.until(lambda: any(block.dropped == 40 for block in bench.blocks))
    bench.until(lambda: any("scans lost in the last second" in status.message for status in bench.diagnostics))


@pytest.mark.parametrize(
    ("kind", "parameters", "control"), [(LabJackNode, laser, "t7"), (NiNode, acceleration, "module")]
)
def test_missing_then_plugged_in_then_pulled_then_plugged_in_again(
    bench: Bench,
    kind: type[AcquisitionNode],
    parameters: Callable[[], dict[str, object]],
    control: str,
    request: pytest.FixtureRequest,
) -> None:
    device: Control = request.getfixturevalue(control)
    device.unplug()
    node = bench.start(kind, **parameters())
    bench.until(lambda: bench.has_event("cannot configure"))
    assert label(node) == "unconfigured"
    device.replug()
    bench.until(lambda: len(bench.blocks) >= 2)
    device.unplug()
    bench.until(lambda: bench.has_event("trying again"))
    device.replug()
    bench.until(lambda: bench.has_event("streaming again"))
    count = len(bench.blocks)
    bench.until(lambda: len(bench.blocks) > count + 1)
    faults = [event.text for event in bench.events if event.kind == "fault"]
    assert len(faults) == len(set(faults)) <= 3
    assert all("\n" not in text for text in faults)
    scans = sum(len(block.data) // len(block.channels) for block in bench.blocks)
    last = bench.blocks[-1]
    end = last.first_index + len(last.data) // len(last.channels)
    assert bench.blocks[0].first_index + scans + last.dropped == end  # every scan is there or counted


def test_wrong_serial_number_then_the_right_one(bench: Bench, t7: Control) -> None:
    t7.serial(99)
    node = bench.start(LabJackNode, **laser(serial=470012345))
    bench.until(lambda: bench.has_event("the T7 has serial number 99, expected 470012345"))
    assert label(node) == "unconfigured"
    bench.until(lambda: any("serial number 99" in status.message for status in bench.diagnostics))
    t7.serial(470012345)
    bench.until(lambda: bench.blocks)


def test_a_library_that_is_missing_then_installed(bench: Bench, t7: Control, tmp_path: Path) -> None:
    library = tmp_path / "libLabJackM.so"
    node = bench.start(LabJackNode, **laser(library=str(library)))
    bench.until(lambda: bench.has_event("install LJM from labjack.com"))
    assert label(node) == "unconfigured"
    shutil.copy(LIBRARIES / "libLabJackM.so", library)
    bench.until(lambda: bench.blocks)
    assert len({event.text for event in bench.events if event.kind == "fault"}) == 1


def test_configured_by_hand_while_it_tries_to_start(bench: Bench, t7: Control) -> None:
    t7.unplug()
    node = bench.start(LabJackNode, **laser())
    bench.until(lambda: bench.has_event("cannot configure"))
    t7.replug()
    node.trigger_configure()
    bench.until(lambda: node._starter is None)  # the next attempt sees that it need not
    assert label(node) == "inactive"
    node.trigger_shutdown()
    assert label(node) == "finalized"


def test_shut_down_by_hand_while_it_tries_to_start(bench: Bench, t7: Control) -> None:
    t7.unplug()
    node = bench.start(LabJackNode, **laser())
    bench.until(lambda: bench.has_event("cannot configure"))
    node.trigger_shutdown()
    seen = len(bench.diagnostics)
    bench.until(lambda: len(bench.diagnostics) > seen + 1)
    assert label(node) == "finalized"


def test_a_set_up_the_device_refuses_leaves_the_node_alive(bench: Bench, t7: Control) -> None:
    bench.start(LabJackNode, **laser(rate=90_000.0))
    bench.until(lambda: bench.has_event("a scan takes longer than the scan period"))
    bench.until(lambda: any("LJM 2942" in status.message for status in bench.diagnostics))


@pytest.mark.parametrize("code", [2942, 2606, 1250, 1309])
def test_an_error_in_mid_stream_is_an_interruption_whatever_its_code(bench: Bench, t7: Control, code: int) -> None:
    """LJM 2942 once ended acquisition for good; here the cable is pulled as well and plugged in again."""
    bench.start(LabJackNode, **laser())
    bench.until(lambda: len(bench.blocks) >= 3)
    t7.fail(code)
    bench.until(lambda: bench.has_event(f"LJM {code}"))
    t7.unplug()
    bench.until(lambda: bench.has_event("no T7 answers") and bench.has_event("trying again"))
    t7.replug()
    bench.until(lambda: bench.has_event("streaming again"))
    count = len(bench.blocks)
    bench.until(lambda: len(bench.blocks) > count + 2)
    scans = sum(len(block.data) // len(block.channels) for block in bench.blocks)
    last = bench.blocks[-1]
    end = last.first_index + len(last.data) // len(last.channels)
    assert last.dropped > 0
    assert bench.blocks[0].first_index + scans + last.dropped == end  # every scan is there or counted


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"channels": ["support_displacement"]}, "1 channels, 2 terminals"),
        ({"calibrations": ["laser_beam.yaml", "laser_support.yaml"]}, "in the order"),
        ({"calibrations": ["laser_support.yaml"]}, "one file each"),
        ({"calibrations": ["none.yaml", "laser_beam.yaml"]}, "no such file"),
        ({"backend": "serial"}, "backend of labjack_node: given 'serial'; allowed: 'labjack', 'nidaqmx', 'simulated'"),
        ({"voltage_range": 7.0}, "a T7 has the ranges"),
        ({"rate": -3.0}, "rate"),
        ({"kinds": ["charge"]}, "kind"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused_before_a_device_is_touched(
    bench: Bench, change: dict[str, object], words: str
) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        bench.start(LabJackNode, **laser(**change))
    assert "\n" not in str(caught.value)


def test_the_simulated_backend_needs_no_device(bench: Bench) -> None:
    bench.start(LabJackNode, **laser(backend="simulated"))
    bench.until(lambda: len(bench.blocks) >= 2)
    assert bench.blocks[0].device == "simulated:1"


def run_node(*parameters: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "atpid_driver.nodes.labjack_node", "--ros-args"]
    for parameter in parameters:
        command += ["-p", parameter]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_bad_parameters_end_the_process_with_status_2_and_one_line() -> None:
    process = run_node("rate:=1000.0")
    output, _ = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 2
    assert output.splitlines() == [
        "error: parameter channels of labjack_node is not given: names of the channels in the messages; "
        "set it in the parameter file"
    ]


def test_a_parameter_file_that_is_not_there_is_one_line_and_status_2() -> None:
    command = [sys.executable, "-m", "atpid_driver.nodes.ni_node", "--ros-args", "--params-file", "none.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    assert done.returncode == 2
    assert done.stderr == "error: parameter file none.yaml: cannot be opened\n"


def test_a_node_started_twice_is_refused_with_status_2(bench: Bench) -> None:
    simulated = ["backend:=simulated", "handshake:=false", "rate:=1000.0"]
    wiring = ["channels:=[support_displacement]", "terminals:=[x]", "calibrations:=[laser_support.yaml]"]
    first = run_node(*simulated, *wiring)
    bench.until(lambda: bench.blocks)
    second = run_node(*simulated, *wiring)
    output, _ = second.communicate(timeout=TIMEOUT)
    first.send_signal(signal.SIGINT)
    first.communicate(timeout=TIMEOUT)
    assert (first.returncode, second.returncode) == (0, 2)
    assert "already running" in output
    assert len(output.splitlines()) == 1


def test_interrupted_the_process_leaves_cleanly(bench: Bench) -> None:
    shipped = Path(__file__).parents[1] / "config" / "labjack.yaml"
    command = [sys.executable, "-m", "atpid_driver.nodes.labjack_node", "--ros-args", "--params-file", str(shipped)]
    command += ["-p", "backend:=simulated", "-p", "handshake:=false", "-p", "real_time_priority:=0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    bench.until(lambda: bench.blocks)
    for _ in range(2):  # as `ros2 launch` does
        process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0
    connected, streams, stopped = (line.split("]: ")[-1] for line in output.splitlines())
    assert connected.startswith("connected to simulated:1: ")
    assert streams == "simulated:1 streams 2 channels at 1000 Hz"
    assert stopped.startswith("simulated:1: stream stopped after ")
    assert stopped.endswith(" 0 of them lost")
