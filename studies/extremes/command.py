# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies extremes`: random systems far outside the thesis's range, and a table of their outcomes."""

import argparse
import json
from collections import Counter
from typing import Any

import numpy as np

from atpid_common import output
from atpid_common.arguments import MOST_SEED, file_path, refuse, whole
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.simulation.batch import Batch
from atpid_sim.simulation.integration import FIDELITIES
from atpid_sim.simulation.journal import Record, beside
from studies.extremes.systems import TOLERANCE, Case, broken, case_of, fidelities_for, run_case

_QUANTILES = (("median", 0.5), ("90 %", 0.9), ("99 %", 0.99))
#: Arguments of the example in the help.
EXAMPLE = "--systems 200 --out out/extremes"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--systems", type=whole(1, 1_000_000), default=1000, metavar="N", help="how many systems; default 1000"
    )
    parser.add_argument("--first", type=whole(0, 10**9), default=0, metavar="I", help="index of the first; default 0")
    parser.add_argument(
        "--seed", type=whole(0, MOST_SEED), default=1, metavar="N", help="which sequence of systems; default 1"
    )
    parser.add_argument(
        "--modes", action="store_true", help="structures of two to nine modes, half of them driven by a force"
    )
    levels = "levels to run; default soft,impact"
    parser.add_argument("--fidelities", type=_fidelities, default="soft,impact", metavar="F,F", help=levels)
    parser.add_argument(
        "--out", type=file_path, required=True, metavar="DIR", help="folder for extremes.json and extremes.md"
    )
    add_workers(parser)


def _fidelities(text: str) -> list[str]:
    found = text.split(",")
    if not set(found) <= set(FIDELITIES) or len(set(found)) < len(found):
        refuse(text, f"each once, separated by commas, of {', '.join(FIDELITIES)}")
    return found


def run(args: argparse.Namespace) -> int:
    """Run all systems and write the table; return 0. Raises NumericalFailure where one breaks a guarantee."""
    folder = output.folder(args.out)
    drawn = range(args.first, args.first + args.systems)
    jobs = [
        (index, fidelity)
        for index in drawn
        for fidelity in fidelities_for(args.seed, index, args.fidelities, args.modes)
    ]
    purpose = {"extremes": 1, "seed": args.seed, "modes": args.modes, "tolerance": TOLERANCE}
    record: Record[tuple[int, str], Case] = Record(
        beside(folder / "extremes.json"), purpose, tuple, Case._asdict, case_of
    )
    batch = Batch(lambda job: run_case(args.seed, *job, args.modes), jobs)
    with counting("extreme systems", len(jobs)) as count:
        cases = batch.run(workers_of(args), count, record)
    wrong = [text for text in map(broken, cases) if text]
    summary = _summary(cases, args.seed, wrong) | {"refused": len(drawn) * len(args.fidelities) - len(jobs)}
    text = _markdown(cases, summary)
    with output.writing(folder):
        (folder / "extremes.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
        (folder / "extremes.md").write_text(text, encoding="utf-8")
    record.finish()
    print(text)
    if wrong:
        raise NumericalFailure(f"{len(wrong)} of {len(cases)} runs broke a guarantee; the first: {wrong[0]}")
    return 0


def _summary(cases: list[Case], seed: int, wrong: list[str]) -> dict[str, Any]:
    done = [case for case in cases if case.outcome == Outcome.DONE]
    steps = np.array([case.steps for case in cases])
    residuals = np.array([case.residual for case in done] or [0.0])
    return {
        "seed": seed,
        "tolerance": TOLERANCE,
        "systems": len({case.number for case in cases}),
        "runs": len(cases),
        "shortened": sum(case.shortened for case in cases),
        "outcomes": {outcome.name: count for outcome, count in Counter(case.outcome for case in cases).items()},
        "over_budget": sum(case.steps > case.budget for case in cases),
        "not_finite": sum(not case.finite for case in done),
        "outside": sum(not case.inside for case in done),
        "energy_from_contact": sum(case.contact_loss < -1e-9 for case in done),
        "steps": {name: int(np.quantile(steps, q)) for name, q in (("median", 0.5), ("99 %", 0.99), ("largest", 1.0))},
        "largest_share_of_budget": max(case.steps / case.budget for case in cases),
        "residual": {name: float(np.quantile(residuals, q)) for name, q in _QUANTILES},
        "longest_s": max(case.wall_s for case in cases),
        "wall_s": sum(case.wall_s for case in cases),
        "broken": wrong,
    }


def _markdown(cases: list[Case], summary: dict[str, Any]) -> str:
    lines = [
        "| fidelity | law | runs | done | overlap too deep | other | most steps | median residual |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for fidelity, law in sorted({(case.fidelity, case.law) for case in cases}):
        chosen = [case for case in cases if (case.fidelity, case.law) == (fidelity, law)]
        done = [case.residual for case in chosen if case.outcome == Outcome.DONE]
        deep = sum(case.outcome == Outcome.OVERLAP_TOO_DEEP for case in chosen)
        middle = f"{np.median(done):.0e}" if done else "-"
        most = max(case.steps for case in chosen)
        lines.append(
            f"| {fidelity} | {law} | {len(chosen)} | {len(done)} | {deep} | "
            f"{len(chosen) - len(done) - deep} | {most} | {middle} |"
        )
    totals = [f"- {key}: {value}" for key, value in summary.items() if key != "broken"]
    return "\n".join([*lines, "", *totals, *(f"- BROKEN: {text}" for text in summary["broken"]), ""])
