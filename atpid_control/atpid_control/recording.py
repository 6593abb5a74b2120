# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control.recording verify|check|recover|repair|extract BAG`.

Is the file whole; did the run in it keep its rules; make a whole bag of a damaged one, or make it whole in its place;
what was it made with.
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
from atpid_control.bags.recover import Recovered, recover, repair
from atpid_control.bags.support import write_support
from atpid_control.bags.verify import Verified, survey, verify

FOUND = 1
#: Arguments of the example in the help.
EXAMPLE = "verify bags/thesis_4_3_short"


def main(arguments: Sequence[str] | None = None) -> int:
    """Verify, check, recover or repair a bag, or write what is kept in it; return the exit status."""
    return run_parsed(parser, arguments)


def parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser(prog="python -m atpid_control.recording", description=__doc__, example=EXAMPLE)
    add = parser.add_argument
    add("action", choices=("verify", "check", "recover", "repair", "extract"))
    add("bag", type=file_path, help="folder of the bag")
    out = "extract: folder for scene, parameters, map (default: here); recover: the new bag (default: BAG-recovered)"
    add("--out", type=file_path, help=out)
    support = "extract: instead of those, the support's motion as support.csv for a scene; a part of it, in s"
    interval = rising(0.0, math.inf, "FROM:TO, two rising times from 0 on in s")
    add("--support", type=interval, nargs="?", const=(0.0, math.inf), metavar="FROM:TO", help=support)
    parser.set_defaults(run=_run)
    return parser


def _run(given: argparse.Namespace) -> int:
    if given.support and given.action != "extract":
        raise BagError(f"--support: given with {given.action}; allowed: with extract")
    if given.out and given.action not in ("extract", "recover"):
        raise BagError(f"--out: given with {given.action}; allowed: with extract and recover")
    if given.support:
        print(write_support(open_bag(given.bag), given.out or Path(), *given.support))
    elif given.action == "extract":
        _extract(given.bag, given.out or Path())
    elif given.action == "check":
        return _check(given.bag)
    elif given.action == "verify":
        _verify(given.bag)
    else:
        _print_recovered(given.bag, repair(given.bag) if given.action == "repair" else recover(given.bag, given.out))
    return DONE


def _verify(bag: Path) -> None:
    """Print what is in a whole bag; of another, what is lost, before the error."""
    try:
        _print_verified(verify(bag))
    except BagError:
        for line in survey(bag):
            print(f"lost: {line}")
        raise


def _print_verified(found: Verified) -> None:
    for topic, count in sorted(found.by_topic.items()):
        print(f"{count:8d}  {topic}")
    for line in found.lost:
        print(f"missing: {line}")
    seconds, size = (found.end_ns - found.start_ns) * 1e-9, found.size / 1e6
    read = f"{found.messages} messages over {seconds:.3f} s, {size:.2f} MB, every one read and decoded"
    print(f"{found.folder}: {read}")


def _print_recovered(bag: Path, found: Recovered) -> None:
    for line in found.lost:
        print(f"lost: {line}")
    _print_verified(found.verified)
    if not found.made:
        print(f"{bag}: is whole, nothing was written")


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
