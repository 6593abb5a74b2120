# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every acquisition backend promises, and what each vendor's own package adds: the code that runs on the stand."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from acquisition_rigs import BACKENDS, Rig, channels, rig
from grpc_server import Server

from atpid_driver.acquisition import (
    Acquisition,
    AcquisitionError,
    DeviceMissingError,
    SetupRefusedError,
    StreamLostError,
)
from atpid_driver.acquisition.contract import AcquisitionContract
from atpid_driver.acquisition.labjack import LabJackAcquisition, load_ljm, skew_s
from atpid_driver.acquisition.nidaqmx import NiAcquisition
from atpid_driver.acquisition.protocol import Channel, LabJackSettings, NiSettings
from atpid_driver.standins import Control, Feed, build

LJM, NIDAQMX = (build() / name for name in ("libLabJackM.so", "libnidaqmx.so"))
MakeNi = Callable[..., NiAcquisition]


@pytest.fixture
def backend(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    with rig(name, tmp_path, monkeypatch) as made:
        yield made


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    subset = metafunc.definition.get_closest_marker("parametrize")
    if "backend" in metafunc.fixturenames and subset is None:
        metafunc.parametrize("name", BACKENDS)


def read_blocks(device: Acquisition, count: int) -> np.ndarray:
    return np.concatenate([device.read().volts for _ in range(count)])


@contextmanager
def streaming(device: Acquisition) -> Iterator[float]:
    """Open a device and let it stream, at the rate that this yields."""
    device.open()
    yield device.start()
    device.stop()
    device.close()


class TestEachBackend(AcquisitionContract):
    """The tests of the contract, on every backend."""

    @pytest.fixture(autouse=True)
    def _backend(self, backend: Rig) -> None:
        self._rig = backend

    def make(self, serial: int = 0) -> Acquisition:
        return self._rig.make(serial=serial)

    def serial(self) -> int:
        return self._rig.serial


def test_the_waveform_is_read_at_the_instants_of_the_scans(backend: Rig) -> None:
    device = backend.make()
    with streaming(device) as rate:
        volts = read_blocks(device, 8)
        step = np.arange(len(volts))[:, None] / rate + np.array(device.skew())
    expected = 3.0 + np.sin(2 * np.pi * 5.0 * step + np.arange(2) * np.pi / 4)
    assert np.abs(volts - expected).max() < 1e-9


@pytest.mark.parametrize("name", BACKENDS[1:])
def test_one_that_is_missing_and_unplugged_in_mid_stream_works_again_once_it_is_back(backend: Rig) -> None:
    backend.control.unplug()
    device = backend.make()
    with pytest.raises(DeviceMissingError, match=r"^.{10,220}$"):
        device.open()
    backend.control.replug()
    device.open()
    device.start()
    device.read()
    backend.control.unplug()
    with pytest.raises((StreamLostError, DeviceMissingError), match=r"^.{10,220}$"):
        read_blocks(device, 100)
    device.stop()
    device.close()
    with pytest.raises(AcquisitionError):
        device.open()
    device.close()
    backend.control.replug()
    with streaming(device):
        assert device.read().first_index == 0


@pytest.fixture
def control(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    with closing(Control(tmp_path / "control")) as made:
        for name, source in (("LJM", "ramp"), ("DAQMX", "sine:offset=0,amplitude=2,frequency=100")):
            monkeypatch.setenv(f"ATPID_{name}_CONTROL", str(made.path))
            monkeypatch.setenv(f"ATPID_{name}_SOURCE", source)
        yield made


@pytest.fixture
def device(control: Control) -> Iterator[LabJackAcquisition]:
    made = t7(rate=2000.0, scans=50)
    with streaming(made):
        yield made


def t7(scans: int = 20, **changes: object) -> LabJackAcquisition:
    values: dict[str, Any] = {"rate": 1000.0, "scans_per_block": scans, "library": str(LJM)}
    return LabJackAcquisition(LabJackSettings(**({"channels": channels(0, "AIN")} | values | changes)))


def test_a_read_error_ends_the_stream_in_a_line_and_stop_forgives(device: LabJackAcquisition, control: Control) -> None:
    for code in (1301, 1303, 1306, 1309, 2942, 2606, 1250):
        device.read()
        control.fail(code)
        kind = SetupRefusedError if code in (2942, 2606, 1250) else StreamLostError
        with pytest.raises(kind, match=f"^.*{code}.*$") as caught:
            device.read()
        assert caught.value.code == code
        device.stop()  # LJM answers 1303: it is stopped already
        device.start()
        assert device.read().first_index == 0
    control.stall(True)
    with pytest.raises(StreamLostError, match=r"1309|1306"):  # nothing, or part of a block
        list(iter(device.read, None))  # what was sampled before is still there


def test_register_set_up_is_written_and_a_stream_left_active_is_stopped_first(device: LabJackAcquisition) -> None:
    ljm = load_ljm(str(LJM))
    handle = ljm.openS("T7", "ANY", "ANY")
    assert ljm.openS("T7", "ANY", "ANY") == handle  # one device is opened once, however often it is asked for
    values = {"AIN_ALL_RANGE": 10.0, "AIN_ALL_NEGATIVE_CH": 199.0, "STREAM_BUFFER_SIZE_BYTES": 32768.0}
    assert {name: ljm.eReadName(handle, name) for name in values} == values
    with pytest.raises(ljm.LJMError, match="2605"):
        ljm.eReadName(handle, "AIN0")  # the converter belongs to the stream
    other = t7(rate=2000.0)
    other.open()
    assert other.start() == 2000.0  # whose stream a program has left that was killed
    assert other.read().first_index == 0
    other.stop()


def test_overrun_shows_as_nan_and_the_rest_is_true(control: Control) -> None:
    made = t7(rate=50_000.0, scans=5000)
    with streaming(made):
        first = made.read().volts
        control.drop(12_345)
        blocks = [made.read() for _ in range(4)]
    assert blocks[-1].dropped == 12_345
    data = np.concatenate([first, *(block.volts for block in blocks)])
    valid = ~np.isnan(data[:, 0])
    assert np.count_nonzero(~valid) == np.isnan(data).all(axis=1).sum() == 12_345
    assert np.array_equal(data[valid, 0], 1.0 + (np.flatnonzero(valid) % 4096) / 1024.0)


def test_skew_is_15_us_and_8_us_above_60_khz() -> None:
    assert skew_s(1000.0, 3) == (0.0, 15e-6, 30e-6)
    assert skew_s(50_000.0, 2) == (0.0, 8e-6)


def test_a_feed_arrives_scan_for_scan_and_one_faster_than_the_reader_is_an_overrun(
    control: Control, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(Feed(tmp_path / "feed", channels=2, rate=1000.0, capacity=64)) as feed:
        monkeypatch.setenv("ATPID_LJM_SOURCE", f"feed:{feed.path}")
        made = t7(rate=1000.0, scans=100, channels=channels(0, "AIN", count=1))
        made.open()
        feed.write(np.full((7, 2), 9.0))  # before the start: not seen
        made.start()
        written = np.random.default_rng(1).uniform(1.0, 5.0, (120, 2))
        for part in np.array_split(written, 6):
            feed.write(part)
        block = made.read()
        made.stop()
        made.close()
    assert block.dropped == 56  # by the newest 64
    assert np.array_equal(block.volts[56:, 0], written[56:100, 0])


@pytest.mark.parametrize(
    ("name", "terminal", "names"),
    [("labjack", "AIN0", ("libLabJackM.so", "LJM")), ("nidaqmx", "ai0", ("NI-DAQmx", "install"))],
)
def test_without_the_library_one_line_names_what_to_install(name: str, terminal: str, names: tuple[str, ...]) -> None:
    """In a process of its own, since this one has the stand-in."""
    values = {"channels": [Channel("a", terminal)], "rate": 1280.0, "scans_per_block": 64}
    program = (
        "from atpid_driver.acquisition.protocol import Channel\n"
        f"from atpid_driver.acquisition.registry import create\ndevice = create({name!r}, {values})\n"
        "try:\n    device.open()\nexcept ValueError as error:\n    print(type(error).__name__, error)\n"
    )
    clean = {key: value for key, value in os.environ.items() if key != "LD_LIBRARY_PATH"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=clean, check=True)
    (line,) = done.stdout.splitlines()
    assert line.startswith("LibraryMissingError ")
    assert all(part in line for part in names)
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"voltage_range": 5.0}, "10, 1, 0.1, 0.01"),
        ({"rate": -1.0}, "rate"),
        ({"channels": []}, "channels"),
        ({"channels": [Channel("x", "AIN99")]}, "AIN0.*AIN13"),
    ],
)
def test_impossible_settings_are_refused_in_one_line(changes: dict[str, object], parts: str, control: Control) -> None:
    def start() -> None:
        with closing(t7(**changes)) as made:  # type: ignore[arg-type]
            made.open()
            made.start()

    with pytest.raises(SetupRefusedError, match=f"^.*{parts}.*$"):
        start()


