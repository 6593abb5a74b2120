# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The NI-9230 backend on the real nidaqmx package, over the local library and over gRPC."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from acquisition_rigs import channels
from grpc_server import Server

from atpid_driver.acquisition import DeviceMissingError, SetupRefusedError, StreamLostError
from atpid_driver.acquisition.nidaqmx import NiAcquisition
from atpid_driver.acquisition.settings import NiSettings, checked
from atpid_driver.standins import Control, build

LIBRARY = build() / "libnidaqmx.so"
Make = Callable[..., NiAcquisition]


@pytest.fixture
def control(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    made = Control(tmp_path / "control")
    monkeypatch.setenv("ATPID_DAQMX_CONTROL", str(made.path))
    monkeypatch.setenv("ATPID_DAQMX_SOURCE", "sine:offset=0,amplitude=2,frequency=100")
    yield made
    made.close()


@pytest.fixture(params=["library", "grpc"])
def make(request: pytest.FixtureRequest, control: Control) -> Iterator[Make]:
    made: list[NiAcquisition] = []

    def build_one(grpc: str, **changes: object) -> NiAcquisition:
        values: dict[str, object] = {
            "channels": channels(0, "ai", "iepe", 3),
            "rate": 12_800.0,
            "scans_per_block": 1280,
            "library": str(LIBRARY),
            "grpc": grpc,
        }
        made.append(NiAcquisition(checked(NiSettings, values | changes)))
        return made[-1]

    if request.param == "library":
        yield lambda **changes: build_one("", **changes)
    else:
        with Server(LIBRARY) as server:
            yield lambda **changes: build_one(server.address, **changes)
            for device in made:
                device.close()
    for device in made:
        device.close()


def test_iepe_and_voltage_channels_read_volts(make: Make) -> None:
    device = make(channels=[*channels(0, "ai", "iepe", 1), *channels(0, "ai", "voltage", 3)[1:]])
    device.open()
    rate = device.start()
    block = device.read()
    time = np.arange(1280)[:, None] / rate
    assert np.abs(block.volts - 2.0 * np.sin(2 * np.pi * 100 * time + np.arange(3) * np.pi / 4)).max() < 1e-9


@pytest.mark.parametrize(("asked", "actual"), [(12_800.0, 12_800.0), (5000.0, 6400.0), (1000.0, 12_800.0 / 12)])
def test_rate_is_read_back(make: Make, asked: float, actual: float) -> None:
    device = make(rate=asked, scans_per_block=64)
    device.open()
    assert device.start() == pytest.approx(actual, rel=1e-12)


def test_identity_is_model_and_serial(make: Make) -> None:
    assert str(make().open()) == "ni-9230:470012345"


@pytest.mark.slow
@pytest.mark.parametrize("code", [-200279, -200284, -200088])
def test_a_read_error_is_one_line_and_the_task_starts_again(make: Make, control: Control, code: int) -> None:
    device = make()
    device.open()
    device.start()
    device.read()
    control.fail(code)
    with pytest.raises(StreamLostError, match=str(code)) as caught:
        device.read()
    assert "\n" not in str(caught.value)
    assert caught.value.code == code
    device.start()
    assert device.read().first_index == 0


def read_blocks(device: NiAcquisition, count: int) -> None:
    for _ in range(count):
        device.read()


def open_and_start(device: NiAcquisition) -> None:
    device.open()
    device.start()


@pytest.mark.slow
def test_a_module_that_sends_nothing_is_a_time_out(make: Make, control: Control) -> None:
    device = make(rate=12_800.0, scans_per_block=64)
    device.open()
    device.start()
    device.read()
    control.stall(True)
    with pytest.raises(StreamLostError, match="-200284"):
        read_blocks(device, 1000)  # what was sampled before is still there, on a busy machine more than a block


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"rate": 20_000.0}, SetupRefusedError, "12.8 kS/s"),
        ({"channels": [{"name": "x", "terminal": "ai7"}]}, SetupRefusedError, "ai0, ai1, ai2"),
        ({"device": "cDAQ9Mod9"}, DeviceMissingError, "NI MAX"),
    ],
)
def test_refusals_name_what_is_allowed(
    make: Make, changes: dict[str, object], error: type[Exception], words: str
) -> None:
    device = make(**changes)
    with pytest.raises(error, match=words):
        open_and_start(device)


def test_a_server_that_is_away_is_named() -> None:
    values = {"channels": channels(0, "ai", "iepe", 1), "rate": 1280.0, "scans_per_block": 64}
    device = NiAcquisition(checked(NiSettings, {**values, "grpc": "127.0.0.1:1"}))
    with pytest.raises(DeviceMissingError, match=r"127\.0\.0\.1:1 does not answer"):
        device.open()
    device.close()


def test_without_the_runtime_one_line_names_what_to_install() -> None:
    program = (
        "from atpid_driver.acquisition.registry import create\n"
        "channels = [{'name': 'a', 'terminal': 'ai0', 'kind': 'iepe'}]\n"
        "device = create('nidaqmx', {'channels': channels, 'rate': 1280.0, 'scans_per_block': 64})\n"
        "try:\n    device.open()\nexcept ValueError as error:\n    print(type(error).__name__, error)\n"
    )
    clean = {key: value for key, value in os.environ.items() if key != "LD_LIBRARY_PATH"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=clean, check=True)
    assert done.stdout.startswith("LibraryMissingError NI-DAQmx is not installed: install")
    assert len(done.stdout.splitlines()) == 1
