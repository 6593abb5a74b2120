# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies steady`: what `simulate --steady` finds in random systems, beside the judge; a page's table."""

import argparse
import json
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from atpid_common.arguments import MOST_SEED, file_path, whole
from atpid_common.output import finite
from atpid_sim.commands.options import add_workers, workers_of
from atpid_sim.display import counting
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic import SteadyState, steady_state
from atpid_sim.simulation.batch import Batch, Progress, Workers
from atpid_sim.simulation.journal import Record
from studies.journal_option import add_journal
from studies.steady.judge import CHANCE, IRREGULAR, OTHER, PERIODIC, Judgement, judge
from studies.steady.systems import LAWS, drawn

#: What a stated largest multiplier may be off.
_RIGHT = 5e-3
#: Lines of the page between which the table stands.
_BEGIN, _END = "<!-- made by python -m studies steady -->", "<!-- end -->"
#: Arguments of the example in the help.
EXAMPLE = "--systems 20"


@dataclass(frozen=True)
class Compared:
    """A system, what the judge says of it, and what `--steady` finds."""

    number: int
    law: str
    gravity: float
    judged: Judgement
    ending: str  # of the search
    found: bool
    method: str
    periods: int
    amplitude: float
    stated_error: float
    multiplier: float
    took: float  # processor time of the search [s]

    @property
    def same(self) -> bool:
        """Whether the motion found is the one the long run comes to."""
        allowed = OTHER + self.stated_error
        return self.found and abs(self.amplitude / self.judged.amplitude - 1.0) <= allowed

    @property
    def due(self) -> bool:
        """Whether the long run comes to one periodic motion, however slightly it is disturbed."""
        return self.judged.ending == PERIODIC

    @property
    def multiplier_right(self) -> bool:
        """Whether the largest multiplier is the judge's, a period."""
        stated = abs(self.multiplier) ** (1.0 / self.periods)
        own = abs(self.judged.multiplier) ** (1.0 / self.judged.periods)
        return bool(abs(stated - own) <= _RIGHT + self.judged.unsure)


def compare(seed: int, number: int, modal: bool = False) -> Compared:
    """Return what `--steady` finds of a system, beside the judge."""
    scene = drawn(seed, number, modal)
    judged = judge(scene)
    begun = time.thread_time()
    state: SteadyState | None = None
    try:
        search = steady_state(scene)
        state, ending = search.state, search.ending.name
    except NumericalFailure as failure:
        ending = str(failure)
    took = time.thread_time() - begun
    if state is None:
        return Compared(
            number, scene.contact.law, scene.gravity, judged, ending, False, "", 0, math.nan, math.nan, math.nan, took
        )  # fmt: skip
    return Compared(
        number, scene.contact.law, scene.gravity, judged, ending, True, state.method.name, state.periods,
        state.amplitude, state.error_estimate, float(abs(state.multipliers[0])), took,
    )  # fmt: skip


def judged_and_found(
    seed: int,
    numbers: Sequence[int],
    workers: Workers,
    progress: Progress,
    journal: Path | None = None,
    modal: bool = False,
) -> list[Compared]:
    """Return what the judge says of each system, and what is found; journal: file from which a run goes on."""
    record: Record[int, Compared] | None = None
    if journal is not None:
        record = Record(
            journal, {"steady": 1, "seed": seed, "modal": modal}, lambda number: (float(number),), _plain, _back
        )
    done = Batch(lambda number: compare(seed, number, modal), list(numbers)).run(workers, progress, record)
    if record is not None:
        record.finish()
    return done


def _plain(one: Compared) -> dict[str, Any]:
    return asdict(one) | {"judged": one.judged._asdict()}


def _back(plain: Mapping[str, Any]) -> Compared:
    return Compared(**{**plain, "judged": Judgement(**plain["judged"])})