@pytest.fixture(params=["library", "grpc"])
def make(request: pytest.FixtureRequest, control: Control) -> Iterator[MakeNi]:
    made: list[NiAcquisition] = []

    with Server(NIDAQMX) as server:
        values: dict[str, Any] = {
            "channels": channels(0, "ai", "iepe", 3), "rate": 12_800.0, "scans_per_block": 1280,
            "library": str(NIDAQMX), "grpc": server.address if request.param == "grpc" else "",
        }  # fmt: skip

        def build_one(**changes: Any) -> NiAcquisition:
            made.append(NiAcquisition(NiSettings(**(values | changes))))
            return made[-1]

        yield build_one
        for device in made:
            device.close()


def test_iepe_and_voltage_channels_read_volts_at_the_rate_that_is_read_back(make: MakeNi) -> None:
    device = make(channels=[*channels(0, "ai", "iepe", 1), *channels(0, "ai", "voltage", 3)[1:]])
    assert str(device.open()) == "ni-9230:470012345"
    rate = device.start()
    assert rate == pytest.approx(12_800.0, rel=1e-12)
    time = np.arange(1280)[:, None] / rate
    expected = 2.0 * np.sin(2 * np.pi * 100 * time + np.arange(3) * np.pi / 4)
    assert np.abs(device.read().volts - expected).max() < 1e-9
    device.close()
    for asked, actual in ((5000.0, 6400.0), (1000.0, 12_800.0 / 12)):
        with streaming(make(rate=asked, scans_per_block=64)) as rate:
            assert rate == pytest.approx(actual, rel=1e-12)


