# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid calibrate reading`: the mean voltage of one input at a known position, a row for `atpid calibrate sensor`."""

import argparse
import math
from pathlib import Path

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path, real, text, whole, word
from atpid_driver.acquisition import Acquisition, Channel
from atpid_driver.acquisition.registry import create
from atpid_driver.acquisition.registry import names as backend_names
from atpid_driver.calibration.fit import COLUMNS, LARGEST, read_readings
from atpid_driver.calibration.model import CalibrationError, Floats

_BLOCKS_PER_SECOND = 20.0
#: Arguments of the example in the help.
EXAMPLE = "readings.csv --position 0.010 --terminal AIN0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("readings", type=file_path, help="CSV file the row is added to")
    parser.add_argument("--position", type=real(-LARGEST, LARGEST), required=True, help="where the target is now (SI)")
    parser.add_argument("--terminal", type=word, required=True, help="input, for example AIN0 or ai0")
    parser.add_argument("--backend", choices=backend_names(), default="labjack", help="default: labjack")
    parser.add_argument("--kind", choices=("voltage", "iepe"), default="voltage", help="default: voltage")
    parser.add_argument("--device", type=word, default="cDAQ1Mod1", help="NI module's name in NI MAX")
    parser.add_argument("--grpc", type=text, default="", help="host:port of NI's gRPC device server")
    parser.add_argument("--library", type=text, default="", help="path of the vendor's library")
    parser.add_argument(
        "--serial", type=whole(0, 2**63 - 1), default=0, help="serial number the device must have (default: any)"
    )
    parser.add_argument("--rate", type=real(0.1, 1e6, "Hz"), default=1000.0, help="scans per second (default: 1000)")
    parser.add_argument(
        "--seconds", type=real(0.0, 3600.0, "s", above=True), default=1.0, help="how long to average (default: 1)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Measure, add the row, print mean and scatter."""
    output.file(arguments.readings, "file")
    if arguments.readings.exists() and arguments.readings.stat().st_size:
        read_readings(arguments.readings)  # a row is added to a table of readings only
    values = {key: getattr(arguments, key) for key in ("device", "grpc", "library", "serial", "rate")}
    channel = Channel("reading", arguments.terminal, arguments.kind)
    scans = max(1, round(arguments.rate / _BLOCKS_PER_SECOND))
    device = create(arguments.backend, values | {"channels": (channel,), "scans_per_block": scans})
    volts = measure(device, arguments.seconds)
    with output.writing(arguments.readings, "file"):
        append(arguments.readings, arguments.position, float(volts.mean()))
    std = float(volts.std(ddof=1)) if len(volts) > 1 else math.nan
    print(f"{arguments.position:g} at {volts.mean():.6f} V (scatter {1e3 * std:.3f} mV over {len(volts)} samples)")
    return 0


def measure(device: Acquisition, seconds: float) -> Floats:
    """Return the first channel's valid samples over `seconds` [s], (n,) [V]; AcquisitionError from the device."""
    try:
        device.open()
        rate = device.start()
        wanted = max(1, round(seconds * rate))
        taken: list[Floats] = []
        while sum(map(len, taken)) < wanted:
            taken.append(device.read().volts[:, 0])
    finally:
        device.stop()
        device.close()
    volts = np.concatenate(taken)
    valid = volts[np.isfinite(volts)]
    if not len(valid):
        raise CalibrationError("no valid sample: the device lost all scans; lower the rate")
    return valid


def append(readings: Path, position: float, volts: float) -> None:
    """Add a row; a new file gets its header first."""
    new = not readings.exists() or not readings.stat().st_size
    with readings.open("a", encoding="utf-8") as file:
        if new:
            file.write(",".join(COLUMNS) + "\n")
        file.write(f"{position!r},{volts:.7f}\n")
