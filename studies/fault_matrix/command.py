# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies faults --out DIR [--page FILE]`: each fault through the real graph, and its page."""

import argparse
import sys
from itertools import chain, count
from pathlib import Path

from atpid_common import output
from atpid_common.arguments import file_path, path_to, whole
from atpid_common.errors import InputError
from atpid_common.injected_faults import LOCKSTEP, Injected
from atpid_common.middleware import HIGHEST_DOMAIN
from atpid_control.stand.domain import own_domain
from atpid_control.stand.processes import stoppable
from atpid_sim.display import counting
from studies.fault_matrix.journal import Journal
from studies.fault_matrix.page import page
from studies.fault_matrix.run import BEGIN, END, Finished, Row, problems, reference_of, row_of, rows
from studies.fault_matrix.run import run as run_one

#: Arguments of the example in the help.
EXAMPLE = "--part motor --out out/faults"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("--out", type=file_path, required=True, help="folder for scenes and bags of the runs")
    add("--part", choices=LOCKSTEP, help="only the faults of this part; default: all")
    add("--page", type=path_to(".md"), metavar="FILE.md", help="write the page; of all parts only")
    add("--domain", type=whole(0, HIGHEST_DOMAIN), help="ROS domain to use; default: a free one")


def run(args: argparse.Namespace) -> int:
    """Run the matrix, print what went against the documentation; return 0, or 1 where something did."""
    if args.page is not None and args.part is not None:
        raise InputError("--page: given with --part; the page shows all parts: leave one out")
    journal = Journal(output.folder(args.out))
    if args.page is not None:
        output.file(args.page, "--page")
    found = _rows(args, journal)
    for row in found:
        event = f"{row.detected.kind} after {row.detected.time - BEGIN:.2f} s" if row.detected else "not detected"
        print(f"{row.part:<14} {row.kind:<13} {event}")
    wrong = [line for row in found for line in problems(row)]
    for line in wrong:
        print(line, file=sys.stderr)
    if args.page is not None:
        with output.writing(args.page, "--page"):
            args.page.write_text(page(found), encoding="utf-8")
    print(f"{len(found)} faults, {len(wrong)} against the documentation")
    return 1 if wrong else 0


def _rows(args: argparse.Namespace, journal: Journal) -> list[Row]:
    """Run those rows that the journal lacks; return all."""
    chosen = [(part, kind) for part, kind in rows() if args.part in (None, part)]
    left = [(part, kind) for part, kind in chosen if (part, kind) not in journal.rows]
    with counting("faults", len(chosen)) as shown, stoppable():
        usual: dict[tuple[Injected, ...], Finished] = {}
        for number, (part, kind) in enumerate(left):
            shown(len(chosen) - len(left) + number + 1)
            with own_domain(args.domain):
                journal.add(_row(part, kind, args.out, usual))
    return [journal.rows[one] for one in chosen]


def _row(part: str, kind: str, out: Path, usual: dict[tuple[Injected, ...], Finished]) -> Row:
    without = reference_of(part)
    if without not in usual:
        usual[without] = run_one(without, out, _free(out, f"without-{len(without)}"))
    fault = Injected(part, kind, BEGIN, END)
    return row_of(fault, run_one((fault,), out, _free(out, f"{part}-{kind}")), usual[without])


def _free(out: Path, name: str) -> str:
    """Return `name`, or with a number where a run that was interrupted has left a bag of that name."""
    names = chain([name], (f"{name}-{number}" for number in count(2)))
    return next(one for one in names if not any((out / f"{one}{end}").exists() for end in ("", ".yaml", "-log")))
