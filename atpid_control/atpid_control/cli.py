# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The program `atpid`: every command, by purpose."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from atpid_common.cli import Commands, is_among, run_commands, with_installed
from atpid_common.errors import BAD_INPUT, not_installed

_SIM, _CONTROL = "atpid_sim.commands", "atpid_control.commands"
_DRIVER, _ROS = "atpid_driver", "atpid_common.nodes.ros_commands"

COMMANDS: Commands = {
    "Simulate, choose a height, design": {
        "simulate": (f"{_SIM}.simulate", "run one scene: amplitude, error estimate, energy"),
        "select": (f"{_CONTROL}.select", "select the ceiling height for a scene's excitation"),
        "tradeoff": (f"{_SIM}.tradeoff", "which fidelity level and tolerance to take for which error on a scene"),
        "map": (f"{_SIM}.map", "compute the best height over support amplitudes and grain masses"),
    },
    "Run the nodes": {
        "bench": (f"{_CONTROL}.bench", "run a scene through the whole node graph: bag, summary and report"),
        "stand": (f"{_CONTROL}.stand", "run the test stand: hardware nodes, identifier, selector and recorder"),
        "replay": (f"{_CONTROL}.replay", "play a bag through identifier and selector again, and compare"),
        "live": (f"{_CONTROL}.stand:LIVE", "serve the live page of nodes that run already"),
    },
    "Read, check and mend bags": {
        "bag report": (f"{_CONTROL}.analyse:REPORT", "make the report of a bag: an HTML page and pictures"),
        "bag analyse": (f"{_CONTROL}.analyse", "frequency response, spectra, decrement and orders of a bag"),
        "bag check": (f"{_CONTROL}.bag_files:CHECK", "whether a bag is whole, and the run in it kept its rules"),
        "bag recover": (f"{_CONTROL}.bag_files:RECOVER", "make a whole bag of one that is cut off or damaged"),
        "bag repair": (f"{_CONTROL}.bag_files:REPAIR", "the same in its place"),
        "bag extract": (f"{_CONTROL}.bag_files:EXTRACT", "write scene, parameters and map kept in a bag as files"),
    },
    "Calibrate": {
        "calibrate sensor": (f"{_DRIVER}.calibration.command", "a calibration file from readings at known positions"),
        "calibrate reading": (f"{_DRIVER}.calibration.reading", "one reading at a known position, a row for `sensor`"),
    },
    "Without hardware, without `ros2`": {
        "emulator": (f"{_DRIVER}.emulator.command", "serve the emulated motor board at a serial port"),
        "standin": (f"{_DRIVER}.standins.command", "build the stand-in libraries, or inject a fault into one"),
        "ros echo": (f"{_ROS}:ECHO", "print messages, as `ros2 topic echo` does"),
        "ros lifecycle": (f"{_ROS}:LIFECYCLE", "change a node's state, as `ros2 lifecycle set` does"),
        "ros param": (f"{_ROS}:PARAM", "read and set parameters, as `ros2 param` does"),
    },
    "For this machine": {
        "policy": ("atpid_control.stand.nodes.policy", "make the SROS 2 policy of a stand from its nodes"),
        "completion": ("atpid_control.completion", "write what completes the commands in a shell"),
    },
}

#: The package that brings a command, by the command's name: of extensions of this project, installed or not.
_BROUGHT_BY = Path(__file__).parent / "data" / "extensions.json"


def commands() -> Commands:
    """Return every command there is: of the core, and of the packages that are installed."""
    return with_installed(COMMANDS)


def elsewhere(words: Sequence[str], known: Commands) -> str | None:
    """Return the line on a command that another one is now, or a package brings which is not installed; else None."""
    if words[:2] == ["bag", "verify"]:
        return "error: `atpid bag verify` is part of `atpid bag check`; of the file alone: `atpid bag check BAG --file`"
    brought: dict[str, str] = json.loads(_BROUGHT_BY.read_text(encoding="utf-8"))
    name = next((name for name in (" ".join(words[:2]), *words[:1]) if name in brought), None)
    if name is None or is_among(known, words):
        return None
    return f"error: `atpid {name}` comes with {not_installed(brought[name])}"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command, by default that of the process's arguments; return its exit status (`run_commands`).

    The entry points of other packages are read only where the core has no such command.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    known = COMMANDS
    if not is_among(COMMANDS, words):
        known = commands()
        if line := elsewhere(words, known):
            print(line, file=sys.stderr)
            return BAD_INPUT
    return run_commands("atpid", "The tuned particle impact damper: simulation, control, recordings.", known, words)
