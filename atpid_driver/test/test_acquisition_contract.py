# SPDX-License-Identifier: Apache-2.0
"""What every acquisition backend promises, each tried on the code that runs on the stand."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from acquisition_rigs import BACKENDS, Rig, rig

from atpid_driver.acquisition import (
    AcquisitionError,
    DeviceMissingError,
    NotStreamingError,
    StreamLostError,
    WrongDeviceError,
)


@pytest.fixture
def backend(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    with rig(name, tmp_path, monkeypatch) as made:
        yield made


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    subset = metafunc.definition.get_closest_marker("parametrize")
    if "backend" in metafunc.fixturenames and subset is None:
        metafunc.parametrize("name", BACKENDS)


def one_line(error: BaseException) -> bool:
    return "\n" not in str(error) and 10 < len(str(error)) < 220


def test_identity_is_the_devices_own(backend: Rig) -> None:
    device = backend.make(serial=backend.serial)
    identity = device.open()
    assert identity.serial == backend.serial
    device.close()


def test_blocks_follow_one_another_without_gap(backend: Rig) -> None:
    device = backend.make()
    device.open()
    began = time.monotonic()
    rate = device.start()
    blocks = [device.read() for _ in range(8)]
    elapsed = time.monotonic() - began
    device.stop()
    device.close()
    assert [block.first_index for block in blocks] == [20 * k for k in range(8)]
    assert all(block.volts.shape == (20, 2) and block.volts.flags.c_contiguous for block in blocks)
    assert all(block.dropped == 0 and block.backlog >= 0 for block in blocks)
    assert elapsed > 0.9 * 8 * 20 / rate  # paced by the device, not by the reader
    volts = np.concatenate([block.volts for block in blocks])
    step = np.arange(len(volts))[:, None] / rate + np.array(device.skew())
    expected = 3.0 + np.sin(2 * np.pi * 5.0 * step + np.arange(2) * np.pi / 4)
    assert np.abs(volts - expected).max() < 1e-9


def test_a_second_stream_starts_at_index_0(backend: Rig) -> None:
    device = backend.make()
    device.open()
    for _ in range(2):
        device.start()
        assert device.read().first_index == 0
        assert device.read().first_index == 20
        device.stop()
    device.close()


def test_stop_and_close_may_be_repeated(backend: Rig) -> None:
    device = backend.make()
    device.stop()
    device.close()
    device.open()
    device.start()
    for _ in range(2):
        device.stop()
    for _ in range(2):
        device.close()


def test_reading_without_a_stream_is_refused(backend: Rig) -> None:
    device = backend.make()
    device.open()
    with pytest.raises(NotStreamingError):
        device.read()
    device.close()


def test_missing_device_is_named(backend: Rig) -> None:
    backend.unplug()
    with pytest.raises(DeviceMissingError) as caught:
        backend.make().open()
    assert one_line(caught.value)
    backend.replug()
    device = backend.make()
    device.open()
    device.close()


def test_wrong_serial_number_is_named(backend: Rig) -> None:
    device = backend.make(serial=12)
    with pytest.raises(WrongDeviceError, match=f"{backend.serial}.*12") as caught:
        device.open()
    assert one_line(caught.value)
    device.close()


def test_unplugged_in_mid_stream_ends_it_and_replugged_works_again(backend: Rig) -> None:
    device = backend.make()
    device.open()
    device.start()
    device.read()
    backend.unplug()
    with pytest.raises((StreamLostError, DeviceMissingError)) as caught:
        for _ in range(100):
            device.read()
    assert one_line(caught.value)
    device.stop()
    device.close()
    with pytest.raises(AcquisitionError):
        device.open()
    device.close()
    backend.replug()
    device.open()
    device.start()
    assert device.read().first_index == 0
    device.stop()
    device.close()


@pytest.mark.parametrize("name", ["simulated", "labjack"])  # NI stops the task instead: test_acquisition_nidaqmx
def test_lost_scans_are_nan_and_counted(backend: Rig) -> None:
    assert backend.drop is not None
    device = backend.make()
    device.open()
    device.start()
    device.read()
    backend.drop(27)
    blocks = [device.read() for _ in range(4)]
    device.stop()
    device.close()
    assert blocks[-1].dropped == 27
    volts = np.concatenate([block.volts for block in blocks])
    assert np.isnan(volts).all(axis=1).sum() == 27
    assert blocks[-1].next_index == 100


@pytest.mark.parametrize("name", ["labjack", "nidaqmx", "nidaqmx-grpc"])  # a simulated clock gives any rate
def test_actual_rate_is_the_devices(backend: Rig) -> None:
    device = backend.make(rate=backend.refused_rate)
    device.open()
    rate = device.start()
    device.stop()
    device.close()
    assert rate != backend.refused_rate
    assert rate == pytest.approx(backend.refused_rate, rel=0.1)
