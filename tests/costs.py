# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measure what each test costs and write tests/costs.tsv: `python tests/costs.py` (`make costs`), all tests once.

Run it on a machine that does nothing else. What a fixture of a module or of the session costs is shared by all tests
that use it. `python tests/costs.py --table` prints where the time goes, by file.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from parts import CHEAP, OTHERS, TABLE, first, measured

ROOT = Path(__file__).resolve().parent.parent
#: Where each worker writes what it has measured; set for the run that measures.
FOLDER = "ATPID_COSTS"
#: Cores, and tests at once (Makefile).
CORES, WORKERS = 2, 3


def _now() -> tuple[float, float]:
    """Return the processor time of this process and of those it has waited for, and the time on the clock [s]."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in both), time.perf_counter()


class Meter:
    """Measures every phase of every test of one worker; wide fixtures apart."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / f"{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.jsonl"
        self._fixtures: list[tuple[float, float]] = []

    def _phase(self, item: pytest.Item, shared: bool = False) -> Iterator[None]:
        begun, self._fixtures = _now(), []
        yield
        wide = [sum(part) for part in zip((0.0, 0.0), *self._fixtures, strict=True)]
        spent = [end - begin - part for end, begin, part in zip(_now(), begun, wide, strict=True)]
        self._write(kind="end" if shared else "test", node=item.nodeid, spent=spent, uses=item.fixturenames)  # type: ignore[attr-defined]

    def _write(self, **row: Any) -> None:
        with self._path.open("a") as file:
            file.write(json.dumps(row) + "\n")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        return (yield from self._phase(item))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        return (yield from self._phase(item))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_teardown(self, item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
        ends = nextitem is None or nextitem.path != item.path
        return (yield from self._phase(item, shared=ends))

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: pytest.FixtureRequest) -> Iterator[None]:
        if fixturedef.scope == "function":
            return (yield)
        before, begun = self._fixtures, _now()
        self._fixtures = []  # of those that this one asks for
        result = yield
        inner = [sum(part) for part in zip((0.0, 0.0), *self._fixtures, strict=True)]
        whole = tuple(end - begin for end, begin in zip(_now(), begun, strict=True))
        self._fixtures = [*before, (whole[0], whole[1])]
        own = [total - part for total, part in zip(whole, inner, strict=True)]
        self._write(kind="fixture", name=fixturedef.argname, base=fixturedef.baseid, spent=own)
        return result


def install(config: pytest.Config) -> None:
    """Measure where the run is one of `main`."""
    if folder := os.environ.get(FOLDER):
        config.pluginmanager.register(Meter(Path(folder)))


def costs(folder: Path) -> tuple[dict[str, float], float, float]:
    """Return the core seconds of every test, and of all the processor time and the time waited for [s].

    From what the workers have written in `folder`.
    """
    spent: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
    uses: dict[str, set[str]] = {}
    shared: list[tuple[str, str, list[float]]] = []
    alone = set[str]()
    for path in folder.glob("*.jsonl"):
        for row in map(json.loads, path.read_text().splitlines()):
            if row["kind"] == "fixture":
                shared.append((row["name"], row["base"], row["spent"]))
                continue
            uses[row["node"]] = set(row["uses"])
            alone |= {row["node"]} if path.stem == "main" else set()
            if row["kind"] == "end":
                shared.append(("", row["node"].partition("::")[0], row["spent"]))
            else:
                spent[row["node"]] = [a + b for a, b in zip(spent[row["node"]], row["spent"], strict=True)]
    for name, base, whole in shared:
        users = [node for node in uses if node.startswith(base) and (not name or name in uses[node])]
        for node in users:
            spent[node] = [a + b / len(users) for a, b in zip(spent[node], whole, strict=True)]
    share = {True: CORES, False: CORES / WORKERS}  # of the machine, while it runs
    dear = {node: max(processor, clock * share[node in alone]) for node, (processor, clock) in spent.items()}
    processor, clock = (sum(each) for each in zip(*spent.values(), strict=True))
    return dear, processor, clock - processor


def measure() -> int:
    """Run all tests and write the table; return pytest's exit status."""
    with tempfile.TemporaryDirectory(prefix="atpid-costs-") as folder:
        environment = os.environ | {FOLDER: folder, "OPENBLAS_NUM_THREADS": "1"}
        status = 0
        for marks, abreast in (("not wall_time", ["-n", str(WORKERS), "--dist", "loadfile"]), ("wall_time", [])):
            words = [sys.executable, "-m", "pytest", "-q", *abreast, "-m", marks]
            status = subprocess.run(words, cwd=ROOT, env=environment, check=False).returncode or status
        found, processor, waited = costs(Path(folder))
    rows = sorted((node, cost) for node, cost in found.items() if cost >= CHEAP)
    rows.append((OTHERS, sum(cost for cost in found.values() if cost < CHEAP)))
    TABLE.write_text("".join(f"{cost:.1f}\t{node}\n" for node, cost in rows), encoding="utf-8")
    print(f"{len(found)} tests, {sum(found.values()):.0f} core seconds; {len(rows) - 1} rows in {TABLE}")
    print(f"{processor:.0f} s of processor time, {waited:.0f} s waited for something else")
    return status


def table() -> None:
    """Print the core seconds of each file, all and of `make test`, the dearest first."""
    known = measured()
    chosen = first(known, known)
    whole, quick = Counter[str](), Counter[str]()
    for node, cost in known.items():
        file = node.partition("::")[0]
        whole[file] += cost  # type: ignore[assignment]
        quick[file] += cost * (node in chosen)  # type: ignore[assignment]
    print(f"{whole.total():7.0f} {quick.total():7.0f}  all files")
    for file, cost in whole.most_common():
        print(f"{cost:7.1f} {quick[file]:7.1f}  {file}")


if __name__ == "__main__":
    if sys.argv[1:] == ["--table"]:
        table()
    else:
        sys.exit(measure())
