# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control.recording verify|repair|scene BAG`: is it whole, make it so, and what scene was it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from atpid_control.bagread import open_bag
from atpid_control.recording.errors import BagError
from atpid_control.recording.verify import repair, verify

BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Verify or repair a bag, or print its scene; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m atpid_control.recording", description=__doc__)
    parser.add_argument("action", choices=("verify", "repair", "scene"))
    parser.add_argument("bag", type=Path, help="folder of the bag")
    given = parser.parse_args(arguments)
    try:
        if given.action == "scene":
            print(_scene(given.bag), end="")
            return 0
        found = (repair if given.action == "repair" else verify)(given.bag)
    except BagError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    for topic, count in sorted(found.by_topic.items()):
        print(f"{count:8d}  {topic}")
    seconds = (found.end_ns - found.start_ns) * 1e-9
    print(
        f"{found.folder}: {found.messages} messages over {seconds:.3f} s, "
        f"{found.size / 1e6:.2f} MB, every one read and decoded"
    )
    return 0


def _scene(path: Path) -> str:
    text = open_bag(path).scene_text
    if text is None:
        raise BagError(f"{path}: no scene was recorded in this bag (parameter scene of recorder_node)")
    return text


if __name__ == "__main__":
    sys.exit(main())
