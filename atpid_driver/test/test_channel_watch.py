# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A laser that dies or freezes while the node streams: event, diagnostics, NaN; and a quiet stand raises none."""

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from acquisition_bench import Bench
from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus

from atpid_driver.nodes.labjack_node import LabJackNode
from atpid_driver.standins import Feed, build

pytestmark = pytest.mark.slow

SUPPORT, BEAM = "support_displacement", "beam_displacement"


class Lasers:
    """Two lasers behind LabJack's own package, which see a stand in the time of the feed: faster than the clock's."""

    def __init__(self, bench: Bench, feed: Feed) -> None:
        self.bench, self.feed, self._random = bench, feed, np.random.default_rng(3)
        self.support: float | None = None  # what the support's laser gives instead of its reading [V]
        channels = {"channels": [SUPPORT, BEAM], "terminals": ["AIN0", "AIN1"]}
        files = {"calibrations": ["laser_support.yaml", "laser_beam.yaml"]}
        library = str(build() / "libLabJackM.so")
        bench.start(LabJackNode, rate=1000.0, library=library, handshake=False, **channels, **files)
        self.until(lambda: bench.blocks)

    def until(self, what: Callable[[], object]) -> None:
        """Let the lasers see noise and a vibration of the beam until something has happened."""
        bench = self.bench

        def happened() -> bool:
            if self.feed.written < 50 * (len(bench.blocks) + 4):
                t = (self.feed.written + np.arange(50)) / 1000.0
                volts = 3.0 + np.outer(np.sin(2.0 * np.pi * 5.5 * t), [0.0, 0.5])
                volts += self._random.normal(0.0, 2.7e-4, volts.shape)
                if self.support is not None:
                    volts[:, 0] = self.support
                self.feed.write(volts)
            return bool(what())

        bench.until(happened)

    def stand(self, seconds: float, support: float | None = None) -> None:
        """Go on for some seconds of the feed."""
        self.support = support
        end = len(self.bench.blocks) + round(seconds / 0.05)
        self.until(lambda: len(self.bench.blocks) >= end)

    def faults(self) -> list[str]:
        return [event.text for event in self.bench.events if event.kind == Event.FAULT]


@pytest.fixture
def lasers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lasers]:
    bench = Bench()
    monkeypatch.setenv("ATPID_LJM_SOURCE", f"feed:{tmp_path / 'feed'}")
    monkeypatch.setenv("ATPID_LJM_CONTROL", str(tmp_path / "no-faults"))
    with closing(Feed(tmp_path / "feed", channels=2, rate=1000.0)) as feed:
        yield Lasers(bench, feed)
        bench.close()


def test_a_support_at_rest_raises_no_alarm(lasers: Lasers) -> None:
    lasers.stand(10.0)
    assert lasers.faults() == []
    lasers.until(lambda: SUPPORT in lasers.bench.channels)
    status = lasers.bench.channels[SUPPORT]
    assert (status.level, status.message) == (DiagnosticStatus.OK, "plausible")


@pytest.mark.parametrize(
    ("volts", "words"),
    [(0.2, "current loop broken: 0.200 V, below 0.9 V"), (3.1, "frozen at 3.100 V: within 0 mV for 1 s")],
)
def test_a_laser_that_dies_is_an_event_a_status_and_nan_and_so_is_its_return(
    lasers: Lasers, volts: float, words: str
) -> None:
    lasers.stand(2.0)
    lasers.stand(2.0, support=volts)
    lasers.until(lasers.faults)
    (fault,) = (event for event in lasers.bench.events if event.kind == Event.FAULT)
    assert (fault.severity, fault.text) == (Event.ALARM, f"{SUPPORT}: {words}")
    assert fault.value == pytest.approx(volts)
    lasers.until(lambda: SUPPORT in lasers.bench.channels)  # at once, not with the next second
    status = lasers.bench.channels[SUPPORT]
    assert (status.level, status.message) == (DiagnosticStatus.ERROR, words)
    assert {pair.key: pair.value for pair in status.values}["reading [V]"] == f"{volts:.4f}"
    assert lasers.bench.channels[BEAM].level == DiagnosticStatus.OK
    data = np.frombuffer(lasers.bench.blocks[-1].data).reshape(-1, 2)
    assert np.isnan(data[:, 0]).all()
    assert np.isfinite(data[:, 1]).all()
    lasers.stand(2.5)
    lasers.until(lambda: lasers.bench.has_event(f"{SUPPORT}: plausible again"))
    lasers.stand(0.1)
    assert np.isfinite(np.frombuffer(lasers.bench.blocks[-1].data)).all()
    assert len(lasers.faults()) == 1
