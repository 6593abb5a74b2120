# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_driver.emulator run|fuzz|storm`: the emulated motor stand by hand, and the long runs."""

import argparse
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from atpid_common.arguments import MOST_SEED, file_path, real, whole
from atpid_common.cli import Parser, run_parsed
from atpid_common.errors import DONE
from atpid_driver.emulator import Emulator
from atpid_driver.emulator.fuzz import fuzz
from atpid_driver.emulator.storm import storm

MOVED = 3  # exit status of fuzz where the motor moved
#: Arguments of the example in the help.
EXAMPLE = "run --link out/motor --height 0.3"


def _run(arguments: argparse.Namespace) -> int:
    """Serve the board at a port in real time until interrupted; commands on standard input inject and clear faults."""
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: sys.exit(0))
    with Emulator(
        arguments.link, eeprom=arguments.eeprom, height=arguments.height, bootloader=1.0, reset_on_open=True
    ) as emulator:
        emulator.pace(1.0)
        print(f"emulated board at {arguments.link}; type a command (set jam 1, unplug, state, ...)", flush=True)
        for line in sys.stdin:
            print(emulator.command(line.strip()), flush=True)
        signal.pause()
    return DONE


def _fuzz(arguments: argparse.Namespace) -> int:
    """Send harmful frames; 0 if the motor did not move, 3 if it did."""
    with tempfile.TemporaryDirectory() as folder, Emulator(Path(folder) / "board", height=0.98) as emulator:
        shown = 0

        def progress(done: int) -> None:
            nonlocal shown
            if done - shown >= 20_000:
                shown = done
                print(f"{done} of {arguments.frames} frames", file=sys.stderr, flush=True)

        result = fuzz(emulator, arguments.frames, arguments.seed, progress)
    print(result)
    return MOVED if result.moved_um or result.switched or result.resets else DONE


def _storm(arguments: argparse.Namespace) -> int:
    """Make random requests; what breaks a limit is an error."""
    with tempfile.TemporaryDirectory() as folder, Emulator(Path(folder) / "board", height=0.98) as emulator:
        print(storm(emulator, arguments.seconds, arguments.requests, arguments.seed))
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status, 3 where the motor moved."""
    parser = Parser(prog="python -m atpid_driver.emulator", description=__doc__, example=EXAMPLE)
    commands = parser.add_subparsers(required=True)
    run = commands.add_parser("run", help="serve the emulated board in real time")
    run.add_argument("--link", type=file_path, required=True, help="where its serial port shall appear")
    run.add_argument("--eeprom", type=file_path, help="file that keeps the board's EEPROM")
    run.add_argument("--height", type=real(0.0, 10.0, "m"), default=0.3, help="where the ceiling is at first [m]")
    run.set_defaults(run=_run)
    long = commands.add_parser("fuzz", help="corrupted, truncated and duplicated frames")
    long.add_argument("--frames", type=whole(1, 10**9), default=1_000_000)
    long.add_argument("--seed", type=whole(0, MOST_SEED), default=1)
    long.set_defaults(run=_fuzz)
    random = commands.add_parser("storm", help="random whole requests, of any number and sequence")
    random.add_argument("--requests", type=whole(1, 10**9), default=1_000_000)
    random.add_argument("--seconds", type=real(0.1, 1e6, "s"), default=60.0, help="at most (default: 60)")
    random.add_argument("--seed", type=whole(0, MOST_SEED), default=1)
    random.set_defaults(run=_storm)
    return run_parsed(lambda: parser, argv)


if __name__ == "__main__":
    sys.exit(main())
