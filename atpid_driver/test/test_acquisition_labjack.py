# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The T7 backend on the real labjack.ljm package: errors, overruns, rates and skew."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from acquisition_rigs import channels

from atpid_driver.acquisition import SetupRefusedError, StreamLostError
from atpid_driver.acquisition.labjack import LabJackAcquisition, load_ljm, skew_s
from atpid_driver.acquisition.settings import LabJackSettings, checked
from atpid_driver.standins import Control, Feed, StandinError, build

LIBRARY = str(build() / "libLabJackM.so")


@pytest.fixture
def control(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    made = Control(tmp_path / "control")
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(made.path))
    monkeypatch.setenv("ATPID_LJM_SOURCE", "ramp")
    yield made
    made.close()


@pytest.fixture
def device(control: Control) -> Iterator[LabJackAcquisition]:
    made = t7(rate=2000.0, scans=50)
    made.open()
    yield made
    made.stop()
    made.close()


def t7(**changes: object) -> LabJackAcquisition:
    values: dict[str, object] = {"channels": channels(0, "AIN"), "rate": 1000.0, "scans_per_block": 20}
    renamed = {"scans": "scans_per_block"}
    values |= {renamed.get(key, key): value for key, value in changes.items()}
    return LabJackAcquisition(checked(LabJackSettings, values | {"library": LIBRARY}))


@pytest.mark.parametrize("code", [1301, 1303, 1306, 1309])
def test_a_read_error_ends_the_stream_in_one_line_and_stop_forgives(
    device: LabJackAcquisition, control: Control, code: int
) -> None:
    device.start()
    device.read()
    control.fail(code)
    with pytest.raises(StreamLostError, match=str(code)) as caught:
        device.read()
    assert caught.value.code == code
    assert "\n" not in str(caught.value)
    device.stop()  # LJM answers 1303: it is stopped already
    device.start()
    assert device.read().first_index == 0


def test_register_set_up_is_written(device: LabJackAcquisition) -> None:
    device.start()
    ljm = load_ljm(LIBRARY)
    read = {name: ljm.eReadName(device._handle, name) for name in ("AIN_ALL_RANGE", "AIN_ALL_NEGATIVE_CH")}
    assert read == {"AIN_ALL_RANGE": 10.0, "AIN_ALL_NEGATIVE_CH": 199.0}
    assert ljm.eReadName(device._handle, "STREAM_BUFFER_SIZE_BYTES") == 32768
    with pytest.raises(ljm.LJMError, match="2605"):
        ljm.eReadName(device._handle, "AIN0")  # the converter belongs to the stream


def test_a_device_is_opened_once_however_often_it_is_asked_for(device: LabJackAcquisition) -> None:
    ljm = load_ljm(LIBRARY)
    assert ljm.openS("T7", "ANY", "ANY") == device._handle


def test_rate_is_a_whole_number_of_clock_ticks(control: Control) -> None:
    for asked in (1000.0, 999.97, 3333.3, 44_100.0):
        made = t7(rate=asked, scans=100)
        made.open()
        rate = made.start()
        made.stop()
        made.close()
        assert rate == 1e7 / round(1e7 / asked)


@pytest.mark.parametrize(("index", "limit"), [(1, 100e3), (2, 39.6e3), (5, 4.4e3), (8, 630.0)])
def test_a_rate_above_the_resolutions_limit_is_a_scan_overlap(control: Control, index: int, limit: float) -> None:
    for rate, overlaps in ((0.45 * limit, False), (0.55 * limit, True)):
        made = t7(rate=rate, resolution_index=index, scans=10)
        made.open()
        made.start()
        if overlaps:
            with pytest.raises(SetupRefusedError, match="2942"):
                made.read()
        else:
            made.read()
        made.stop()
        made.close()


def test_a_stream_left_active_by_another_program_is_stopped_first(device: LabJackAcquisition) -> None:
    device.start()
    device._rate = None  # as a program that was killed leaves it
    assert device.start() == 2000.0
    assert device.read().first_index == 0


def test_unknown_terminal_is_refused(control: Control) -> None:
    made = t7(channels=[{"name": "x", "terminal": "AIN99"}])
    made.open()
    with pytest.raises(SetupRefusedError, match=r"AIN0 to AIN13"):
        made.start()
    made.close()


@pytest.mark.slow
def test_a_transfer_that_stands_still_ends_the_stream(device: LabJackAcquisition, control: Control) -> None:
    device.start()
    device.read()
    control.stall(True)
    with pytest.raises(StreamLostError, match=r"1309|1306"):  # nothing, or part of a block
        list(iter(device.read, None))  # what was sampled before is still there


