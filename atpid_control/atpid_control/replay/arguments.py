# SPDX-License-Identifier: Apache-2.0
"""Arguments that the commands of a replay share."""

from __future__ import annotations

import argparse
import math
from pathlib import Path


def add_files(parser: argparse.ArgumentParser) -> None:
    """Declare the files that may take the place of those kept in the bag."""
    parser.add_argument("--scene", type=Path, help="scene to use in place of the one kept in the bag")
    parser.add_argument("--map", type=Path, help="height map to use in place of the one kept in the bag")


def rate(text: str) -> float:
    """Return a speed against the recording [-]; raise argparse's error where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f"given {text}; allowed: 0 to 1000")
    return value
