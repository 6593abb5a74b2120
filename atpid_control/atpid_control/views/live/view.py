# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The view model: from the graph's messages to what the page shows; read by their fields alone, so it is free of ROS.

Times on the page are seconds since the run's first sample, by the stamps; how old a message is, is by the steady clock.
Messages come in one thread and the page is asked for in another: every method may be called in either.
"""

import math
import threading
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from atpid_common.files import Document
from atpid_common.vocabulary import DRIVES, EventKind, Quality, Severity
from atpid_control.views.live.signals import LastSamples, Row, Rows, plain, thinned
from atpid_control.views.live.state import GraphState, shares_of
from atpid_sim.scene import Scene
from atpid_sim.system import Array

if TYPE_CHECKING:
    from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, Excitation, PlantTruth, SampleBlock

    Samples = SampleBlock | PlantTruth
    Stamped = Samples | CeilingCommand | CeilingState | Event | Excitation

BEAM = "beam_displacement"
#: Rows of samples that are kept: 6 s of the traces, and 1 s of what only the picture of the damper shows.
_MOTION, _TRUTH = 6000, 1000
#: The long plots: time between two rows [s], how many are kept (5 min), and silence that is a gap [s].
_SPACING, _LONG, _GAP = 0.1, 3000, 1.0
_EVENTS = 200
#: Between two spectra [s].
_SPECTRUM = 0.5
#: Topics whose heights are plotted, with the name of their rows.
_HEIGHTS = {"ceiling/command": "command", "ceiling/state": "ceiling"}

#: Frequency [Hz], and amplitudes of drive [m or N] and beam [m], one of which may be None; None: there is none yet.
Spectrum = Document | None


class LiveView:
    """What the page shows, of the last seconds, and what of it is new."""

    def __init__(self, scene: Scene | None = None) -> None:
        """Take the scene, for efficiency and reduction; None: they are not known."""
        self._lock = threading.Lock()
        self._scene, self._shares = scene, shares_of(scene)
        self._rows = {
            "motion": Rows(_MOTION),  # support [m] or force [N], beam [m]
            "truth": Rows(_TRUTH),  # grain, ceiling above the floor [m]
            "excitation": Rows(_LONG, _SPACING, _GAP),  # amplitude, its standard deviation [m or N]
            "command": Rows(_LONG, _SPACING, _GAP),  # height [m]
            "ceiling": Rows(_LONG, _SPACING, _GAP),  # height [m]
            "efficiency": Rows(_LONG, _SPACING, _GAP),  # efficiency, reduction [-]
        }
        self._state, self._drive = GraphState(), scene.driven_by if scene else DRIVES["support"]
        self._events: deque[Document] = deque(maxlen=_EVENTS)
        self._new_events: deque[Document] = deque(maxlen=_EVENTS)
        self._seen_events: deque[tuple[int, str, str, str]] = deque(maxlen=4 * _EVENTS)
        self._origin_ns: int | None = None
        self._last_index: dict[str, int] = {}  # of each stream
        self._run, self._counted = 0, 0
        self._samples, self._frequency = LastSamples(), math.nan  # of the last steady estimate [Hz]
        self._spectrum_at = -math.inf
        self._spectrum: Spectrum = None

    # messages, each with the steady time of its receipt [s]

    def on_block(self, block: "SampleBlock", now: float) -> None:
        """Take a SampleBlock of sensors/laser; one whose index goes back begins another run."""
        with self._lock:
            self._state.on_message("sensors/laser", block, now)
            if self._origin_ns is None or block.first_index <= self._last_index["motion"]:
                self._begin(_nanoseconds(block))
            names = list(block.channels)
            data = np.frombuffer(block.data, dtype=np.float64).reshape(-1, len(names))
            self._drive = next((drive for drive in DRIVES.values() if drive.channel in names), self._drive)
            unknown = np.full(len(data), np.nan)
            wanted = (self._drive.channel, BEAM)
            chosen = np.stack([data[:, names.index(name)] if name in names else unknown for name in wanted], axis=1)
            self._samples.add(block.first_index, block.rate, chosen)
            self._add_samples("motion", block, chosen)

    def on_truth(self, truth: "PlantTruth", now: float) -> None:
        """Take a PlantTruth: grain and ceiling as they are simulated."""
        del now
        with self._lock:
            if self._origin_ns is not None:
                self._add_samples("truth", truth, np.stack([np.asarray(truth.grain), np.asarray(truth.ceiling)], 1))

    def on_excitation(self, excitation: "Excitation", now: float) -> None:
        """Take an Excitation; a steady one gives an efficiency and a reduction."""
        with self._lock:
            self._state.on_message("excitation", excitation, now)
            values = (excitation.amplitude, excitation.frequency, excitation.beam_amplitude)
            if excitation.quality == Quality.STEADY:
                self._frequency = excitation.frequency
                for name, share in self._shares.items():
                    share.add(*values)
                    self._state.on_share(name, now=share.now, mean=share.mean, reference=share.reference)
                if self._shares:
                    self._add("efficiency", excitation, *(share.now for share in self._shares.values()))
            self._add("excitation", excitation, excitation.amplitude, excitation.amplitude_std)

    def on_state(self, topic: str, message: Any, now: float) -> None:
        """Take a CeilingCommand, CeilingState, SupervisorState or RecorderStatus, by its topic."""
        with self._lock:
            self._state.on_message(topic, message, now)
            if topic in _HEIGHTS:
                self._add(_HEIGHTS[topic], message, message.height)

    def on_diagnostics(self, array: Any, now: float) -> None:
        """Take a DiagnosticArray."""
        with self._lock:
            self._state.on_diagnostics(array, now)

    def on_event(self, event: "Event", now: float) -> None:
        """Take an Event; one that a late discovery repeats is not shown twice."""
        del now
        with self._lock:
            stamp = _nanoseconds(event)
            key = (stamp, event.node, event.kind, event.text)
            if key in self._seen_events:
                return
            self._seen_events.append(key)
            if event.kind == EventKind.FINISHED:
                self._state.finished = event.text or "the run is over"
            self._counted += 1
            shown: Document = {"number": self._counted, "at": stamp * 1e-9, "from": event.node, "kind": event.kind}
            shown |= {"severity": Severity(event.severity).name.lower(), "text": event.text}
            self._events.append(shown)
            self._new_events.append(shown)

    # the page

    def everything(self, now: float) -> Document:
        """Return all that a browser needs that has just come, at the steady time `now` [s]."""
        with self._lock:
            rows = {name: rows.all() for name, rows in self._rows.items()}
            self._renew_spectrum(now)
            return self._message("all", rows, list(self._events), self._spectrum, now)

    def news(self, now: float) -> Document:
        """Return what is new since the last call."""
        with self._lock:
            rows = {name: rows.take() for name, rows in self._rows.items()}
            events = list(self._new_events)
            self._new_events.clear()
            # one that has been sent is not sent again: the browser would draw it again
            return self._message("news", rows, events, self._spectrum if self._renew_spectrum(now) else None, now)

    def drop_news(self) -> None:
        """Forget what is new: no browser is connected, and one that connects is sent everything."""
        with self._lock:
            for rows in self._rows.values():
                rows.take()
            self._new_events.clear()

    def _message(
        self, kind: str, rows: dict[str, Sequence[Row]], events: list[Document], spectrum: Spectrum, now: float
    ) -> Document:
        origin = None if self._origin_ns is None else self._origin_ns * 1e-9
        radius = self._scene.grain.radius if self._scene is not None else None
        drive = {"name": self._drive.name, "unit": self._drive.unit}
        about = {"type": kind, "run": self._run, "origin": origin, "radius": radius, "drive": drive}
        drawn = {name: found for name, found in rows.items() if found}
        return about | {"rows": drawn, "events": events, "state": self._state.shown(now), "spectrum": spectrum}

    def _renew_spectrum(self, now: float) -> bool:
        """Compute the spectra of the last seconds anew where they are due; return whether they were."""
        if now < self._spectrum_at + _SPECTRUM:
            return False
        self._spectrum_at, self._spectrum = now, None
        found = self._samples.spectra(self._frequency)
        if found is not None:
            frequencies, amplitudes = found
            self._spectrum = {"frequency": list(map(plain, frequencies))}
            for name, lines in zip(("support", "beam"), amplitudes, strict=True):
                self._spectrum[name] = None if lines is None else [float(f"{line:.4g}") for line in lines]
        return True

    def _begin(self, origin_ns: int) -> None:
        """Begin another run."""
        if self._origin_ns is not None:
            for share in self._shares.values():
                share.restart()
            self._samples.clear()
            self._frequency = math.nan
            self._state.restart()
            self._spectrum_at, self._spectrum = -math.inf, None
        self._last_index.clear()
        self._origin_ns, self._run = origin_ns, self._run + 1
        for rows in self._rows.values():
            rows.clear()

    def _add(self, name: str, message: "Stamped", *values: float) -> None:
        if self._origin_ns is not None:
            self._rows[name].add((_nanoseconds(message) - self._origin_ns) * 1e-9, *values)

    def _add_samples(self, name: str, message: "Samples", values: Array) -> None:
        assert self._origin_ns is not None
        begin = (_nanoseconds(message) - self._origin_ns) * 1e-9 - message.first_index / message.rate
        if message.first_index > self._last_index.get(name, math.inf) + 1:  # a block was lost
            self._rows[name].add_gap(begin + (message.first_index - 1) / message.rate)
        self._last_index[name] = message.first_index + len(values) - 1
        for time, row in zip(*thinned(message.first_index, message.rate, values), strict=True):
            self._rows[name].add(begin + float(time), *row)


def _nanoseconds(message: "Stamped") -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
