# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid standin`: build the stand-ins, print their environment, inject faults by hand."""

import argparse
import shlex

from atpid_common import output
from atpid_common.arguments import file_path, real, text, whole
from atpid_driver.standins.device import CHANNELS, Control, StandinError, build, environment

#: Arguments of the example in the help.
EXAMPLE = "--ljm-control out/ljm.bin --ljm-source sine:amplitude=1,frequency=5"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--ljm-control", type=file_path, help="control file of the T7 stand-in, made if it is not there"
    )
    parser.add_argument("--daqmx-control", type=file_path, help="control file of the NI-9230 stand-in")
    parser.add_argument(
        "--ljm-source", type=text, default="", help="sine[:amplitude=V,offset=V,frequency=HZ], ramp or feed:PATH"
    )
    parser.add_argument("--daqmx-source", type=text, default="", help="the same for the NI-9230 stand-in")
    parser.add_argument("--unplug", action="store_true", help="pull the cable of the devices whose control is given")
    parser.add_argument("--replug", action="store_true", help="plug it in again")
    parser.add_argument("--drop", type=whole(0, 2**63 - 1), default=0, metavar="SCANS", help="lose scans")
    parser.add_argument(
        "--hold", type=_held, metavar="CHANNEL:VOLTS", help="a sensor that gives this voltage only, such as 0:3.1"
    )
    parser.add_argument("--release", type=whole(0, CHANNELS - 1), metavar="CHANNEL", help="and its own again")
    fail = "vendor's error code the next read returns"
    parser.add_argument("--fail", type=whole(-(2**31), 2**31 - 1), metavar="CODE", help=fail)


def run(arguments: argparse.Namespace) -> int:
    """Build, apply the faults, and print `export` lines for a shell to evaluate."""
    given = [file for file in (arguments.ljm_control, arguments.daqmx_control) if file is not None]
    faults = [arguments.hold, arguments.release, arguments.fail]
    if not given and (arguments.unplug or arguments.replug or arguments.drop or any(f is not None for f in faults)):
        raise StandinError("a fault is given without a device; give --ljm-control or --daqmx-control")
    for file in given:
        output.file(file, "--ljm-control or --daqmx-control")
    libraries = build()
    for file in given:
        _apply(Control(file), arguments)
    names = ("ljm_source", "ljm_control", "daqmx_source", "daqmx_control")
    for name, value in environment(libraries, **{name: getattr(arguments, name) for name in names}).items():
        print(f"export {name}={shlex.quote(value)}")
    return 0


def _apply(control: Control, arguments: argparse.Namespace) -> None:
    if arguments.unplug:
        control.unplug()
    if arguments.replug:
        control.replug()
    if arguments.drop:
        control.drop(arguments.drop)
    if arguments.hold is not None:
        control.hold(*arguments.hold)
    if arguments.release is not None:
        control.release(arguments.release)
    if arguments.fail is not None:
        control.fail(arguments.fail)
    control.close()


def _held(given: str) -> tuple[int, float]:
    channel, _, volts = given.partition(":")
    return whole(0, CHANNELS - 1)(channel), real(-1e3, 1e3, "V after CHANNEL:, such as 0:3.1")(volts)
