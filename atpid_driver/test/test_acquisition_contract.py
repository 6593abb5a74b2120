# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every acquisition backend promises, each tried on the code that runs on the stand."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from acquisition_rigs import BACKENDS, Rig, rig

from atpid_driver.acquisition import Acquisition, AcquisitionError, DeviceMissingError, StreamLostError
from atpid_driver.acquisition.contract import AcquisitionContract


@pytest.fixture
def backend(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    with rig(name, tmp_path, monkeypatch) as made:
        yield made


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    subset = metafunc.definition.get_closest_marker("parametrize")
    if "backend" in metafunc.fixturenames and subset is None:
        metafunc.parametrize("name", BACKENDS)


def read_blocks(device: Acquisition, count: int) -> None:
    for _ in range(count):
        device.read()


def one_line(error: BaseException) -> bool:
    return "\n" not in str(error) and 10 < len(str(error)) < 220


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
    device.open()
    rate = device.start()
    volts = np.concatenate([device.read().volts for _ in range(8)])
    device.stop()
    device.close()
    step = np.arange(len(volts))[:, None] / rate + np.array(device.skew())
    expected = 3.0 + np.sin(2 * np.pi * 5.0 * step + np.arange(2) * np.pi / 4)
    assert np.abs(volts - expected).max() < 1e-9


def test_missing_device_is_named(backend: Rig) -> None:
    backend.unplug()
    with pytest.raises(DeviceMissingError) as caught:
        backend.make().open()
    assert one_line(caught.value)
    backend.replug()
    device = backend.make()
    device.open()
    device.close()


def test_unplugged_in_mid_stream_ends_it_and_replugged_works_again(backend: Rig) -> None:
    device = backend.make()
    device.open()
    device.start()
    device.read()
    backend.unplug()
    with pytest.raises((StreamLostError, DeviceMissingError)) as caught:
        read_blocks(device, 100)
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["labjack", "nidaqmx", "nidaqmx-grpc"])  # a simulated clock gives any rate
def test_actual_rate_is_the_devices(backend: Rig) -> None:
    device = backend.make(rate=backend.refused_rate)
    device.open()
    rate = device.start()
    device.stop()
    device.close()
    assert rate != backend.refused_rate
    assert rate == pytest.approx(backend.refused_rate, rel=0.1)
