# SPDX-License-Identifier: Apache-2.0
"""Parameters of the acquisition nodes: declared with description and range, checked before a device is touched."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.share import share_folder
from atpid_driver.acquisition import SetupRefusedError
from atpid_driver.calibration import Calibration, check_channels, load

Row = tuple[str, Any, str]

COMMON: tuple[Row, ...] = (
    ("serial", 0, "serial number the device must have; 0: take any"),
    ("rate", Parameter.Type.DOUBLE, "scan rate asked for [Hz]; the blocks carry the rate the device really runs at"),
    ("blocks_per_second", 20.0, "messages per second"),
    ("channels", Parameter.Type.STRING_ARRAY, "names of the channels in the messages"),
    ("terminals", Parameter.Type.STRING_ARRAY, "where each channel is wired, for example AIN0 or ai0"),
    ("kinds", ["voltage"], "voltage or iepe, for each channel; one entry stands for all"),
    ("calibrations", Parameter.Type.STRING_ARRAY, "calibration file of each channel, relative to calibration_folder"),
    ("calibration_folder", "", "folder of the calibration files; empty: those shipped with the package"),
    ("autostart", True, "configure and activate without a lifecycle manager, trying again until the device answers"),
    ("handshake", True, "stream only after the loop has answered an empty block"),
    ("expect_recorder", False, "do not stream before the recorder has received every topic"),
    ("library", "", "path of the vendor's library; empty: where the loader finds it"),
)
LABJACK: tuple[Row, ...] = (
    ("backend", "labjack", "labjack or simulated"),
    ("connection", "ANY", "ANY, USB, TCP, ETHERNET or WIFI"),
    ("voltage_range", 10.0, "input range [V]: 10, 1, 0.1 or 0.01"),
    ("resolution_index", 0, "0 to 8; a larger one is quieter and slower"),
    ("settling_us", 0.0, "settling time between channels [us]; 0: the device chooses"),
)
NI: tuple[Row, ...] = (
    ("backend", "nidaqmx", "nidaqmx or simulated"),
    ("device", "cDAQ1Mod1", "the module's name in NI MAX"),
    ("voltage_range", 30.0, "input range [V]"),
    ("excitation_current", 0.004, "current of IEPE inputs [A]"),
    ("grpc", "", "host:port of NI's gRPC device server on another PC; empty: the driver on this one"),
)
SIMULATED: tuple[Row, ...] = (
    ("amplitude", 1.0, "of the simulated backend's sines [V]"),
    ("offset", 3.0, "of the simulated backend's sines [V]"),
    ("frequency", 5.0, "of the simulated backend's sines [Hz]"),
)
RANGES = {"blocks_per_second": (1.0, 50.0), "rate": (0.1, 100_000.0)}
DEVICE_KEYS = ("serial", "rate", "library", *(row[0] for row in (*LABJACK, *NI, *SIMULATED)))


@dataclass(frozen=True)
class NodeSettings:
    """What the node itself needs; `device` goes to the backend as it is."""

    backend: str
    device: dict[str, object]
    calibrations: tuple[Calibration, ...]
    autostart: bool
    handshake: bool
    expect_recorder: bool


def declare(node: Node, rows: tuple[Row, ...]) -> NodeSettings:
    """Declare everything on `node` and return it checked; a DriverError says in one line what is wrong."""
    values = {name: _declare(node, name, default, text) for name, default, text in (*COMMON, *rows, *SIMULATED)}
    names, terminals = list(values["channels"]), list(values["terminals"])
    kinds = list(values["kinds"]) * (len(names) if len(values["kinds"]) == 1 else 1)
    if not len(names) == len(terminals) == len(kinds):
        raise SetupRefusedError(
            f"{len(names)} channels, {len(terminals)} terminals, {len(kinds)} kinds: give one of each for a channel"
        )
    folder = Path(values["calibration_folder"]) if values["calibration_folder"] else shipped_calibrations()
    calibrations = tuple(load(folder / name) for name in values["calibrations"])
    check_channels(calibrations, tuple(names))
    device = {key: values[key] for key in DEVICE_KEYS if key in values}
    device["channels"] = [
        {"name": name, "terminal": terminal, "kind": kind}
        for name, terminal, kind in zip(names, terminals, kinds, strict=True)
    ]
    device["scans_per_block"] = max(1, round(values["rate"] / values["blocks_per_second"]))
    flags = (values["autostart"], values["handshake"], values["expect_recorder"])
    return NodeSettings(values["backend"], device, calibrations, *flags)


def shipped_calibrations() -> Path:
    """Return the folder of the installed calibration files; InputError where no sourced workspace has them."""
    return share_folder("atpid_driver") / "config" / "calibration"


def _declare(node: Node, name: str, default: Any, text: str) -> Any:
    descriptor = ParameterDescriptor(name=name, description=text, read_only=True)
    if name in RANGES:
        low, high = RANGES[name]
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    try:
        value = node.declare_parameter(name, default, descriptor).value
    except Exception as error:  # rclpy has one exception per kind of bad value; each text names the parameter
        raise SetupRefusedError(f"parameter {name} of {node.get_name()}: {error}") from error
    if value is None:
        raise SetupRefusedError(
            f"parameter {name} of {node.get_name()} is not given: {text}; set it in the parameter file"
        )
    return value
