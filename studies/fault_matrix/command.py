# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies faults --out DIR [--page FILE]`: each fault through the real graph, and its page."""

import argparse
import sys
from itertools import chain, count
from pathlib import Path

from atpid_common import output
from atpid_common.arguments import MOST_SEED, file_path, path_to, whole
from atpid_common.errors import InputError
from atpid_common.injected_faults import PARTS, Injected
from atpid_common.middleware import HIGHEST_DOMAIN
from atpid_control.stand.domain import own_domain
from atpid_control.stand.processes import stoppable
from atpid_sim.display import counting
from studies.fault_matrix import paced
from studies.fault_matrix.journal import Journal
from studies.fault_matrix.page import page
from studies.fault_matrix.run import BEGIN, END, Finished, Row, in_lockstep, problems, reference_of, row_of, rows
from studies.fault_matrix.run import run as run_one
from studies.fault_matrix.sequences import Sequences

#: How often a run in real time is begun again where the machine was too busy for it.
_ATTEMPTS = 3
#: Arguments of the example in the help.
EXAMPLE = "--part motor --out out/faults"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("--out", type=file_path, required=True, help="folder for scenes and bags of the runs")
    add("--part", choices=PARTS, help="only the faults of this part; default: all")
    add("--page", type=path_to(".md"), metavar="FILE.md", help="write the page; of all parts only")
    add("--domain", type=whole(0, HIGHEST_DOMAIN), help="ROS domain to use; default: a free one")
    random = "in place of the matrix, N random sequences of faults; those in --out that passed are not run again"
    add("--sequences", type=whole(1, 10**6), metavar="N", help=random)
    add("--faults", type=whole(1, 20), default=5, help="faults in a sequence (default: 5)")
    add("--seed", type=whole(0, MOST_SEED), default=1, help="of the sequences (default: 1)")


def run(args: argparse.Namespace) -> int:
    """Run the matrix, print what went against the documentation; return 0, or 1 where something did."""
    if args.sequences is not None:
        return _sequences(args)
    if args.page is not None and args.part is not None:
        raise InputError("--page: given with --part; the page shows all parts: leave one out")
    journal = Journal(output.folder(args.out))
    if args.page is not None:
        output.file(args.page, "--page")
    found = _rows(args, journal)
    for row in found:
        begin = BEGIN if isinstance(row, Row) else paced.BEGIN
        event = f"{row.detected.kind} after {row.detected.time - begin:.2f} s" if row.detected else "not detected"
        print(f"{row.part:<14} {row.kind:<13} {event}")
    wrong = [line for row in found for line in (problems(row) if isinstance(row, Row) else paced.problems(row))]
    for line in wrong:
        print(line, file=sys.stderr)
    if args.page is not None:
        with output.writing(args.page, "--page"):
            args.page.write_text(page(found), encoding="utf-8")
    print(f"{len(found)} faults, {len(wrong)} against the documentation")
    return 1 if wrong else 0


def _sequences(args: argparse.Namespace) -> int:
    """Run random sequences and print those that fail; return 0, or 1 where one did, in this call or before."""
    if args.page is not None or args.part is not None:
        raise InputError("--sequences: given with --page or --part, which are the matrix's; leave them out")
    sequences = Sequences(output.folder(args.out), args.seed, args.faults)
    with own_domain(args.domain), counting("sequences", args.sequences) as shown:
        for sequence in sequences.run(args.sequences, shown):
            for line in sequence.problems:
                print(f"sequence {sequence.number} of seed {args.seed}: {line}", flush=True)
            if sequence.problems:
                print("  " + "; ".join(map(str, sequence.faults)), flush=True)
    failed = sorted(number for number, found in sequences.done.items() if found)
    run = f"{len(sequences.done)} sequences of {args.faults} faults, seed {args.seed}, {sequences.felt} felt"
    print(f"{run}: {f'{len(failed)} failed: {failed}' if failed else 'none failed'}")
    return 1 if failed else 0


def _rows(args: argparse.Namespace, journal: Journal) -> list[Row | paced.PacedRow]:
    """Run those rows that the journal lacks; return all."""
    chosen = [(part, kind) for part, kind in rows() if args.part in (None, part)]
    left = [(part, kind) for part, kind in chosen if (part, kind) not in journal.rows]
    with counting("faults", len(chosen)) as shown, stoppable():
        usual: dict[tuple[Injected, ...], Finished] = {}
        for number, (part, kind) in enumerate(left):
            shown(len(chosen) - len(left) + number + 1)
            with own_domain(args.domain):
                if in_lockstep(part):
                    journal.add(_in_lockstep(part, kind, args.out, usual))
                else:
                    journal.add(_paced(part, kind, args.out, journal))
    return [journal.rows[one] for one in chosen]


def _in_lockstep(part: str, kind: str, out: Path, usual: dict[tuple[Injected, ...], Finished]) -> Row:
    without = reference_of(part)
    if without not in usual:
        usual[without] = run_one(without, out, _free(out, f"without-{len(without)}"))
    fault = Injected(part, kind, BEGIN, END)
    return row_of(fault, run_one((fault,), out, _free(out, f"{part}-{kind}")), usual[without])


def _paced(part: str, kind: str, out: Path, journal: Journal) -> paced.PacedRow:
    without = journal.reference(part, lambda: _in_time(None, part, out, f"without-{part}"))
    fault = Injected(part, kind, paced.BEGIN, paced.END)
    return paced.row_of(fault, _in_time(fault, part, out, f"{part}-{kind}"), without)


def _in_time(fault: Injected | None, part: str, out: Path, name: str) -> paced.Paced:
    """Return a run that kept up with the clock; of those tried, the last one where none did."""
    for _ in range(_ATTEMPTS):
        done = paced.run(fault, part, out, _free(out, name))
        if not done.late:
            return done
    print(f"{name}: fell behind the clock in {_ATTEMPTS} runs: end other programs and repeat", file=sys.stderr)
    return done


def _free(out: Path, name: str) -> str:
    """Return `name`, or with a number where a run that was interrupted has left a bag of that name."""
    names = chain([name], (f"{name}-{number}" for number in count(2)))
    return next(one for one in names if not any((out / f"{one}{end}").exists() for end in ("", ".yaml", "-log")))
