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

import numpy as np
import pytest
from parts import CHEAP, OTHERS, TABLE, first, measured

ROOT = Path(__file__).resolve().parent.parent
#: Where each worker writes what it has measured; set for the run that measures.
FOLDER = "ATPID_COSTS"
#: Cores, and tests at once (Makefile).
CORES, WORKERS = 2, 3


def _now() -> Any:
    """Return the processor time of this process and of those it has waited for, and the time on the clock (2,) [s]."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return np.array([sum(each.ru_utime + each.ru_stime for each in both), time.perf_counter()])


class Meter:
    """Measures every phase of every test of one worker; wide fixtures apart."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / f"{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.jsonl"
        self._fixtures = np.zeros(2)  # of this phase, wide ones

    def _phase(self, item: pytest.Item, shared: bool = False) -> Iterator[None]:
        begun, self._fixtures = _now(), np.zeros(2)
        yield
        spent, uses = _now() - begun - self._fixtures, item.fixturenames  # type: ignore[attr-defined]
        self._write(spent, kind="end" if shared else "test", node=item.nodeid, uses=uses)

    def _write(self, spent: Any, **row: Any) -> None:
        with self._path.open("a") as file:
            file.write(json.dumps(row | {"spent": spent.tolist()}) + "\n")

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
        before, begun, self._fixtures = self._fixtures, _now(), np.zeros(2)
        result = yield
        whole = _now() - begun
        self._write(whole - self._fixtures, kind="fixture", name=fixturedef.argname, base=fixturedef.baseid)
        self._fixtures = before + whole
        return result


def install(config: pytest.Config) -> None:
    """Measure where the run is one of `main`."""
    if folder := os.environ.get(FOLDER):
        config.pluginmanager.register(Meter(Path(folder)))


def costs(folder: Path) -> tuple[dict[str, float], float, float]:
    """Return the core seconds of every test, and of all the processor time and the time waited for [s]."""
    spent: dict[str, Any] = defaultdict(lambda: np.zeros(2))
    uses: dict[str, set[str]] = {}
    shared: list[tuple[str, str, Any]] = []
    alone = set[str]()
    for path in folder.glob("*.jsonl"):
        for row in map(json.loads, path.read_text().splitlines()):
            took = np.array(row["spent"])
            if row["kind"] == "fixture":
                shared.append((row["name"], row["base"], took))
                continue
            uses[row["node"]] = set(row["uses"])
            alone |= {row["node"]} if path.stem == "main" else set()
            if row["kind"] == "end":
                shared.append(("", row["node"].partition("::")[0], took))
            else:
                spent[row["node"]] += took
    for name, base, whole in shared:
        users = [node for node in uses if node.startswith(base) and (not name or name in uses[node])]
        for node in users:
            spent[node] += whole / len(users)
    share = {True: CORES, False: CORES / WORKERS}  # of the machine, while it runs
    dear = {node: max(processor, clock * share[node in alone]) for node, (processor, clock) in spent.items()}
    processor, clock = sum(spent.values())
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
