# SPDX-License-Identifier: Apache-2.0
"""The arguments of each launch file, and what starts their nodes."""

from __future__ import annotations

from atpid_control.launching.arguments import (
    Argument,
    ParameterFile,
    choice,
    existing_bag,
    existing_file,
    new_folder,
    number,
)

#: What starts a node. SIGINT, SIGTERM and SIGHUP are blocked until the node handles them, so that Ctrl-C while Python
#: starts is neither lost nor a traceback. A node is sent SIGTERM if its launch dies, so that it
#: does not go on moving the ceiling.
START = "env --block-signal=INT --block-signal=TERM --block-signal=HUP setpriv --pdeathsig TERM"
_BAG = Argument("bag", "folder of the bag to make; not given: run-<id> in the current folder", new_folder, "")
_RATE = "speed relative to the recording, from 0 to 1000; 0: as fast as the loop answers"
_MAP = Argument("map", "height map; not given: the one the scene names", existing_file, "")


def _parameters(name: str, description: str, file: str) -> Argument:
    return Argument(name, f"parameter file: {description}", existing_file, ParameterFile("atpid_driver", file))


BENCH = (
    Argument("scene", "scene file (docs/scenes.md)", existing_file),
    _MAP,
    _BAG,
    _parameters("motor_config", "limits and speed of the ceiling; those of the scene must agree", "motor.yaml"),
)

STAND = (
    Argument("scene", "scene file: beam, grain and ceiling (docs/scenes.md)", existing_file),
    _MAP,
    _BAG,
    choice("ni", "whether to stream the accelerometer on the NI-9230 as well", "false", "true"),
    _parameters("labjack_config", "channels and calibrations of the LabJack T7", "labjack.yaml"),
    _parameters("ni_config", "channels and calibrations of the NI-9230", "ni.yaml"),
    _parameters("motor_config", "serial port, limits and speed of the ceiling's motor", "motor_serial.yaml"),
)

REPLAY = (
    Argument("bag", "folder of the bag to play", existing_bag),
    Argument("scene", "scene file; not given: the one kept in the bag", existing_file, ""),
    Argument("map", "height map; not given: the one kept in the bag", existing_file, ""),
    Argument("rate", _RATE, number(0.0, 1000.0), "1.0"),
    Argument("record", "folder of the bag to make of the replay; not given: no bag is made", new_folder, ""),
)
