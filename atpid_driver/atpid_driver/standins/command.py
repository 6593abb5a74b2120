# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_driver standin`: build the stand-ins, print their environment, inject faults by hand."""

import argparse
import shlex
from pathlib import Path

from atpid_driver.standins.build import StandinError, build, environment
from atpid_driver.standins.control import Control


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--ljm-control", type=Path, help="control file of the T7 stand-in, made if it is not there")
    parser.add_argument("--daqmx-control", type=Path, help="control file of the NI-9230 stand-in")
    parser.add_argument("--ljm-source", default="", help="sine[:amplitude=V,offset=V,frequency=HZ], ramp or feed:PATH")
    parser.add_argument("--daqmx-source", default="", help="the same for the NI-9230 stand-in")
    parser.add_argument("--unplug", action="store_true", help="pull the cable of the devices whose control is given")
    parser.add_argument("--replug", action="store_true", help="plug it in again")
    parser.add_argument("--drop", type=int, default=0, metavar="SCANS", help="lose scans")
    parser.add_argument("--hold", metavar="CHANNEL:VOLTS", help="a sensor that gives this voltage only, such as 0:3.1")
    parser.add_argument("--release", type=int, metavar="CHANNEL", help="and its own again")
    parser.add_argument("--fail", type=int, metavar="CODE", help="vendor's error code the next read returns")


def run(arguments: argparse.Namespace) -> int:
    """Build, apply the faults, and print `export` lines for a shell to evaluate."""
    libraries = build()
    for path in (arguments.ljm_control, arguments.daqmx_control):
        if path is not None:
            _apply(Control(path), arguments)
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
        control.hold(*_held(arguments.hold))
    if arguments.release is not None:
        control.release(arguments.release)
    if arguments.fail is not None:
        control.fail(arguments.fail)
    control.close()


def _held(text: str) -> tuple[int, float]:
    try:
        channel, volts = text.split(":")
        return int(channel), float(volts)
    except ValueError:
        raise StandinError(f"--hold {text}: allowed CHANNEL:VOLTS, such as 0:3.1") from None
