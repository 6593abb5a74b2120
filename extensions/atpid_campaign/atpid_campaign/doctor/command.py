# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid doctor [SCENE]`: what would keep a stand from running, or make its runs worse, and how to mend it."""

import argparse
import json

from atpid_campaign.doctor.checks import all_checks, block, examine, verdict_of
from atpid_common.arguments import file_path, real, word
from atpid_control.stand.findings import Subject
from atpid_control.stand.launching.options import add_devices, add_parameters

#: Arguments of the example in the help.
EXAMPLE = "scenes/stand_realtime.yaml --port /dev/ttyACM0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("scene", type=file_path, nargs="?", help="scene file of the run; not given: its checks are left out")
    add("--port", type=word, help="serial port of the board; default: that of the motor's parameters")
    add("--map", type=file_path, metavar="MAP.npz", help="height map of the run; not given: it is not checked")
    add_devices(parser)
    add_parameters(parser)
    add("--bag", type=file_path, help="folder of the bag to make: its disk is checked; default: this folder's")
    add("--hours", type=real(0.0, 1e5, "h", above=True), default=1.0, help="length of the recording; default: 1")
    add("--json", action="store_true", help="print one JSON object and nothing else")


def run(args: argparse.Namespace) -> int:
    """Make the checks and print them; return 0, 1 where a run would be degraded, 2 where it would fail."""
    found = list(examine(Subject(args), all_checks()))
    status = verdict_of(found)
    plain = [finding._asdict() | {"verdict": finding.verdict.word} for finding in found]
    print(json.dumps({"verdict": status.word, "checks": plain}, indent=2) if args.json else block(found))
    return int(status)
