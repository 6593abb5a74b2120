# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control.recording verify|repair|extract BAG`: is it whole, make it so, and what was it made with."""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from atpid_control.bags.errors import BagError, in_words
from atpid_control.bags.read import open_bag
from atpid_control.bags.support import write_support
from atpid_control.bags.verify import repair, verify

BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Verify or repair a bag, or write the files kept in it or its support's motion; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m atpid_control.recording", description=__doc__)
    add = parser.add_argument
    add("action", choices=("verify", "repair", "extract"))
    add("bag", type=Path, help="folder of the bag")
    add("--out", type=Path, default=Path(), help="extract: folder for scene, parameters, map (default: here)")
    support = "extract: instead of those, the support's motion as support.csv for a scene; a part of it, in s"
    add("--support", type=interval, nargs="?", const=(0.0, math.inf), metavar="FROM:TO", help=support)
    given = parser.parse_args(arguments)
    if given.support and given.action != "extract":
        parser.error(f"--support: given with {given.action}; allowed: with extract")
    try:
        if given.support:
            print(write_support(open_bag(given.bag), given.out, *given.support))
        elif given.action == "extract":
            _extract(given.bag, given.out)
        else:
            found = repair(given.bag) if given.action == "repair" else verify(given.bag)
            for topic, count in sorted(found.by_topic.items()):
                print(f"{count:8d}  {topic}")
            seconds, size = (found.end_ns - found.start_ns) * 1e-9, found.size / 1e6
            read = f"{found.messages} messages over {seconds:.3f} s, {size:.2f} MB, every one read and decoded"
            print(f"{found.folder}: {read}")
    except BagError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    return 0


def interval(text: str) -> tuple[float, float]:
    """Return two times FROM:TO [s]; raise argparse's error where they are none."""
    try:
        begin, end = (float(part) for part in text.split(":"))
    except ValueError:
        begin = end = math.nan
    if not 0.0 <= begin < end:
        raise argparse.ArgumentTypeError(f"given {text}; allowed is FROM:TO, two rising times from 0 on in s")
    return begin, end


def _extract(bag: Path, out: Path) -> None:
    files = open_bag(bag).files
    if not files:
        needed = "parameters scene and files of recorder_node"
        raise BagError(f"{bag}: no scene or other file was kept in this bag ({needed})")
    for name, data in files.items():
        # only the name: a bag from elsewhere must not write outside the folder given
        path = out / Path(name).name
        if path.exists():
            raise BagError(f"{path}: exists already and is not written over; give another folder with --out")
        try:
            out.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        except OSError as error:
            raise BagError(f"{path}: cannot be written: {in_words(error)}") from None
        print(path)


if __name__ == "__main__":
    sys.exit(main())