@pytest.mark.slow
def test_the_device_keeps_what_its_buffer_holds_and_skips_the_rest(control: Control) -> None:
    """32768 bytes are 8192 scans of two channels; what came after them until the transfer went on is lost."""
    made = t7(rate=50_000.0, scans=500)
    made.open()
    made.start()
    held = made.read().next_index
    control.stall(True)
    resume = threading.Timer(0.4, control.stall, [False])
    resume.start()
    blocks = [made.read() for _ in range(60)]
    resume.join()
    made.stop()
    made.close()
    data = np.concatenate([block.volts for block in blocks])
    lost = np.flatnonzero(np.isnan(data[:, 0]))
    assert blocks[-1].dropped == len(lost) > 5000
    assert held + lost[0] >= 8192
    assert np.array_equal(np.diff(lost), np.ones(len(lost) - 1))


def test_overrun_shows_as_nan_and_the_rest_is_true(control: Control) -> None:
    made = t7(rate=50_000.0, scans=5000)
    made.open()
    made.start()
    first = made.read()
    control.drop(12_345)
    volts = [first.volts]
    for _ in range(4):
        block = made.read()
        volts.append(block.volts)
    made.stop()
    made.close()
    assert block.dropped == 12_345
    data = np.concatenate(volts)
    assert np.isnan(data).all(axis=1).sum() == 12_345
    valid = ~np.isnan(data[:, 0])
    index = np.arange(len(data))
    assert np.array_equal(data[valid, 0], 1.0 + (index[valid] % 4096) / 1024.0)


def test_a_held_channel_gives_one_voltage_until_it_is_released(device: LabJackAcquisition, control: Control) -> None:
    device.start()
    device.read()
    control.hold(1, 3.1)
    device.read()  # part of it was there before
    held = device.read().volts
    assert (held[:, 1] == 3.1).all()
    assert np.ptp(held[:, 0]) > 0.0
    control.release(1)
    device.read()
    assert np.ptp(device.read().volts[:, 1]) > 0.0
    with pytest.raises(StandinError, match="channel 16: allowed 0 to 15"):
        control.hold(16, 0.0)


def test_skew_is_15_us_and_8_us_above_60_khz() -> None:
    assert skew_s(1000.0, 3) == (0.0, 15e-6, 30e-6)
    assert skew_s(50_000.0, 2) == (0.0, 8e-6)


def test_a_feed_arrives_scan_for_scan(control: Control, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(Feed(tmp_path / "feed", channels=2, rate=1000.0, capacity=4096)) as feed:
        monkeypatch.setenv("ATPID_LJM_SOURCE", f"feed:{feed.path}")
        made = t7(rate=1000.0, scans=100, channels=channels(0, "AIN", count=1))
        made.open()
        feed.write(np.full((7, 2), 9.0))  # before the start: not seen
        made.start()
        frames = np.random.default_rng(1).uniform(1.0, 5.0, (301, 2))
        feed.write(frames)
        data = np.concatenate([made.read().volts for _ in range(3)])
        made.stop()
        made.close()
    assert np.array_equal(data[:, 0], frames[:300, 0])


def test_a_feed_faster_than_the_reader_is_an_overrun(
    control: Control, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(Feed(tmp_path / "feed", channels=1, rate=1000.0, capacity=64)) as feed:
        monkeypatch.setenv("ATPID_LJM_SOURCE", f"feed:{feed.path}")
        made = t7(rate=1000.0, scans=100, channels=channels(0, "AIN", count=1))
        made.open()
        made.start()
        for part in np.split(np.arange(120.0)[:, None] / 100.0, 6):
            feed.write(part)
        block = made.read()
        made.stop()
        made.close()
    assert block.dropped == 56  # frames 0 to 55 were overwritten by the newest 64
    assert np.array_equal(block.volts[56:, 0], np.arange(56, 100) / 100.0)


def test_without_the_library_one_line_names_what_to_install() -> None:
    """In a process of its own, since this one has the stand-in."""
    program = (
        "from atpid_driver.acquisition.labjack import load_ljm\n"
        "try:\n    load_ljm()\nexcept ValueError as error:\n    print(type(error).__name__, error)\n"
    )
    clean = {key: value for key, value in os.environ.items() if key != "LD_LIBRARY_PATH"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=clean, check=True)
    assert done.stdout.startswith("LibraryMissingError LabJack's library libLabJackM.so is not installed: install LJM")
    assert len(done.stdout.splitlines()) == 1
    assert done.stderr == ""


def test_library_path_that_is_wrong_is_named() -> None:
    with pytest.raises(ValueError, match=r"/nowhere/lib\.so"):
        load_ljm("/nowhere/lib.so")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"voltage_range": 5.0}, "10, 1, 0.1, 0.01"),
        ({"rate": -1.0}, "rate"),
        ({"channels": []}, "channels"),
        ({"resolution_index": 9}, "resolution_index"),
        ({"connection": "BLUETOOTH"}, "connection"),
    ],
)
def test_impossible_settings_are_refused_in_one_line(changes: dict[str, object], words: str) -> None:
    with pytest.raises(SetupRefusedError, match=words) as caught:
        t7(**changes)
    assert "\n" not in str(caught.value)
