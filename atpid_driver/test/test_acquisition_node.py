# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The acquisition nodes: lifecycle, handshake, messages, diagnostics, every fault by name; backends of entry points."""

import math
import re
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from acquisition_bench import Bench
from atpid_interfaces.msg import CeilingState, Event, RecorderStatus

from atpid_common.nodes.parameters import ParameterError
from atpid_common.testing import install
from atpid_driver.acquisition import SetupRefusedError
from atpid_driver.acquisition.registry import backend
from atpid_driver.acquisition.registry import names as backend_names
from atpid_driver.nodes import labjack_node, ni_node
from atpid_driver.nodes.labjack_node import LabJackNode
from atpid_driver.nodes.ni_node import NiNode
from atpid_driver.standins import Control, build

LIBRARIES = build()


@pytest.fixture
def bench() -> Iterator[Bench]:
    with closing(Bench()) as made:
        yield made


@pytest.fixture
def t7(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(tmp_path / "t7"))
    monkeypatch.setenv("ATPID_LJM_SOURCE", "sine")
    with closing(Control(tmp_path / "t7")) as control:
        yield control


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    monkeypatch.setenv("ATPID_DAQMX_CONTROL", str(tmp_path / "module"))
    monkeypatch.setenv("ATPID_DAQMX_SOURCE", "sine:offset=0,amplitude=0.5,frequency=50")
    with closing(Control(tmp_path / "module")) as control:
        yield control


def laser(**changes: object) -> dict[str, object]:
    return {
        "rate": 1000.0, "channels": ["support_displacement", "beam_displacement"], "terminals": ["AIN0", "AIN1"],
        "calibrations": ["laser_support.yaml", "laser_beam.yaml"], "library": str(LIBRARIES / "libLabJackM.so"),
        "handshake": False, **changes,
    }  # fmt: skip


def acceleration(**changes: object) -> dict[str, object]:
    return {
        "rate": 1280.0, "channels": ["beam_acceleration"], "terminals": ["ai0"], "kinds": ["iepe"],
        "calibrations": ["accelerometer.yaml"], "library": str(LIBRARIES / "libnidaqmx.so"),
        "blocks_per_second": 20.0, "handshake": False, **changes,
    }  # fmt: skip