def table(done: Sequence[Compared], seed: int) -> str:
    """Return the counts as Markdown, a row a law and one for all."""
    lines = [
        "| law | systems | periodic | found | the same | period right | multiplier right | irregular, found none "
        "| by chance, found none | refused alike |",
        "|---" * 10 + "|",
    ]
    for law in (*LAWS, "all"):
        chosen = [each for each in done if law in (each.law, "all")]
        due = [each for each in chosen if each.due]
        found = [each for each in due if each.found]
        irregular = [each for each in chosen if each.judged.ending == IRREGULAR]
        chance = [each for each in chosen if each.judged.ending == CHANCE]
        refused = [each for each in chosen if each.judged.ending not in (PERIODIC, IRREGULAR, CHANCE)]
        counts = [
            f"{len(chosen)}", f"{len(due)}", f"{len(found)}", f"{sum(each.same for each in found)}",
            f"{sum(each.periods == each.judged.periods for each in found)}",
            f"{sum(each.multiplier_right for each in found)}",
            f"{sum(not each.found for each in irregular)} of {len(irregular)}",
            f"{sum(not each.found for each in chance)} of {len(chance)}",
            f"{sum(each.ending == each.judged.ending for each in refused)} of {len(refused)}",
        ]  # fmt: skip
        lines.append(f"| {law} | " + " | ".join(counts) + " |")
    methods = Counter(each.method for each in done if each.found)
    ways = ", ".join(f"{count} {name.lower()}" for name, count in sorted(methods.items()))
    lines += ["", f"Seed {seed}, systems 0 to {len(done) - 1}. Found by: {ways}."]
    odd = [f"{each.number} ({each.law}): {_odd(each)}" for each in done if _odd(each)]
    return "\n".join([*lines, "", "Not as the judge has it: " + ("; ".join(odd) or "none") + "."])


def _odd(one: Compared) -> str:
    """Return in what a search differs from the judge; empty: in nothing."""
    if one.due and not one.found:
        return f"{one.ending}, judged periodic"
    if one.due and not one.same:
        return f"amplitude {one.amplitude:.6g} m, judged {one.judged.amplitude:.6g} m"
    if one.due and one.periods != one.judged.periods:
        return f"period {one.periods}, judged {one.judged.periods}"
    if one.due and not one.multiplier_right:
        return f"multiplier {one.multiplier:.4f}, judged {one.judged.multiplier:.4f}"
    if not one.due and one.found:
        return f"found {one.amplitude:.6g} m, judged {one.judged.ending}, {one.judged.amplitude:.6g} m"
    return "" if one.due or one.judged.ending in (IRREGULAR, CHANCE) or one.ending == one.judged.ending else one.ending


def into(page: Path, text: str) -> None:
    """Put the table between its two lines of a page."""
    before, rest = page.read_text(encoding="utf-8").split(_BEGIN)
    page.write_text(f"{before}{_BEGIN}\n{text}\n{_END}{rest.split(_END)[1]}", encoding="utf-8")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    parser.add_argument("--systems", type=whole(1, 100_000), default=64, metavar="N", help="how many; default 64")
    parser.add_argument("--seed", type=whole(0, MOST_SEED), default=1, metavar="S", help="which systems; default 1")
    parser.add_argument("--modes", action="store_true", help="structures of two to five modes, and forces")
    parser.add_argument("--page", type=file_path, metavar="FILE", help="page whose table is made anew")
    parser.add_argument("--json", action="store_true", help="print every system as JSON instead of the table")
    add_workers(parser)
    add_journal(parser)


def run(args: argparse.Namespace) -> int:
    """Judge, compare, print, and fill in the page; return 0."""
    with counting("systems", args.systems) as count:
        done = judged_and_found(args.seed, range(args.systems), workers_of(args), count, args.journal, args.modes)
    text = table(done, args.seed)
    print(
        json.dumps(finite([asdict(each) | {"judged": each.judged._asdict()} for each in done])) if args.json else text
    )
    if args.page is not None:
        into(args.page, text)
    return 0
