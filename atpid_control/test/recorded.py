# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags made without ROS for the tests of recording, reading and reporting: serialised by the bag's own schemas."""

import gc
import tracemalloc
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.cli import main
from atpid_control.recording.session import RecordingSession
from atpid_control.runs.decode import message_type
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.topics import DEFAULT, Topic, parse, stamp
from atpid_control.runs.writer import BagWriter
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import laser_of
from atpid_sim.scene import Scene, load_scene

PACKAGE = "atpid_interfaces/msg"
LASER, STATES, EVENTS = "/sensors/laser", "/ceiling/state", "/events"
KINDS = {
    LASER: "SampleBlock", "/sensors/force": "SampleBlock", STATES: "CeilingState", EVENTS: "Event",
    "/excitation": "Excitation",
}  # fmt: skip
STEADY, MOVING, HOLDING = 1, 4, 3
_STORE = get_typestore(Stores.EMPTY)
Capture = pytest.CaptureFixture[str]

SHORT = """
beam:       {mass: 0.3258, stiffness: 427.6, damping: 0.56}
grain:      {mass_fraction: 0.1, radius: 0.0085}
contact:    {law: tsuji, young_modulus: 2.1e8, poisson_ratio: 0.2, damping_ratio: 1.0}
excitation:
  amplitude: [[0.0, 0.0], [0.5, 0.01], [4.0, 0.01], [4.5, 0.02], [8.0, 0.02]]
  frequency: resonance
ceiling:    {closed: 0.017, range: [0.017, 1.0], speed: 0.3, controller: lookup}
gravity:    9.81
duration:   8.0
steady_window: [7.0, 8.0]
tolerance:  1.0e-4
sensors:    {laser: {noise: 20.0e-6}}
seed:       1
"""


def short(folder: Path, seconds: float) -> Path:
    """Write the short scene with another duration into `folder`; return the file."""
    path = folder / "short.yaml"
    times = f"{seconds}\nsteady_window: [{seconds - 1.0}, {seconds}]"
    path.write_text(SHORT.replace("8.0\nsteady_window: [7.0, 8.0]", times))
    return path


def make(message: str, /, stamp_ns: int = 0, sender: str = "", frame_id: str = "", **fields: Any) -> bytes:
    """Return a serialised message of atpid_interfaces/msg/`message`; fields not given are zero or empty.

    sender: its device or node, of a message that has one.
    """
    name = f"{PACKAGE}/{message}"
    if name not in _STORE.types:
        found = get_types_from_msg(message_type(name).definition, name)
        _STORE.register({key: value for key, value in found.items() if key not in _STORE.fielddefs})
    stamp = _new("builtin_interfaces/msg/Time", sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)
    own = [field for field, _ in _STORE.fielddefs[name][1] if field in ("device", "node")]
    fields = dict.fromkeys(own, sender) | fields
    header = _new("std_msgs/msg/Header", frame_id=frame_id, stamp=stamp)
    return bytes(_STORE.serialize_cdr(_new(name, header=header, **fields), name))


def _new(name: str, **fields: Any) -> Any:
    values: dict[str, Any] = {}
    for key, (node, description) in _STORE.fielddefs[name][1]:
        values[key] = fields.pop(key) if key in fields else _zero(node.name, description)
    assert not fields, f"{name} has no {fields}"
    return _STORE.types[name](**values)


def _zero(node: str, description: Any) -> Any:
    if node == "NAME":
        return _new(description)
    if node == "SEQUENCE":
        return [] if description[0][1][0] == "string" else np.zeros(0)
    return {"string": "", "bool": False}.get(description[0], 0)


def block(index: int, data: Any, rate: float = 1000.0, start_ns: int = 0, **fields: Any) -> bytes:
    """Return a laser's block with `data` (n, 2) that begins at scan `index`."""
    stamp = start_ns + round(index / rate * 1e9)
    given: dict[str, Any] = {
        "channels": ["support_displacement", "beam_displacement"],
        "units": ["m", "m"],
        "skew": np.zeros(2),
    } | fields
    return make("SampleBlock", stamp, "plant:laser", first_index=index, rate=rate, data=np.ravel(data), **given)


def begin_bag(
    folder: Path, messages: Iterable[tuple[str, bytes]] = (), *, topics: Iterable[str] = (LASER,), each: int = 0,
    run_id: str = "small", **how: Any,
) -> BagWriter:  # fmt: skip
    """Begin a bag with messages (topic, data), logged at their stamps, `each` of them to a chunk; return its writer."""
    writer = BagWriter(folder, new_run(run_id=run_id, commit="none", chunk_period="0.02"), **how)
    for topic in topics:
        writer.add_topic(topic, f"{PACKAGE}/{KINDS[topic]}")
    for number, (topic, data) in enumerate(messages, 1):
        writer.write(topic, data, stamp(data), stamp(data))
        if each and number % each == 0:
            writer.end_chunk()
    return writer


