# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live page's view model: what is shown of known messages."""

import json
import math
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_control.views.live.address import LiveError
from atpid_control.views.live.requests import HoldRequest, Note, read_request
from atpid_control.views.live.signals import LINES, RATE, WINDOW, LastSamples, highest, spectrum, thinned
from atpid_control.views.live.state import shares_of
from atpid_control.views.live.view import LiveView
from atpid_sim.modal import bare_amplitude
from atpid_sim.scene import load_scene
from atpid_sim.simulation.simulate import simulate

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def header(time: float) -> Any:
    return SimpleNamespace(stamp=SimpleNamespace(sec=int(time), nanosec=round((time % 1.0) * 1e9)), frame_id="")


def block(first: int, values: np.ndarray[Any, Any], rate: float = 1000.0) -> Any:
    """A block of support and beam (n, 2) [m], stamped from 100 s on."""
    names = ["beam_displacement", "support_displacement"]
    data = np.ascontiguousarray(values[:, ::-1]).tobytes()
    return SimpleNamespace(header=header(100.0 + first / rate), first_index=first, rate=rate, channels=names, data=data)


def event(text: str, kind: str = "rumble") -> Any:
    return SimpleNamespace(header=header(101.0), node="identifier_node", kind=kind, severity=1, text=text)


def excitation(at: float) -> Any:
    values = {"amplitude": 0.01, "amplitude_std": 1e-5, "frequency": 5.47, "frequency_std": 1e-3}
    return SimpleNamespace(header=header(at), quality=1, origin=0, beam_amplitude=0.05, **values)


def motor(mode: int = 3) -> Any:
    heights = {"height": 0.3, "target": math.nan, "speed": 0.3}
    return SimpleNamespace(header=header(100.5), mode=mode, homed=True, fault="", **heights)


def supervisor(**silence: float) -> Any:
    nodes = {"nodes": list(silence), "silence": list(silence.values())}
    return SimpleNamespace(header=header(100.0), state=1, permit=True, reason="", **nodes)


def tone(count: int, first: int = 0) -> np.ndarray[Any, Any]:
    time = (first + np.arange(count)) / 1000.0
    return np.stack([0.01 * np.sin(2 * np.pi * 5.5 * time), 0.06 * np.cos(2 * np.pi * 5.5 * time)], axis=1)


@given(first=st.integers(0, 10_000), length=st.integers(1, 200), rate=st.sampled_from([200.0, 1000.0, 3000.0, 12800.0]))
def test_thinned_blocks_keep_extremes_and_are_scans_at_their_own_times(first: int, length: int, rate: float) -> None:
    time = (first + np.arange(length)) / rate
    values = np.stack([np.sin(2 * np.pi * 94.0 * time), np.cos(2 * np.pi * 31.0 * time)], axis=1)
    values[::7, 0] = np.nan
    times, rows = thinned(first, rate, values)
    scans = np.round(times * rate).astype(int) - first
    assert np.all(np.diff(scans) > 0)
    assert np.array_equal(rows, values[scans], equal_nan=True)
    for column in (0, 1):
        if np.isfinite(values[:, column]).any():
            assert np.nanmin(rows[:, column]) == np.nanmin(values[:, column])
            assert np.nanmax(rows[:, column]) == np.nanmax(values[:, column])
    assert len(rows) <= length if rate <= RATE else len(rows) <= min(length, RATE * length / rate + 8)


@pytest.mark.parametrize("frequency", [2.0, 5.473, 31.7, 94.0])
@pytest.mark.parametrize("rate", [400.0, 1000.0, 12800.0])
def test_a_tone_has_its_amplitude_and_frequency_in_the_spectrum(frequency: float, rate: float) -> None:
    time = np.arange(0.0, WINDOW, 1.0 / rate)
    end = highest(frequency, rate)
    found = spectrum(0.3 + 0.04 * np.sin(2 * np.pi * frequency * time + 1.0), rate, end)
    assert found is not None
    assert len(found[0]) <= LINES
    top = int(np.argmax(found[1]))
    assert found[1][top] == pytest.approx(0.04, rel=0.02)
    assert found[0][top] == pytest.approx(frequency, abs=max(0.07, end / LINES))


