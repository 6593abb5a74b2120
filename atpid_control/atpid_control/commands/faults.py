# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control faults --out DIR [--page FILE]`: each fault through the real graph, and its page."""

import argparse
import sys

from atpid_common import output
from atpid_common.arguments import file_path, path_to, whole
from atpid_common.errors import InputError
from atpid_common.injected_faults import NOT_ACTED, PARTS, Injected
from atpid_control.fault_matrix.page import page
from atpid_control.fault_matrix.run import BEGIN, END, Finished, Row, acted, problems, reference_of, row_of, rows
from atpid_control.fault_matrix.run import run as run_one
from atpid_control.graph.domain import MOST, own_domain
from atpid_sim.display import counting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--out", type=file_path, required=True, help="folder for scenes and bags of the runs")
    parser.add_argument("--part", choices=PARTS, help="only the faults of this part; default: all")
    parser.add_argument("--page", type=path_to(".md"), metavar="FILE.md", help="write the page; of all parts only")
    parser.add_argument("--domain", type=whole(0, MOST), help="ROS domain to use; default: a free one")


def run(args: argparse.Namespace) -> int:
    """Run the matrix, print what went against the documentation; return 0, or 1 where something did."""
    if args.page is not None and args.part is not None:
        raise InputError("--page: given with --part; the page shows all parts: leave one out")
    if args.part in NOT_ACTED:
        raise InputError(f"--part: given {args.part}; it cannot be acted: {NOT_ACTED[args.part]}")
    output.folder(args.out)
    if any(args.out.iterdir()):
        raise InputError(f"--out: given {args.out}, which is not empty; give a folder of its own to each run")
    if args.page is not None:
        output.file(args.page, "--page")
    found = _rows(args)
    for row in found:
        event = f"{row.detected.kind} after {row.detected.time - BEGIN:.2f} s" if row.detected else "not detected"
        print(f"{row.part:<14} {row.kind:<13} {event}")
    wrong = [line for row in found for line in problems(row)]
    for line in wrong:
        print(line, file=sys.stderr)
    if args.page is not None:
        with output.writing(args.page, "--page"):
            args.page.write_text(page(found), encoding="utf-8")
    left = ", ".join(part for part in PARTS if part in NOT_ACTED)
    print(f"{len(found)} faults, {len(wrong)} against the documentation; not acted: {left}")
    return 1 if wrong else 0


def _rows(args: argparse.Namespace) -> list[Row]:
    chosen = [(part, kind) for part, kind in rows() if acted(part) and args.part in (None, part)]
    found: list[Row] = []
    with own_domain(args.domain), counting("faults", len(chosen)) as count:
        references: dict[tuple[Injected, ...], Finished] = {}
        for part, kind in chosen:
            usual = reference_of(part)
            if usual not in references:
                references[usual] = run_one(usual, args.out, f"without-{len(references)}")
            count(len(found) + 1)
            fault = Injected(part, kind, BEGIN, END)
            found.append(row_of(fault, run_one((fault,), args.out, f"{part}-{kind}"), references[usual]))
    return found
