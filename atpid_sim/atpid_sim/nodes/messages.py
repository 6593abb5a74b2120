# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the parameter `scene` of a node names, and the stream's blocks as messages."""

from __future__ import annotations

import numpy as np
from atpid_interfaces.msg import PlantTruth, SampleBlock
from rclpy.node import Node

from atpid_common.nodes.handshake import empty
from atpid_common.nodes.messages import doubles, nanoseconds_of, time_of
from atpid_common.vocabulary import Frame
from atpid_sim.plant.stream import DeviceBlock, StreamBlock, stamp_ns
from atpid_sim.scene import Scene, SceneError, load_scene


def scene_given(node: Node) -> Scene:
    """Return the scene the node's parameter `scene` names. Raises SceneError."""
    path = str(node.get_parameter("scene").value)
    if not path:
        raise SceneError(f"parameter scene of {node.get_name()} is not set: give a scene file, -p scene:=SCENE.yaml")
    return load_scene(path)


def sample_block(reading: DeviceBlock, start_ns: int, device: str, shift_ns: int = 0) -> SampleBlock:
    """Return one device's readings as its message; `shift_ns`: by how much a faulty clock's stamp is off."""
    message = SampleBlock(device=f"plant:{device}")
    _stamp(message, reading, start_ns, Frame.BEAM if device == "accelerometer" else Frame.STAND)
    if shift_ns:
        message.header.stamp = time_of(max(0, nanoseconds_of(message.header.stamp) + shift_ns))
    message.channels = list(reading.instrument.channels)
    message.units = list(reading.instrument.units)
    message.skew = doubles(np.zeros(len(reading.instrument.channels)))
    message.data = doubles(reading.data)
    return message


def handshake_truth(height: float) -> PlantTruth:
    """Return the handshake's message: no samples, and the ceiling's `height` [m] before the first."""
    message = empty(PlantTruth)
    message.ceiling = doubles(np.array([height]))
    truth: PlantTruth = message
    return truth


def truth_message(block: StreamBlock, start_ns: int) -> PlantTruth:
    """Return the true motion and energies of one block."""
    message, truth = PlantTruth(), block.truth
    _stamp(message, block.readings[0], start_ns, Frame.STAND)
    energies = ("input_energy", "beam_loss", "contact_loss", "ceiling_work", "stored_energy")
    for name in ("excitation_amplitude", "excitation_frequency", *energies):
        setattr(message, name, float(getattr(truth, name)))
    message.impacts = int(truth.impacts)
    for name in ("support", "beam", "grain", "ceiling"):
        setattr(message, name, doubles(block.truth_series(name)))
    return message


def _stamp(message: SampleBlock | PlantTruth, reading: DeviceBlock, start_ns: int, frame_id: str) -> None:
    """Enter in a message when and how fast its device's reading, the truth's is the laser's, was taken."""
    message.header.stamp = time_of(stamp_ns(start_ns, reading.first_index, reading.rate))
    message.header.frame_id = frame_id
    message.first_index = reading.first_index
    message.rate = reading.rate