def test_a_harmonic_of_a_thousandth_is_in_the_spectrum_of_blocks_one_of_which_was_lost() -> None:
    samples = LastSamples()
    for first in range(0, 5000, 50):
        time = (first + np.arange(50)) / 1000.0
        tones = np.sin(2 * np.pi * 29.4 * time) + 1e-3 * np.sin(2 * np.pi * 88.2 * time)
        if first != 800:  # which the window has left
            samples.add(first, 1000.0, np.stack([tones, np.full(50, np.nan)], axis=1))
    found = samples.spectra(29.4)
    assert found is not None
    frequencies, (support, beam) = found
    assert beam is None  # it is not measured
    assert support is not None
    near = np.abs(frequencies - 88.2) < 2.0
    assert support[near].max() == pytest.approx(1e-3, rel=0.05)
    assert support[np.abs(frequencies - 70.0) < 2.0].max() < 1e-5
    assert frequencies[-1] > 490.0


def test_there_is_no_spectrum_of_too_little() -> None:
    samples = LastSamples()
    assert samples.spectra(5.0) is None
    samples.add(0, 1000.0, tone(3999))
    assert samples.spectra(5.0) is None
    samples.add(3999, 1000.0, tone(1, 3999))
    assert samples.spectra(5.0) is not None
    samples.add(4500, 1000.0, tone(50, 4500))  # an eighth is lost
    assert samples.spectra(5.0) is None
    samples.add(10**12, 1000.0, tone(50))
    assert len(samples.values) == 4000
    samples.add(10**12 + 50, 500.0, tone(50))  # another rate
    assert len(samples.values) == 50


def test_efficiency_and_reduction_are_those_of_the_simulation() -> None:
    scene = load_scene(SCENES / "standard.yaml")
    found = simulate(scene)
    shares = shares_of(scene)
    for name, reference, share in (
        ("efficiency", found.undamped_amplitude, found.efficiency),
        ("reduction", found.bare_amplitude, found.reduction),
    ):
        so_far = shares[name]
        so_far.add(0.01, scene.frequency_hz, found.amplitude)
        assert so_far.reference == pytest.approx(reference, rel=0.01)
        assert so_far.now == pytest.approx(share, abs=0.01)
        so_far.add(0.01, scene.frequency_hz, reference)
        so_far.add(0.01, scene.frequency_hz, math.nan)
        assert math.isnan(so_far.now)
        assert so_far.mean == pytest.approx(0.5 * share, abs=0.01)
        so_far.restart()
        assert math.isnan(so_far.mean)
    assert shares_of(None) == {}


def test_the_page_shows_what_came_and_only_what_is_new() -> None:
    scene = load_scene(SCENES / "standard.yaml")
    view = LiveView(scene)
    for k in range(100):
        view.on_block(block(50 * k, tone(50, 50 * k)), 0.05 * k)
    view.on_excitation(excitation(104.0), 5.0)
    view.on_event(event("rumble"), 5.0)
    view.on_event(event("rumble"), 5.0)  # sent again to a late reader
    first = view.news(5.0)
    assert json.loads(json.dumps(first, allow_nan=False)) == json.loads(json.dumps(first))
    motion = np.array(first["rows"]["motion"], dtype=float)
    assert len(motion) == 5000
    assert motion[:, 1] == pytest.approx(0.01 * np.sin(2 * np.pi * 5.5 * motion[:, 0]), abs=1e-9)
    assert [shown["text"] for shown in first["events"]] == ["rumble"]
    assert first["rows"]["excitation"] == [(4.0, 0.01, 1e-5)]
    for name, mass in (("efficiency", scene.total_mass), ("reduction", scene.beam.mass)):
        reference = bare_amplitude(mass, scene.beam.stiffness, scene.beam.damping, 0.01, 5.47)
        share = 1.0 - 0.05 / reference
        shown = {"now": share, "mean": share, "reference": reference}
        assert first["state"][name] == pytest.approx(shown, abs=1e-9)
    row = [first["state"][name]["now"] for name in ("efficiency", "reduction")]
    assert first["rows"]["efficiency"] == [(4.0, *row)]
    assert max(first["spectrum"]["beam"]) == pytest.approx(0.06, rel=0.03)
    second = view.news(5.0)
    assert (second["rows"], second["events"], second["spectrum"]) == ({}, [], None)
    assert view.everything(5.0)["spectrum"] == first["spectrum"]  # for a browser that has just come
    assert view.news(6.0)["spectrum"] is not None
    assert len(view.everything(5.0)["rows"]["motion"]) == 5000


