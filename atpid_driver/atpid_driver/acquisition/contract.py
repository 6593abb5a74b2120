# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests that the device of every acquisition backend must pass.

Subclass `AcquisitionContract` in a test file; pytest then runs them on the device that `make` returns.
"""

import time
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from atpid_driver.acquisition.protocol import Acquisition, NotStreamingError, WrongDeviceError

BLOCKS = 8


class AcquisitionContract:
    """What `Acquisition` promises without a fault of the device."""

    def make(self, serial: int = 0) -> Acquisition:
        """Return an unopened device that must have the serial number `serial`, 0: any."""
        raise NotImplementedError

    def serial(self) -> int:
        """Return the serial number of the device."""
        raise NotImplementedError

    @pytest.fixture
    def device(self) -> Iterator[Acquisition]:
        """Return any device, opened."""
        with closing(self.make()) as device:
            device.open()
            yield device

    def test_identity_is_the_devices_own(self) -> None:
        """`open` returns the device's serial number."""
        with closing(self.make(serial=self.serial())) as device:
            assert device.open().serial == self.serial()

    def test_blocks_follow_one_another_without_gap(self, device: Acquisition) -> None:
        """Blocks are (n_scans, n_channels), follow one another by index, and come at the rate of the device."""
        began = time.monotonic()
        rate = device.start()
        blocks = [device.read() for _ in range(BLOCKS)]
        elapsed = time.monotonic() - began
        device.stop()
        assert blocks[0].first_index == 0
        assert [block.first_index for block in blocks[1:]] == [block.next_index for block in blocks[:-1]]
        assert all(block.volts.shape[1:] == (len(device.channels),) for block in blocks)
        assert all(block.volts.dtype == np.float64 and block.volts.flags.c_contiguous for block in blocks)
        assert all(block.dropped == 0 and block.backlog >= 0 for block in blocks)
        assert elapsed > 0.9 * blocks[-1].next_index / rate  # paced by the device, not by the reader

    def test_each_channel_has_a_delay(self, device: Acquisition) -> None:
        """`skew` has one delay for each channel, none of them negative."""
        device.start()
        skew = device.skew()
        device.stop()
        assert len(skew) == len(device.channels) == len(set(device.channels))
        assert min(skew) >= 0.0

    def test_a_second_stream_starts_at_index_0(self, device: Acquisition) -> None:
        """Indices begin with 0 after each start."""
        for _ in range(2):
            device.start()
            first = device.read()
            assert first.first_index == 0
            assert device.read().first_index == first.next_index
            device.stop()

    def test_stop_and_close_may_be_repeated(self) -> None:
        """Neither raises an error, in whatever state the device is."""
        device = self.make()
        device.stop()
        device.close()
        device.open()
        device.start()
        for _ in range(2):
            device.stop()
        for _ in range(2):
            device.close()

    def test_reading_without_a_stream_is_refused(self, device: Acquisition) -> None:
        """`read` raises NotStreamingError before `start`."""
        with pytest.raises(NotStreamingError):
            device.read()

    def test_wrong_serial_number_is_named(self) -> None:
        """`open` raises WrongDeviceError: one line with the number found and the one expected."""
        other = self.serial() + 1
        refusal = pytest.raises(WrongDeviceError, match=f"{self.serial()}.*{other}")
        with closing(self.make(serial=other)) as device, refusal as caught:
            device.open()
        assert "\n" not in str(caught.value)
