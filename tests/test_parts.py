# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `make test` runs is decided by what each test costs, and takes no longer than it may."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from inventory import inventory
from parts import BUDGET, FILE, FUNCTION, OTHERS, first, measured
from sizes import ROOT, budgets, routes, sizes

NODES = st.builds("test_{}.py::test_{}[{}]".format, st.integers(0, 3), st.integers(0, 3), st.integers(0, 9))
COSTS = st.dictionaries(NODES, st.floats(0.0, 2.0 * FILE), min_size=1)


@given(COSTS, st.sets(NODES))
def test_a_function_takes_what_it_may_and_a_file_is_left_out_only_where_it_has_nothing_cheap(
    costs: dict[str, float], always: set[str]
) -> None:
    chosen = first(costs, costs, always)
    assert always <= chosen
    for function in {node.partition("[")[0] for node in costs}:
        taken = sorted(costs[node] for node in chosen - always if node.startswith(f"{function}["))
        assert sum(taken) <= FUNCTION or (len(taken) == 1 and taken[0] <= FILE)
    for file in {node.partition("::")[0] for node in costs}:
        members = {node for node in costs if node.startswith(file)}
        assert chosen & members or min(costs[node] for node in members) > FILE


def test_a_test_without_a_row_belongs_to_it() -> None:
    assert first(["a.py::test_new", "a.py::test_dear"], {"a.py::test_dear": 99.0}) == {"a.py::test_new"}


def test_what_make_test_runs_takes_no_longer_than_it_may(request: pytest.FixtureRequest) -> None:
    costs = measured()
    always = {item.nodeid for item in request.session.items if item.get_closest_marker("always")}
    others = costs.pop(OTHERS)
    assert others + sum(costs[node] for node in first(costs, costs, always & costs.keys())) <= BUDGET


def test_the_table_has_the_tests_that_there_are(root: Path) -> None:
    """Where one has another name now: `make costs`, or the name in the table."""
    gone, texts = [], dict[str, str]()
    for node in measured().keys() - {OTHERS}:
        file, name = node.partition("[")[0].split("::")[:2]  # a function, or a class, which may inherit its tests
        if file not in texts:
            texts[file] = (root / file).read_text() if (root / file).is_file() else ""
        if not re.search(rf"^(?:(?:def|class) )?{name}\b", texts[file], re.MULTILINE):
            gone.append(node)
    assert gone == []


def test_the_tests_stay_as_many_as_one_can_read() -> None:
    counts = inventory()
    assert counts.sentences <= 120
    assert counts.private <= 15


def test_the_project_stays_as_large_as_one_can_read() -> None:
    found, most = sizes(), budgets()
    assert found.keys() == most.keys()
    assert {name: size for name, size in found.items() if size > most[name]} == {}


def test_each_file_of_a_route_is_reached_from_one_before_it() -> None:
    listed = (ROOT / "tests/routes.yaml").read_text(encoding="utf-8")
    for files in routes().values():
        assert len(files) <= 12
        before = ""
        for path in files:
            package, _, module = Path(path).with_suffix("").as_posix().partition("/")[2].rpartition("/")
            imported = rf"{package.replace('/', '.')}(\.| import [\w\s,(]*\b){module}\b"
            assert not before or re.search(imported, before) or f"{path} # " in listed, path
            before += (ROOT / path).read_text(encoding="utf-8")