def test_a_read_error_is_one_line_and_the_task_starts_again(make: MakeNi, control: Control) -> None:
    device = make(scans_per_block=64)
    device.open()
    for code in (-200279, -200284, -200088):
        device.start()
        assert device.read().first_index == 0
        control.fail(code)
        with pytest.raises(StreamLostError, match=f"^.*{code}.*$") as caught:
            device.read()
        assert caught.value.code == code
    device.start()
    control.stall(True)
    with pytest.raises(StreamLostError, match="-200284"):
        read_blocks(device, 1000)  # what was sampled before is still there, on a busy machine more than a block


def test_refusals_name_what_is_allowed(make: MakeNi) -> None:
    wrong: list[tuple[dict[str, Any], type[Exception], str]] = [
        ({"rate": 20_000.0}, SetupRefusedError, "12.8 kS/s"),
        ({"channels": [Channel("x", "ai7")]}, SetupRefusedError, "ai0, ai1, ai2"),
        ({"device": "cDAQ9Mod9"}, DeviceMissingError, "NI MAX"),
        ({"grpc": "127.0.0.1:1"}, DeviceMissingError, r"127\.0\.0\.1:1"),
    ]
    for changes, error, parts in wrong:
        with pytest.raises(error, match=parts), streaming(make(**changes)):
            pass