def write_bag(
    folder: Path, messages: Iterable[tuple[str, bytes]] = (), result: Mapping[str, str] | None = None, **how: Any
) -> Path:
    """Write a whole bag as `begin_bag` begins it; return its folder."""
    begin_bag(folder, messages, **how).close(result or {"finished": "yes"})
    return folder


def bench(scene: Scene, heights: list[tuple[float, float, float]], start_ns: int = 0) -> Iterator[tuple[str, bytes]]:
    """Yield (topic, message) of a run in which a perfect controller sends the ceiling to (time, height, amplitude)."""
    plant, laser = Plant(scene), laser_of(scene)
    rate, count = scene.sensors.laser.rate, round(scene.recording.block * scene.sensors.laser.rate)
    speed = scene.ceiling.speed if scene.ceiling.controlled else 0.3
    target, sequence, amplitude = plant.height, 0, float("nan")
    times = [time for time, _, _ in heights]
    for number in range(round(scene.duration * rate) // count):
        first = number * count
        truth = plant.advance(count, rate, target, speed)
        data = laser.read(number, np.stack([truth.support, truth.beam], axis=1))
        last = start_ns + round((first + count - 1) / rate * 1e9)
        yield LASER, block(first, data, rate, start_ns)
        yield "/plant/truth", _truth(truth, first, rate, start_ns)
        yield "/excitation", _estimate(truth, last, number)
        while sequence < len(times) and truth.time[-1] >= times[sequence]:
            target, amplitude = heights[sequence][1:]
            sequence += 1
        yield "/ceiling/command", make("CeilingCommand", last, "plant:laser", sequence=sequence, height=target,
                                       excitation_amplitude=amplitude, method="lookup", reason="selected")  # fmt: skip
        moving = plant.height != target
        yield STATES, make("CeilingState", last, "motor_node", mode=MOVING if moving else HOLDING, homed=True,
                           height=plant.height, target=target, speed=speed, sequence=sequence)  # fmt: skip
    yield EVENTS, make("Event", last, "plant_node", kind="finished", value=scene.duration,
                       text=f"{scene.duration:g} s simulated in 1 s ({scene.duration:g} x real time)")  # fmt: skip


def _truth(truth: Any, first: int, rate: float, start_ns: int) -> bytes:
    names = ("excitation_amplitude", "excitation_frequency", "impacts", "input_energy", "beam_loss", "contact_loss",
             "ceiling_work", "stored_energy", "support", "beam", "grain", "ceiling")  # fmt: skip
    fields = {name: getattr(truth, name) for name in names}
    return make("PlantTruth", start_ns + round(first / rate * 1e9), "plant", first_index=first, rate=rate, **fields)


def _estimate(truth: Any, last: int, number: int) -> bytes:
    amplitude = truth.excitation_amplitude * (1.0 + 0.002 * np.sin(number))
    beam = 0.5 * float(np.ptp(truth.beam))
    return make("Excitation", last, "plant:laser", quality=STEADY if number > 3 else 0, amplitude=amplitude,
                amplitude_std=2e-5, frequency=truth.excitation_frequency, frequency_std=1e-3, window=0.19,
                used=190, beam_amplitude=beam)  # fmt: skip


def topics_of(lockstep: bool) -> list[Topic]:
    """Return the topics that are recorded, by their whole names."""
    return [Topic(f"/{topic.name}", topic.type) for topic in parse(DEFAULT, lockstep)]


def session_of(folder: Path, scene: Path, *, lockstep: bool = True, clock: str = "", **how: Any) -> RecordingSession:
    """Begin to record a run of the scene into `folder`."""
    clock = clock or ("lockstep" if lockstep else "real time")
    run = new_run(scene, run_id="specimen", commit="0123456789ab", clock=clock)
    return RecordingSession(folder, run, topics_of(lockstep), lockstep=lockstep, offered=lambda _: (Qos(),), **how)


def receive(session: RecordingSession, messages: Iterable[tuple[str, bytes]]) -> None:
    """Let a session receive messages until its recording is complete."""
    for number, (topic, message) in enumerate(messages):
        session.receive(topic, message, 1_000_000_000 + number * 1_000)
        if session.complete:
            break


def record(folder: Path, scene_file: Path, heights: list[tuple[float, float, float]]) -> Path:
    """Record `bench` of the scene into `folder`; return it."""
    session = session_of(folder, scene_file)
    receive(session, bench(load_scene(scene_file), heights))
    assert session.complete
    session.close()
    return folder


def refused(capsys: Capture, arguments: Iterable[object], *parts: str) -> str:
    """Check that `atpid` refuses its arguments in one line that holds these parts; return the line."""
    capsys.readouterr()
    assert main([str(argument) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1, error
    assert [part for part in parts if part not in error] == [], error
    return error


def in_one_line(error: BaseException, *parts: str) -> None:
    """Check that an error is one line with these parts."""
    assert "\n" not in str(error)
    assert [part for part in parts if part not in str(error)] == [], str(error)


def peak_of(act: Callable[[], object]) -> int:
    """Return how much memory was taken at most [bytes]."""
    gc.collect()  # what is left of others is collected at other instants each time
    tracemalloc.start()
    try:
        act()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
