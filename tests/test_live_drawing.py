# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What Chromium draws of a view whose every number is known: traces, spectrum, shares, states, layout."""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import CeilingCommand, CeilingState, Excitation, SampleBlock, SupervisorState
from std_msgs.msg import Header
from test_live_page import visited

from atpid_common.nodes.messages import doubles, time_of
from atpid_control.views.live.address import Address
from atpid_control.views.live.server import LiveServer
from atpid_control.views.live.view import LiveView
from atpid_sim.modal import bare_amplitude
from atpid_sim.scene import Scene, load_scene

pytestmark = pytest.mark.slow
#: Of the support [m] and the excitation [Hz], scans a second [Hz] and in a block, and the first scan of a lost block.
SUPPORT, FREQUENCY, RATE, BLOCK, LOST = 0.00150034, 94.0, 2000.0, 100, 9500
#: Of the beam against the structure without the damper [-].
MORE = 1.2
#: The page's motor state holds for longer than a visit [s].
LATER = 1e6


def header(seconds: float) -> Header:
    return Header(stamp=time_of(round(seconds * 1e9)))


def stiff(scenes: Path) -> Scene:
    """A beam of 100 Hz, 95 Hz with the damper closed."""
    beam = {"mass": 0.3258, "stiffness": 0.3258 * (200.0 * math.pi) ** 2, "damping": 4.0}
    return load_scene(scenes / "standard.yaml").with_(beam=beam)


def beam_of(scene: Scene) -> float:
    beam = scene.beam
    return MORE * bare_amplitude(beam.mass, beam.stiffness, beam.damping, SUPPORT, FREQUENCY)


def view_of(
    scene: Scene,
    motor: dict[str, Any],
    supervisor: int = SupervisorState.READY,
    quality: int = Excitation.STEADY,
) -> LiveView:
    """Return five seconds of a tone with a second harmonic in the beam, one block lost, and the state of the graph."""
    view, amplitude, begun = LiveView(scene), beam_of(scene), time.monotonic() + LATER
    for first in range(0, 10_000, BLOCK):
        angle = 2.0 * np.pi * FREQUENCY * (first + np.arange(BLOCK)) / RATE
        values = np.stack([SUPPORT * np.sin(angle), amplitude * (np.cos(angle) + 1e-3 * np.cos(2.0 * angle))], axis=1)
        block = SampleBlock(header=header(100.0 + first / RATE), first_index=first, rate=RATE, data=doubles(values),
                            channels=["support_displacement", "beam_displacement"])  # fmt: skip
        if first != LOST:
            view.on_block(block, begun)
    view.on_excitation(
        Excitation(header=header(105.0), quality=quality, amplitude=SUPPORT, amplitude_std=1.23e-6,
                   frequency=FREQUENCY, frequency_std=3.7e-3, beam_amplitude=amplitude), begun,
    )  # fmt: skip
    states = {
        "ceiling/command": CeilingCommand(header=header(105.0), height=math.nan, method="lookup",
                                          reason="held by the operator"),
        "ceiling/state": CeilingState(header=header(105.0), homed=True, height=0.024, target=0.024, **motor),
        "supervisor/state": SupervisorState(header=header(105.0), state=supervisor),
    }  # fmt: skip
    for topic, message in states.items():
        view.on_state(topic, message, begun)
    return view


def seen_of(view: LiveView) -> Any:
    server = LiveServer(view, lambda _request, _answer: None, Address(port=0), ("lookup",))
    try:
        return visited(server.address.url)
    finally:
        server.close()


@pytest.fixture(scope="module")
def seen(scenes: Path) -> Any:
    return seen_of(view_of(stiff(scenes), {"mode": CeilingState.HOLDING}))


@pytest.fixture(scope="module")
def stopped(scenes: Path) -> Any:
    """An emergency stop, and no steady estimate."""
    motor = {"mode": CeilingState.FAULT, "fault": "emergency stop"}
    return seen_of(view_of(stiff(scenes), motor, quality=Excitation.POOR))


