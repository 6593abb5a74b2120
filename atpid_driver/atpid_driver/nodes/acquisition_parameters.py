# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the acquisition nodes: declared with description and range, checked before a device is opened."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.files import Document
from atpid_common.nodes.parameters import Entry, ParameterError, declare
from atpid_common.vocabulary import Frame
from atpid_driver.acquisition import AcquisitionSettings, SetupRefusedError
from atpid_driver.acquisition.protocol import wired
from atpid_driver.acquisition.registry import backend
from atpid_driver.acquisition.registry import names as backend_names
from atpid_driver.calibration.model import Calibration, calibrations_of, check_channels
from atpid_driver.nodes.channel_watch import THRESHOLDS

TYPES = Parameter.Type
_TYPE_OF = {bool: TYPES.BOOL, int: TYPES.INTEGER, float: TYPES.DOUBLE, str: TYPES.STRING}

COMMON = (
    Entry("topic", "sensors/acquisition", "where the blocks are published"),
    Entry("frame_id", Frame.STAND, "what the sensors are fixed to: stand, support, beam or ceiling"),
    Entry("in_loop", False, "whether the loop answers this topic's handshake"),
    Entry("serial", 0, "serial number the device must have; 0: take any", "", 0, 2**32 - 1),
    Entry("rate", TYPES.DOUBLE, "scan rate asked for; the blocks carry that of the device", "Hz", 0.1, 100_000.0),
    Entry("blocks_per_second", 20.0, "messages per second", "1/s", 1.0, 50.0),
    Entry("channels", TYPES.STRING_ARRAY, "names of the channels in the messages"),
    Entry("terminals", TYPES.STRING_ARRAY, "where each channel is wired, for example AIN0 or ai0"),
    Entry("kinds", ["voltage"], "voltage or iepe, for each channel; one entry stands for all"),
    Entry("calibrations", [""], "calibration file of each channel, relative to calibration_folder"),
    Entry("units", [""], "in place of calibrations: the SI unit of each channel"),
    Entry("factors", [1.0], "with units: of each channel, from its readings to that unit; one entry stands for all"),
    Entry("calibration_folder", "", "folder of the calibration files; empty: those shipped with the package"),
    Entry("autostart", True, "configure and activate without a lifecycle manager, until the device answers"),
    Entry("handshake", True, "stream only after the loop has answered an empty block"),
    Entry("expect_recorder", False, "do not stream before the recorder has received every topic"),
    Entry("library", "", "path of the vendor's library; empty: where the loader finds it"),
)


def common_rows() -> tuple[Entry, ...]:
    """Return the parameters of every acquisition node, whatever its backend."""
    return (Entry("backend", TYPES.STRING, "what is read", choices=backend_names()), *COMMON, *THRESHOLDS)


def settings_of(node: Node, usual: Mapping[str, object]) -> tuple[Document, tuple[Calibration, ...]]:
    """Declare everything on `node`; return the checked values by name, and the calibration of each channel.

    usual: the node's own defaults by name. `channels` and `scans_per_block` are as the backend takes them. Raises
    ParameterError or DriverError.
    """
    values = declare(node, [replace(row, default=usual.get(row.name, row.default)) for row in common_rows()])
    check_topic(node, values["topic"])
    backends = dict.fromkeys((values["backend"], str(usual.get("backend", "simulated")), "simulated"))
    rows = {row.name: row for name in reversed(backends) for row in rows_of(backend(name).settings)}
    values |= declare(node, tuple(rows.values()))
    made, calibrations = values | wired(values), calibrations_of(values)
    check_channels(calibrations, tuple(values["channels"]))
    return made, calibrations


def rows_of(model: type[AcquisitionSettings]) -> tuple[Entry, ...]:
    """Return a parameter for each setting that only this backend has. Raises SetupRefusedError for another type."""
    shared = AcquisitionSettings.model_fields.keys() | {row.name for row in COMMON}
    return tuple(_row(model, name, field) for name, field in model.model_fields.items() if name not in shared)


def _row(model: type[AcquisitionSettings], name: str, field: FieldInfo) -> Entry:
    choices = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
    kind = str if choices else field.annotation
    if kind not in _TYPE_OF:
        raise SetupRefusedError(
            f"setting {name} of {model.__name__} is no parameter: its type must be bool, int, float, str or Literal"
        )
    default = _TYPE_OF[kind] if field.is_required() else field.default
    text = field.description or f"of {model.__name__}"
    extra: Mapping[str, Any] = field.json_schema_extra if isinstance(field.json_schema_extra, Mapping) else {}
    bounds = {key: getattr(limit, key) for limit in field.metadata for key in ("ge", "le") if hasattr(limit, key)}
    unit, allowed = str(extra.get("unit", "")), tuple(map(str, choices))
    return Entry(name, default, text, unit, bounds.get("ge"), bounds.get("le"), allowed)


def check_topic(node: Node, topic: str) -> None:
    """Raise ParameterError where the parameter `topic` cannot be the name of one."""
    try:
        node.resolve_topic_name(topic)
    except (ValueError, RuntimeError):  # of the validation of names, and of rcl
        raise ParameterError(
            f"parameter topic of {node.get_name()}: given {topic!r}; allowed: a name as sensors/laser"
        ) from None