def test_a_stream_that_begins_again_is_another_run_without_the_command_and_the_estimate_of_the_last() -> None:
    view = LiveView(None)
    view.on_block(block(0, tone(500)), 0.0)
    view.on_excitation(excitation(100.5), 0.1)
    command = SimpleNamespace(
        header=header(100.5), height=0.3, method="direct", reason="steady", predicted_amplitude=0.01
    )
    view.on_state("ceiling/command", command, 0.1)
    view.on_state("ceiling/state", motor(), 0.1)
    view.on_event(event("60 s", "finished"), 0.1)
    assert view.everything(0.1)["state"]["finished"] == "60 s"
    view.on_block(block(0, tone(50)), 0.2)
    shown = view.everything(0.2)
    state = shown["state"]
    assert (shown["run"], len(shown["rows"]["motion"]), state["finished"]) == (2, 50, "")
    assert not any(state[name] for name in ("command", "excitation", "efficiency", "reduction"))
    assert state["motor"]["mode"] == "holding"  # it is the same motor


def test_lost_blocks_are_a_gap_in_the_lines() -> None:
    view = LiveView(None)
    for first in (0, 50, 150):  # the block from 100 on is lost
        view.on_block(block(first, tone(50, first)), 0.0)
        truth: Any = SimpleNamespace(header=header(100.0 + first / 1000.0), first_index=first, rate=1000.0,
                                     grain=np.zeros(50), ceiling=np.ones(50))  # fmt: skip
        view.on_truth(truth, 0.0)
    rows = view.everything(0.0)["rows"]
    for name in ("motion", "truth"):
        times = [row[0] for row in rows[name]]
        assert times == sorted(times)
        (gap,) = [row for row in rows[name] if row[1:] == (None, None)]
        assert 0.1 <= gap[0] < 0.15
    for time in (100.2, 100.5, 105.0):
        view.on_excitation(excitation(time), 0.0)
    assert [row[1] is None for row in view.everything(0.0)["rows"]["excitation"]] == [False, False, True, False]


def test_a_motor_that_is_off_is_not_shown_as_well() -> None:
    view = LiveView(None)
    view.on_state("supervisor/state", supervisor(motor_node=0.02), 1.0)
    for mode in range(6):
        view.on_state("ceiling/state", motor(mode), 1.0)
        state = view.everything(1.0)["state"]
        (node,) = [one for one in state["nodes"] if one["name"] == "motor_node"]
        on = mode in (2, 3, 4)
        assert (state["motor"]["on"], node["well"], node["text"].endswith(" off")) == (on, on, not on)


def test_what_falls_silent_is_named() -> None:
    def of(name: str) -> Any:
        (found,) = [node for node in state["nodes"] if node["name"] == name]
        return found

    view = LiveView(None)
    assert not view.everything(0.0)["state"]["seen"]
    status = SimpleNamespace(name="motor_node: link", level=b"\x02", message="mute")
    nodes = supervisor(motor_node=0.02, plant_node=0.9)
    view.on_block(block(0, tone(50)), 10.0)
    view.on_state("supervisor/state", nodes, 10.0)
    view.on_diagnostics(SimpleNamespace(status=[status]), 10.0)
    state = view.everything(10.1)["state"]
    assert state["silent"] == {}
    assert not of("motor_node")["well"]
    assert all(part in of("motor_node")["text"] for part in ("answers", "link", "error", "mute"))
    assert "0.9 s" in of("plant_node")["text"]
    assert of("supervisor_node")["well"]
    view.on_state("supervisor/state", nodes, 12.0)
    state = view.everything(12.0)["state"]
    assert state["silent"] == {"sensors/laser": 2.0}
    assert not state["lost"]
    state = view.everything(15.5)["state"]
    assert state["lost"]
    assert not any(node["well"] for node in state["nodes"])
    assert "supervisor" in of("plant_node")["text"]


def test_requests_are_read_as_they_are_meant() -> None:
    assert read_request('{"number": 1, "do": "hold", "on": true}') == HoldRequest(number=1, do="hold", on=True)
    noted = read_request('{"number": 2, "do": "note", "text": " screw "}')
    assert noted == Note(number=2, do="note", text="screw")


@pytest.mark.parametrize("text", [
    "", "[]", "{", '{"number": 1}', '{"number": 1, "do": "explode"}', '{"number": -1, "do": "stop"}',
    '{"number": 1, "do": "stop", "more": 1}', '{"number": 1, "do": "hold", "on": 1}',
    '{"number": 1, "do": "note", "text": "  "}', '{"number": 1, "do": "note", "text": "a\\nb"}',
    '{"number": 1, "do": "note", "text": "' + 201 * "a" + '"}', b"\xff",
])  # fmt: skip
def test_a_request_that_cannot_be_is_one_line(text: str | bytes) -> None:
    with pytest.raises(LiveError, match=r"^.*$"):
        read_request(text)


@given(st.binary(max_size=300) | st.text(max_size=300))
def test_no_request_is_anything_but_read_or_refused(text: str | bytes) -> None:
    with suppress(LiveError):
        read_request(text)
