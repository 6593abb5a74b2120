# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the acquisition nodes: declared with description and range, checked before a device is opened."""

from collections.abc import Mapping
from dataclasses import replace

from rclpy.node import Node

from atpid_common.files import Document
from atpid_common.nodes.parameters import ParameterError, declare
from atpid_common.parameters import Entry, rows_of
from atpid_common.vocabulary import Frame
from atpid_driver.acquisition import AcquisitionSettings
from atpid_driver.acquisition.protocol import wired
from atpid_driver.acquisition.registry import backend
from atpid_driver.acquisition.registry import names as backend_names
from atpid_driver.calibration.model import Calibration, calibrations_of, check_channels
from atpid_driver.nodes.channel_watch import THRESHOLDS

COMMON = (
    Entry("topic", "sensors/acquisition", "where the blocks are published"),
    Entry("frame_id", Frame.STAND, "what the sensors are fixed to: stand, support, beam or ceiling"),
    Entry("in_loop", False, "whether the loop answers this topic's handshake"),
    Entry("blocks_per_second", 20.0, "messages per second", "1/s", 1.0, 50.0),
    Entry("channels", list, "names of the channels in the messages"),
    Entry("terminals", list, "where each channel is wired, for example AIN0 or ai0"),
    Entry("kinds", ["voltage"], "voltage or iepe, for each channel; one entry stands for all"),
    Entry("calibrations", [""], "calibration file of each channel, relative to calibration_folder"),
    Entry("units", [""], "in place of calibrations: the SI unit of each channel"),
    Entry("factors", [1.0], "with units: of each channel, from its readings to that unit; one entry stands for all"),
    Entry("calibration_folder", "", "folder of the calibration files; empty: those shipped with the package"),
    Entry("autostart", True, "configure and activate without a lifecycle manager, until the device answers"),
    Entry("handshake", True, "stream only after the loop has answered an empty block"),
    Entry("expect_recorder", False, "do not stream before the recorder has received every topic"),
)


def common_rows() -> tuple[Entry, ...]:
    """Return the parameters of every acquisition node, whatever its backend."""
    return (
        Entry("backend", str, "what is read", choices=backend_names()),
        *rows_of(AcquisitionSettings),
        *COMMON,
        *THRESHOLDS,
    )


def settings_of(node: Node, usual: Mapping[str, object]) -> tuple[Document, tuple[Calibration, ...]]:
    """Declare everything on `node`; return the checked values by name, and the calibration of each channel.

    usual: the node's own defaults by name. `channels` and `scans_per_block` are as the backend takes them. Raises
    ParameterError or DriverError.
    """
    values = declare(node, [replace(row, default=usual.get(row.name, row.default)) for row in common_rows()])
    check_topic(node, values["topic"])
    backends = dict.fromkeys((values["backend"], str(usual.get("backend", "simulated")), "simulated"))
    rows = {row.name: row for name in reversed(backends) for row in own_rows(backend(name).settings)}
    values |= declare(node, tuple(rows.values()))
    made, calibrations = values | wired(values), calibrations_of(values)
    check_channels(calibrations, tuple(values["channels"]))
    return made, calibrations


def own_rows(model: type[AcquisitionSettings]) -> tuple[Entry, ...]:
    """Return a parameter for each setting that only this backend has."""
    shared = {row.name for row in common_rows()}
    return tuple(row for row in rows_of(model) if row.name not in shared)


def check_topic(node: Node, topic: str) -> None:
    """Raise ParameterError where the parameter `topic` cannot be the name of one."""
    try:
        node.resolve_topic_name(topic)
    except (ValueError, RuntimeError):  # of the validation of names, and of rcl
        raise ParameterError(
            f"parameter topic of {node.get_name()}: given {topic!r}; allowed: a name as sensors/laser"
        ) from None
