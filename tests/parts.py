# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which tests `make test` runs, and which are left to `make test-all`: decided by what each costs, as measured.

tests/costs.tsv has the core seconds of every test that costs more than `CHEAP`; `make costs` measures them. Of each
test function as many cases belong to `make test`, in their order, as cost `FUNCTION` together; of a file in which no
test does, the cheapest one does, up to `FILE`. A test marked `always` belongs to it whatever it costs. All others are
marked `rest`. A new test has no row and belongs to `make test` until it is measured.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

TABLE = Path(__file__).parent / "costs.tsv"
#: All costs are in core seconds: the processor time of a test and its processes, or two thirds of the time it takes
#: where that is more, since three tests at once share two cores.
CHEAP = 0.2  # below this a test has no row of its own
OTHERS = "all others"
FUNCTION = 1.2
FILE = 10.0
#: Of `make test`, on two cores: 300 s less the start and the checks.
BUDGET = 400.0


def measured(table: Path = TABLE) -> dict[str, float]:
    """Return the core seconds of each test that has a row."""
    rows = (line.split("\t", 1) for line in table.read_text(encoding="utf-8").splitlines())
    return {node: float(seconds) for seconds, node in rows}


def first(nodes: Iterable[str], costs: Mapping[str, float], always: Iterable[str] = ()) -> set[str]:
    """Return those of these tests that belong to `make test`; pytest's names, in the order of collection."""
    chosen: set[str] = set(always)
    spent: dict[str, float] = {}
    files: dict[str, list[str]] = {}
    for node in nodes:
        function, cost = node.partition("[")[0], costs.get(node, 0.0)
        files.setdefault(node.partition("::")[0], []).append(node)
        if spent.get(function, 0.0) + cost <= FUNCTION:
            spent[function] = spent.get(function, 0.0) + cost
            chosen.add(node)
    for members in files.values():
        cheapest = min(members, key=lambda node: costs.get(node, 0.0))
        if chosen.isdisjoint(members) and costs[cheapest] <= FILE:
            chosen.add(cheapest)
    return chosen


def mark(items: list[pytest.Item]) -> None:
    """Mark what is left to `make test-all`, and put the dearest files first, so that all workers end together."""
    costs, files = measured(), Counter[str]()
    chosen = first([item.nodeid for item in items], costs, {i.nodeid for i in items if i.get_closest_marker("always")})
    for item in items:
        if item.nodeid not in chosen:
            item.add_marker("rest")
        files[item.nodeid.partition("::")[0]] += costs.get(item.nodeid, 0.0)  # type: ignore[assignment]
    items.sort(key=lambda item: -files[item.nodeid.partition("::")[0]])