def every_scan_is_there_or_counted(bench: Bench) -> bool:
    scans = sum(len(block.data) // len(block.channels) for block in bench.blocks)
    last = bench.blocks[-1]
    end = last.first_index + len(last.data) // len(last.channels)
    return bool(bench.blocks[0].first_index + scans + last.dropped == end)


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
    assert {"labjack:470012345", "2", "1000"} <= set(started.text.split())
    assert started.header.stamp == first.header.stamp


def test_accelerations_are_metres_per_second_squared(bench: Bench, module: Control) -> None:
    bench.start(NiNode, **acceleration())
    bench.until(lambda: len(bench.blocks) >= 3)
    block = bench.blocks[0]
    assert list(block.units) == ["m/s^2"]
    assert np.abs(np.frombuffer(block.data)).max() == pytest.approx(490.3325, rel=1e-3)


def test_a_handshake_precedes_the_first_sample(bench: Bench, t7: Control) -> None:
    bench.start(LabJackNode, **laser(handshake=True, expect_recorder=True))
    bench.until(lambda: len(bench.handshakes) >= 3 and any(event.handshake for event in bench.events))
    assert list(bench.handshakes[0].units) == ["m", "m"]
    assert len(bench.handshakes[0].data) == 0
    assert bench.handshakes[0].header.stamp.sec == 0
    no_handshake = CeilingState()
    no_handshake.header.frame_id = "motor_node"
    bench.state.publish(no_handshake)
    seen = len(bench.handshakes)
    bench.until(lambda: len(bench.handshakes) >= seen + 4)
    bench.until(lambda: re.search("wait.*ceiling/state", bench.status.message))
    bench.state.publish(CeilingState(handshake=True))
    topics = ["/sensors/laser", "/excitation", "/diagnostics"]
    bench.recorder.publish(RecorderStatus(recording=True, topics=topics, received=[2, 0, 0], written=[0, 0, 0]))
    bench.until(lambda: re.search("wait.*excitation", bench.status.message))
    assert not bench.blocks
    bench.recorder.publish(
        RecorderStatus(recording=True, topics=topics, received=[2, 1, 0], written=[0, 0, 0])
    )  # diagnostics are not in the loop
    bench.until(lambda: bench.blocks)
    assert bench.blocks[0].first_index == 0
    count = len(bench.handshakes)
    bench.until(lambda: len(bench.blocks) >= 5)
    assert len(bench.handshakes) == count


def test_life_by_hand(bench: Bench, t7: Control) -> None:
    node = bench.start(LabJackNode, **laser(autostart=False))
    assert bench.lifecycle(node) == "unconfigured"
    bench.until(lambda: bench.diagnostics)
    assert bench.status.hardware_id == "none"
    assert bench.status.message.startswith("no ")
    node.trigger_configure()
    assert bench.lifecycle(node) == "inactive"
    node.trigger_activate()
    bench.until(lambda: len(bench.blocks) >= 2)
    node.trigger_deactivate()
    assert bench.lifecycle(node) == "inactive"
    bench.until(lambda: bench.status.message == "connected")
    bench.blocks.clear()
    node.trigger_activate()
    bench.until(lambda: bench.blocks)
    assert bench.blocks[0].first_index == 0  # a new stream
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert bench.lifecycle(node) == "unconfigured"


def test_diagnostics_carry_serial_rate_backlog_drops_and_drift(bench: Bench, t7: Control) -> None:
    bench.start(LabJackNode, **laser())
    bench.until(lambda: "streaming" in bench.status.message)
    assert bench.status.hardware_id == "470012345"
    values = {pair.key: pair.value for pair in bench.status.values}
    assert float(values["rate [Hz]"]) == 1000.0
    assert math.isfinite(float(values["backlog [scans]"]))
    assert {"dropped [scans]", "last error", "clock drift [ppm]", "interruptions"} <= values.keys()
    t7.drop(40)
    bench.until(lambda: bench.has_event("40"))
    bench.until(lambda: any(block.dropped == 40 for block in bench.blocks))
    bench.until(lambda: "40" in bench.status.message)


def test_missing_then_plugged_in_then_pulled_then_plugged_in_again(bench: Bench, t7: Control) -> None:
    t7.unplug()
    node = bench.start(LabJackNode, **laser())
    bench.until(lambda: bench.faults())
    assert bench.lifecycle(node) == "unconfigured"
    t7.replug()
    bench.until(lambda: len(bench.blocks) >= 2)
    t7.fail(2942)  # which once ended acquisition for good, and the cable is pulled as well
    t7.unplug()
    bench.until(lambda: bench.has_event("trying again"))
    t7.replug()
    bench.until(lambda: bench.recovered())
    count = len(bench.blocks)
    bench.until(lambda: len(bench.blocks) > count + 1)
    faults = bench.faults()
    assert len(faults) == len(set(faults)) <= 4
    assert all("\n" not in text for text in faults)
    assert every_scan_is_there_or_counted(bench)


def test_configured_and_shut_down_by_hand_while_it_tries_to_start(bench: Bench, t7: Control) -> None:
    t7.unplug()
    node = bench.start(LabJackNode, **laser())
    bench.until(lambda: bench.faults())
    t7.replug()
    node.trigger_configure()
    bench.diagnostics.clear()
    bench.until(lambda: len(bench.diagnostics) >= 2)  # the next attempt, after half a second, sees that it need not
    assert bench.lifecycle(node) == "inactive"
    node.trigger_shutdown()
    bench.diagnostics.clear()
    bench.until(lambda: bench.diagnostics)
    assert bench.lifecycle(node) == "finalized"


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"channels": ["support_displacement"]}, "1 channels.*2 terminals"),
        (
            {"calibrations": ["laser_beam.yaml", "laser_support.yaml"]},
            "support_displacement.*beam_displacement.*calibrations",
        ),
        ({"calibrations": ["none.yaml", "laser_beam.yaml"]}, r"none\.yaml"),
        ({"backend": "serial"}, "backend.*labjack_node.*'serial'.*'labjack', 'nidaqmx', 'simulated'"),
        ({"kinds": ["charge"]}, "kind"),
    ],
)
def test_a_bad_parameter_is_refused_before_the_device(bench: Bench, change: dict[str, object], parts: str) -> None:
    with pytest.raises(ValueError, match=f"^.*{parts}.*$"):
        bench.start(LabJackNode, **laser(**change))


