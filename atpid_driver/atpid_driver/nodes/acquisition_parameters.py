# SPDX-License-Identifier: Apache-2.0
"""Parameters of the acquisition nodes: declared with description and range, checked before a device is touched."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.parameters import Row, declare
from atpid_common.share import share_folder
from atpid_driver.acquisition import SetupRefusedError
from atpid_driver.calibration import Calibration, check_channels, load

TYPES = Parameter.Type

COMMON = (
    Row("serial", 0, "serial number the device must have; 0: take any", "", 0, 2**32 - 1),
    Row("rate", TYPES.DOUBLE, "scan rate asked for; the blocks carry that of the device", "Hz", 0.1, 100_000.0),
    Row("blocks_per_second", 20.0, "messages per second", "1/s", 1.0, 50.0),
    Row("channels", TYPES.STRING_ARRAY, "names of the channels in the messages"),
    Row("terminals", TYPES.STRING_ARRAY, "where each channel is wired, for example AIN0 or ai0"),
    Row("kinds", ["voltage"], "voltage or iepe, for each channel; one entry stands for all"),
    Row("calibrations", TYPES.STRING_ARRAY, "calibration file of each channel, relative to calibration_folder"),
    Row("calibration_folder", "", "folder of the calibration files; empty: those shipped with the package"),
    Row("autostart", True, "configure and activate without a lifecycle manager, until the device answers"),
    Row("handshake", True, "stream only after the loop has answered an empty block"),
    Row("expect_recorder", False, "do not stream before the recorder has received every topic"),
    Row("library", "", "path of the vendor's library; empty: where the loader finds it"),
)
LABJACK = (
    Row("backend", "labjack", "what is read", choices=("labjack", "simulated")),
    Row("connection", "ANY", "how the T7 is connected", choices=("ANY", "USB", "TCP", "ETHERNET", "WIFI")),
    Row("voltage_range", 10.0, "input range: 10, 1, 0.1 or 0.01", "V", 0.01, 10.0),
    Row("resolution_index", 0, "a larger one is quieter and slower; 0: the device chooses", "", 0, 8),
    Row("settling_us", 0.0, "settling time between channels; 0: the device chooses", "us", 0.0, 4400.0),
)
NI = (
    Row("backend", "nidaqmx", "what is read", choices=("nidaqmx", "simulated")),
    Row("device", "cDAQ1Mod1", "the module's name in NI MAX"),
    Row("voltage_range", 30.0, "input range", "V", 0.001, 100.0),
    Row("excitation_current", 0.004, "current of IEPE inputs", "A", 0.0, 0.02),
    Row("grpc", "", "host:port of NI's gRPC device server on another PC; empty: the driver on this one"),
)
SIMULATED = (
    Row("amplitude", 1.0, "of the simulated backend's sines", "V", 0.0, 100.0),
    Row("offset", 3.0, "of the simulated backend's sines", "V", -100.0, 100.0),
    Row("frequency", 5.0, "of the simulated backend's sines", "Hz", 1e-3, 50_000.0),
)
DEVICE_KEYS = ("serial", "rate", "library", *(row.name for row in (*LABJACK, *NI, *SIMULATED)))


@dataclass(frozen=True)
class NodeSettings:
    """What the node itself needs; `device` goes to the backend as it is."""

    backend: str
    device: dict[str, object]
    calibrations: tuple[Calibration, ...]
    autostart: bool
    handshake: bool
    expect_recorder: bool


def settings_of(node: Node, rows: tuple[Row, ...]) -> NodeSettings:
    """Declare everything on `node` and return it checked. Raises ParameterError or DriverError."""
    values = declare(node, (*COMMON, *rows, *SIMULATED))
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