def traced(shown: Any, scenes: Path) -> float:
    """Return the length of the traces [s], both of which have their amplitude and the gap of the lost block."""
    for (times, values), amplitude in zip(shown["lines"], (SUPPORT, beam_of(stiff(scenes))), strict=True):
        known = [value for value in values if value is not None]
        assert max(known) == pytest.approx(1e3 * amplitude, rel=5e-3)
        assert min(known) == pytest.approx(-1e3 * amplitude, rel=5e-3)
        assert times == sorted(times)
        (gap,) = [at for at, value in zip(times, values, strict=True) if value is None]
        assert LOST / RATE - 1e-3 <= gap < (LOST + BLOCK) / RATE
    return float(shown["x"][1] - shown["x"][0])


def test_a_fast_trace_keeps_its_amplitude_and_its_gap(seen: Any, scenes: Path) -> None:
    shown = seen["plots"]["motion"]
    periods = traced(shown, scenes) * FREQUENCY
    assert 10.0 < periods < 60.0
    assert all(len(times) > 4.0 * 0.5 * periods for times, _ in shown["lines"])


def test_periods_too_many_for_the_pixels_are_an_envelope(stopped: Any, scenes: Path) -> None:
    """Without a steady estimate 5 s are shown, 470 periods: both extremes in every two of them."""
    shown = stopped["plots"]["motion"]
    assert traced(shown, scenes) == pytest.approx(5.0)
    for times, values in shown["lines"]:
        assert 1000 < len(times) < 2500
        cuts = np.searchsorted(times, np.arange(times[0] + 0.025, LOST / RATE, 0.025))  # two periods each
        for part in np.split(np.array(values, dtype=float), cuts)[:-1]:
            assert part.max() > 0.95 * np.nanmax(np.array(values, dtype=float))
            assert part.min() < 0.95 * np.nanmin(np.array(values, dtype=float))
    assert stopped["texts"]["reduction"] == stopped["texts"]["efficiency"] == "–"


def test_the_spectrum_shows_harmonics_over_five_decades(seen: Any) -> None:
    shown = seen["plots"]["plot-spectrum"]
    frequencies, beam = map(np.array, shown["lines"][1])
    assert (shown["type"], shown["y"][1] - shown["y"][0]) == ("log", 5)
    assert shown["x"][1] > 900.0
    second = beam[np.abs(frequencies - 2.0 * FREQUENCY) < 3.0].max()
    assert second == pytest.approx(beam.max() * 1e-3, rel=0.1)
    assert second > 10.0 ** shown["y"][0]


def test_a_damper_that_makes_it_worse_is_named_and_its_axis_has_whole_steps(seen: Any) -> None:
    texts = seen["texts"]
    assert texts["reduction"] == "−20 %; −20 %: worse than without"
    assert texts["efficiency"].count("%") == 2
    assert not texts["efficiency"].startswith("−")
    assert seen["classes"]["reduction"] == "bad"
    assert seen["classes"]["efficiency"] in (None, "")
    assert float(texts["beam"].split()[0]) == pytest.approx(MORE * float(texts["bare"].split()[0]), rel=0.01)
    assert float(texts["closed"].split()[0]) > float(texts["beam"].split()[0])
    assert seen["plots"]["plot-efficiency"]["y"] == [-55, 105]


def test_values_have_the_figures_of_their_deviation_and_the_scale_suits_the_clearance(seen: Any) -> None:
    texts = seen["texts"]
    assert texts["excitation"] == "1.5003 ± 0.0012 mm, steady"
    assert texts["frequency"] == "94.000 ± 0.004 Hz"
    assert texts["power"] == "on, at rest"
    assert texts["hold"] == "End the hold"
    assert seen["scale"] == "5 mm"  # of 7 mm between grain and ceiling


def test_no_cell_of_the_page_is_empty(seen: Any) -> None:
    for width, gaps in seen["gaps"].items():
        assert gaps == pytest.approx([0.0] * len(gaps), abs=1.0), width


def test_connected_is_green_only_while_all_is_well(seen: Any, stopped: Any, scenes: Path) -> None:
    motor = {"mode": CeilingState.HOLDING}
    degraded = seen_of(view_of(stiff(scenes), motor, SupervisorState.DEGRADED))
    for shown, text, style in (
        (seen, "Connected", "good"),
        (stopped, "Connected; motor off: emergency stop", "bad"),
        (degraded, "Connected; supervisor: degraded", ""),
    ):
        assert (shown["link"], shown["class"]) == (text, style)
        assert "Stop the motor" in shown["buttons"]
