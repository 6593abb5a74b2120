# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control.recording verify|check|repair|extract BAG`.

Is the file whole; did the run in it keep its rules; make the file whole; what was it made with.
"""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from atpid_common.arguments import file_path, rising
from atpid_common.cli import Parser, run_parsed
from atpid_common.errors import DONE
from atpid_control.bags.check import check
from atpid_control.bags.errors import BagError, in_words
from atpid_control.bags.read import open_bag
from atpid_control.bags.support import write_support
from atpid_control.bags.verify import repair, verify

FOUND = 1
#: Arguments of the example in the help.
EXAMPLE = "verify bags/thesis_4_3_short"


def main(arguments: Sequence[str] | None = None) -> int:
    """Verify, check or repair a bag, or write the files kept in it or its support's motion; return the exit status."""
    return run_parsed(parser, arguments)


def parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser(prog="python -m atpid_control.recording", description=__doc__, example=EXAMPLE)
    add = parser.add_argument
    add("action", choices=("verify", "check", "repair", "extract"))
    add("bag", type=file_path, help="folder of the bag")
    add("--out", type=file_path, default=Path(), help="extract: folder for scene, parameters, map (default: here)")
    support = "extract: instead of those, the support's motion as support.csv for a scene; a part of it, in s"
    interval = rising(0.0, math.inf, "FROM:TO, two rising times from 0 on in s")
    add("--support", type=interval, nargs="?", const=(0.0, math.inf), metavar="FROM:TO", help=support)
    parser.set_defaults(run=_run)
    return parser


def _run(given: argparse.Namespace) -> int:
    if given.support and given.action != "extract":
        raise BagError(f"--support: given with {given.action}; allowed: with extract")
    if given.support:
        print(write_support(open_bag(given.bag), given.out, *given.support))
    elif given.action == "extract":
        _extract(given.bag, given.out)
    elif given.action == "check":
        return _check(given.bag)
    else:
        found = repair(given.bag) if given.action == "repair" else verify(given.bag)
        for topic, count in sorted(found.by_topic.items()):
            print(f"{count:8d}  {topic}")
        seconds, size = (found.end_ns - found.start_ns) * 1e-9, found.size / 1e6
        read = f"{found.messages} messages over {seconds:.3f} s, {size:.2f} MB, every one read and decoded"
        print(f"{found.folder}: {read}")
    return DONE


def _check(bag: Path) -> int:
    """Print what the check of a bag shows; return 0, or 1 where it breaks a rule."""
    found = check(bag)
    for line in found.findings:
        print(line)
    for line in found.events:
        print(f"reported: {line}")
    print(found.line)
    return FOUND if found.findings else 0


def _extract(bag: Path, out: Path) -> None:
    files = open_bag(bag, messages=False).files
    if not files:
        needed = "parameters scene and files of recorder_node"
        raise BagError(f"{bag}: no scene or other file was kept in this bag ({needed})")
    for name, data in files.items():
        # only the name: a bag from elsewhere must not write outside the folder given
        file = out / Path(name).name
        if os.path.lexists(file):
            raise BagError(f"{file}: exists already and is not written over; give another folder with --out")
        try:
            out.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        except OSError as error:
            raise BagError(f"{file}: cannot be written: {in_words(error)}") from None
        except ValueError as error:  # a NUL in the name
            raise BagError(f"{bag}: keeps a file whose name is none ({error})") from None
        print(file)


if __name__ == "__main__":
    sys.exit(main())
