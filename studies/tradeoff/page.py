# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""docs/research/tradeoff.md from what `python -m studies tradeoff` wrote for three scenes."""

import argparse
import shutil
from pathlib import Path

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_common.errors import InputError
from studies import pages

_HEAD = """# Speed against accuracy

Made by `python -m studies tradeoff scenes/NAME.yaml --out DIR` for three scenes and `python -m
studies tradeoff-page`; do not edit. Times are medians of the computing thread's processor time,
compiled, first call excluded; errors are relative to the amplitude of a converged run. *Trajectory
error* is the largest distance between the two motions in the window, over the amplitude: quote it
beside the amplitude error, which can cancel. For `rk4` the tolerance is the step in seconds. The
baseline methods integrate the same compiled right-hand side; those sampled 64 times a period are
compared with the reference sampled as often, so that what lies between the samples does not count.
A method meets an error level only if all tighter tolerances do; failed runs are ignored.

**What do I run?** For 1 %: `--fidelity impact` (or `tolerance: 1e-2`, and `auto` takes it). For 0.1
% to 1e-4: `--fidelity finite`, which `auto` takes where the model error it states meets the
tolerance; where the grain mostly rests it gains less. For better: `soft`, whose amplitude error is
about its `rtol`; `tolerance: 1e-6` in the scene asks 3e-7 of the integrator, the row to compare
with others at 1e-6: `finite` may come as near, but states 7e-5, so `auto` does not take it. For the
steady motion alone: `simulate --steady`. Where the motion is chaotic no tolerance helps: look at
`reproducible` and `spread`.
"""
_TITLES = {"regular": "Regular: the standard task", "sticking": "Sticking", "irregular": "Irregular"}


#: Arguments of the example in the help.
EXAMPLE = "--regular out/standard --sticking out/sticking --irregular out/irregular --out docs/research"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    for kind in _TITLES:
        parser.add_argument(f"--{kind}", type=file_path, required=True, metavar="DIR", help="made by `tradeoff`")
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help="folder for the page")


def run(args: argparse.Namespace) -> int:
    """Assemble the page and copy the pictures into its folder `figures`; return 0."""
    page = output.folder(args.out) / "tradeoff.md"
    parts, figures = [_HEAD], output.folder(pages.figures(page))
    for kind, title in _TITLES.items():
        folder: Path = getattr(args, kind)
        if not (folder / "tradeoff.md").is_file():
            raise InputError(f"--{kind}: given {folder}; allowed: a folder that `tradeoff` has written")
        with output.writing(args.out):
            shutil.copyfile(folder / "tradeoff.png", figures / f"tradeoff_{kind}.png")
        table = (folder / "tradeoff.md").read_text(encoding="utf-8")
        parts.append(f"## {title}\n\n![{title}]({pages.link(page)}/tradeoff_{kind}.png)\n\n{table}")
    with output.writing(args.out):
        page.write_text("\n".join(parts), encoding="utf-8")
    return 0