def test_bad_parameters_end_the_program_with_status_2_and_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    assert labjack_node.main(["--ros-args", "-p", "rate:=1000.0"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert {"error:", "channels", "labjack_node"} <= set(line.split())
    assert ni_node.main(["--ros-args", "--params-file", "none.yaml"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert {"error:", "none.yaml:"} <= set(line.split())


OWN = """
from dataclasses import dataclass
from atpid_driver.acquisition import Backend, setting
from atpid_driver.acquisition.protocol import SimulatedSettings
from atpid_driver.acquisition.simulated import SimulatedAcquisition
@dataclass(frozen=True, kw_only=True)
class OwnSettings(SimulatedSettings):
    gain: float = setting(2.0, "gain of the amplifier", "1", 0.1, 100.0)
    filter: str = setting("off", "low-pass filter", choices=("off", "on"))
BACKEND = Backend(OwnSettings, SimulatedAcquisition)
"""
WIRING = {"channels": ["support_displacement"], "terminals": ["x"], "calibrations": ["laser_support.yaml"]}


def test_an_entry_point_is_a_backend_like_others(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "[atpid.acquisition]\nown = registry_source:BACKEND\n", registry_source=OWN)
    assert backend_names() == ("labjack", "nidaqmx", "simulated", "topic", "own")
    assert backend("own").settings.__name__ == "OwnSettings"
    node = bench.start(LabJackNode, backend="own", rate=1000.0, handshake=False, gain=4.0, **WIRING)
    bench.until(lambda: bench.blocks)
    assert list(bench.blocks[0].channels) == ["support_displacement"]
    assert node.get_parameter("gain").value == 4.0
    assert node.describe_parameter("gain").description.endswith("[1]")
    assert {"off", "on"} <= set(node.describe_parameter("filter").additional_constraints.replace(",", "").split())
    for change, parts in (({"gain": 0.0}, r"gain.* 0 .*0\.1"), ({"filter": "x"}, "filter.*'off', 'on'")):
        with pytest.raises(ParameterError, match=parts):
            bench.start(LabJackNode, backend="own", rate=1000.0, **WIRING, **change)


@pytest.mark.parametrize(
    ("entry", "name", "parts"),
    [
        ("bad = registry_number:BACKEND", "bad", r"int: .*atpid_driver\.acquisition\.registry\.Backend"),
        ("bad = no_such_module:BACKEND", "bad", "ModuleNotFoundError"),
        ("labjack = registry_number:BACKEND", "steam", "built in"),
        ("bad = registry_number:BACKEND", "steam", "'steam'.*labjack, nidaqmx, simulated"),
    ],
)
def test_what_is_no_backend_is_one_line(
    entry: str, name: str, parts: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, monkeypatch, f"[atpid.acquisition]\n{entry}\n", registry_number="BACKEND = 3")
    with pytest.raises(SetupRefusedError, match=rf"^[^\n]*{parts}[^\n]*$"):
        backend(name)
