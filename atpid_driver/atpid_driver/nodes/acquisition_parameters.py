# SPDX-License-Identifier: Apache-2.0
"""Parameters of the acquisition nodes: declared with description and range, checked before a device is opened."""

from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.folders import share_folder
from atpid_common.nodes.parameters import Entry, ParameterError, declare
from atpid_driver.acquisition import AcquisitionSettings, SetupRefusedError
from atpid_driver.acquisition.registry import backend
from atpid_driver.acquisition.registry import names as backend_names
from atpid_driver.calibration.convert import check_channels
from atpid_driver.calibration.model import Calibration, load
from atpid_driver.nodes.channel_watch import THRESHOLDS

TYPES = Parameter.Type
#: Readings of a channel without calibration file are within it.
_MOST = 1e12
_TYPE_OF = {bool: TYPES.BOOL, int: TYPES.INTEGER, float: TYPES.DOUBLE, str: TYPES.STRING}

COMMON = (
    Entry("topic", "sensors/acquisition", "where the blocks are published"),
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


def settings_of(node: Node, usual: Mapping[str, Any]) -> tuple[dict[str, Any], tuple[Calibration, ...]]:
    """Declare everything on `node`; return the checked values by name, and the calibration of each channel.

    usual: the node's own defaults by name. `channels` and `scans_per_block` are as the backend takes them. Raises
    ParameterError or DriverError.
    """
    values = declare(node, [replace(row, default=usual.get(row.name, row.default)) for row in common_rows()])
    check_topic(node, values["topic"])
    backends = dict.fromkeys((values["backend"], usual.get("backend", "simulated"), "simulated"))
    rows = {row.name: row for name in reversed(backends) for row in rows_of(backend(name).settings)}
    values |= declare(node, tuple(rows.values()))
    names, terminals = list(values["channels"]), list(values["terminals"])
    kinds = list(values["kinds"]) * (len(names) if len(values["kinds"]) == 1 else 1)
    if not len(names) == len(terminals) == len(kinds):
        raise SetupRefusedError(
            f"{len(names)} channels, {len(terminals)} terminals, {len(kinds)} kinds: give one of each for a channel"
        )
    calibrations = _stated(values, names) if any(values["units"]) else calibrations_of(values)
    check_channels(calibrations, tuple(names))
    wiring = zip(names, terminals, kinds, strict=True)
    channels = [{"name": name, "terminal": terminal, "kind": kind} for name, terminal, kind in wiring]
    scans = max(1, round(values["rate"] / values["blocks_per_second"]))
    return values | {"channels": channels, "scans_per_block": scans}, calibrations


def _stated(values: Mapping[str, Any], names: list[str]) -> tuple[Calibration, ...]:
    """Return calibrations from the parameters `units` and `factors`. Raises SetupRefusedError."""
    units, factors = list(values["units"]), list(values["factors"])
    factors *= len(names) if len(factors) == 1 else 1
    if any(values["calibrations"]) or not len(units) == len(factors) == len(names) or not all(units) or 0.0 in factors:
        raise SetupRefusedError(
            f"units {units}, factors {factors}: give one of each for a channel, factors not 0, and no calibrations"
        )
    known = {"sensor": "as stated", "serial": "none", "date": date.today(), "source": "parameters units and factors",
             "limits_volts": (-_MOST, _MOST)}  # fmt: skip
    return tuple(
        Calibration(channel=name, unit=unit, coefficients=(0.0, factor), **known)
        for name, unit, factor in zip(names, units, factors, strict=True)
    )


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


def calibrations_of(values: Mapping[str, Any]) -> tuple[Calibration, ...]:
    """Read the files of the parameters `calibrations` and `calibration_folder`. Raises DriverError."""
    if not any(values["calibrations"]):
        raise SetupRefusedError("calibrations: none given; give a file for each channel, or units and factors")
    folder = Path(values["calibration_folder"]) if values["calibration_folder"] else shipped_calibrations()
    return tuple(load(folder / name) for name in values["calibrations"])


def shipped_calibrations() -> Path:
    """Return the folder of the installed calibration files; InputError where no sourced workspace has them."""
    return share_folder("atpid_driver") / "config" / "calibration"
