# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag check|recover|repair|extract BAG`.

Is the file whole, and did the run in it keep its rules; make a whole bag of a damaged one, or make it whole in its
place; what was it made with.
"""

import argparse
import math
import os
from contextlib import suppress
from pathlib import Path

from atpid_common.arguments import file_path, rising
from atpid_common.cli import Command
from atpid_common.errors import DONE
from atpid_control.commands.results import print_missing
from atpid_control.runs.check import check
from atpid_control.runs.errors import BagError, in_words
from atpid_control.runs.parts import bag_in
from atpid_control.runs.playback import write_support
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import Recovered, recover, repair
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import Verified, survey, verify

#: Exit status of `check` where the run broke a rule.
FOUND = 1
_BAG = "bags/thesis_4_3_short"


def _bag(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("bag", type=file_path, metavar="BAG", help="folder of the bag, or of the run it is in")


def _bag_to_check(parser: argparse.ArgumentParser) -> None:
    _bag(parser)
    parser.add_argument("--file", action="store_true", help="the file alone, whatever was recorded")


def _bag_and_copy(parser: argparse.ArgumentParser) -> None:
    _bag(parser)
    parser.add_argument("--out", type=file_path, metavar="DIR", help="the new bag; default: BAG-recovered")


def _bag_and_files(parser: argparse.ArgumentParser) -> None:
    _bag(parser)
    parser.add_argument("--out", type=file_path, default=Path(), metavar="DIR", help="of the files; default: here")
    support = "instead of those, the support's motion as support.csv for a scene; a part of it, in s"
    interval = rising(0.0, math.inf, "FROM:TO, two rising times from 0 on in s")
    add = parser.add_argument
    add("--support", type=interval, nargs="?", const=(0.0, math.inf), metavar="FROM:TO", help=support)


def _recover(given: argparse.Namespace) -> int:
    bag = bag_in(given.bag)
    _print_recovered(bag, recover(bag, given.out))
    return DONE


def _repair(given: argparse.Namespace) -> int:
    bag = bag_in(given.bag)
    _print_recovered(bag, repair(bag))
    return DONE


def _extract(given: argparse.Namespace) -> int:
    bag = bag_in(given.bag)
    if given.support:
        run = open_run(bag, begin=given.support[0], end=given.support[1])
        print(write_support(run, given.out, *given.support))
        print_missing(run.missing)
    else:
        _write_files(bag, given.out)
    return DONE


def _print_verified(found: Verified) -> None:
    for topic, count in sorted(found.by_topic.items()):
        print(f"{count:8d}  {topic}")
    print_missing(found.lost)
    seconds, size = (found.end_ns - found.start_ns) * 1e-9, found.size / 1e6
    for line in found.unread:
        print(f"counted, not decoded: {line}")
    done = "read" if found.unread else "read and decoded"
    read = f"{found.messages} messages over {seconds:.3f} s, {size:.2f} MB, every one {done}"
    print(f"{found.folder}: {read}")


def _print_recovered(bag: Path, found: Recovered) -> None:
    for line in found.lost:
        print(f"lost: {line}")
    _print_verified(found.verified)
    if not found.made:
        print(f"{bag}: is whole, nothing was written")


def _check(given: argparse.Namespace) -> int:
    """Print what the check of a bag shows, or what is lost of one that breaks off; return 1 where it breaks a rule."""
    bag = bag_in(given.bag)
    try:
        found = None if given.file else check(bag)
        _print_verified(found.verified if found else verify(bag))
    except BagError:
        with suppress(BagError):  # of a bag in sqlite3 there is none
            for line in survey(bag):
                print(f"lost: {line}")
        raise
    if found is None:
        return DONE
    for line in found.findings:
        print(line)
    for line in found.events:
        print(f"reported: {line}")
    print(found.line)
    return FOUND if found.findings else DONE


def _write_files(bag: Path, out: Path) -> None:
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


CHECK = Command(_bag_to_check, _check, _BAG)
RECOVER = Command(_bag_and_copy, _recover, "bags/cut_off --out out/recovered")
REPAIR = Command(_bag, _repair, _BAG)
EXTRACT = Command(_bag_and_files, _extract, f"{_BAG} --out out/extracted")
