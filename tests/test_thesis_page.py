# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""docs/research/thesis.md is what `thesis all --page` computes now; every figure and table of chapters 2-4 is on it."""

import functools
import re
from pathlib import Path

import pytest

from studies.cli import main
from studies.thesis import page, run
from studies.thesis.rows import IRREGULAR, Row, rows_of
from studies.thesis.study import load, names, not_computed

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs/research/thesis.md"
#: The last number of figures and of tables in each chapter.
FIGURES, TABLES = {2: 46, 3: 26, 4: 46}, {2: 1, 3: 7}
#: Relative difference of numbers on the page; what processors round otherwise is far below.
CLOSE = 0.01
#: That of studies whose steps lead on from irregular motions: other processors end up to 15 % away.
CLOSE_BY_STEPS = {"search": 0.1, "pca": 0.05, "pca_wide": 0.25}


def printed(name: str) -> list[list[str]]:
    """Return the cells of the table in a study's section of the page."""
    section = PAGE.read_text(encoding="utf-8").partition(f"## {load(name).title}")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]


@functools.cache
def computed(name: str) -> list[Row]:
    return rows_of(load(name), *run.compute(name, ROOT / "scenes", lambda done: None))


def alike(one: str, other: str, close: float) -> bool:
    """Compare two cells of ours: words, or numbers up to a relative difference or one in their last digit."""
    try:
        difference = abs(float(one) - float(other))
    except ValueError:
        return one == other
    decimals = 0 if "e" in one else len(one.partition(".")[2])
    last_digit = 10.0**-decimals if decimals else 0.0
    return difference <= max(close * max(abs(float(one)), abs(float(other)), 1e-9), 1.01 * last_digit)


@pytest.mark.parametrize("name", [name for name in names() if not load(name).slow])
def test_the_page_shows_what_is_computed_now(name: str) -> None:
    rows, shown = computed(name), printed(name)
    assert [cells[:2] for cells in shown] == [page.cells(row)[:2] for row in rows]
    again = "run `python -m studies thesis all --out out/study --page docs/research/thesis.md`"
    for row, there in zip(rows, shown, strict=True):
        now = page.cells(row)
        assert there[3] == now[3], again
        assert there[5] == now[5], again
        if IRREGULAR not in row.why:
            close = CLOSE_BY_STEPS.get(name, CLOSE)
            assert alike(there[2], now[2], close), f"{row.figure}, {row.quantity}: {there[2]}, now {now[2]}: {again}"
            if alike(there[2], now[2], CLOSE):
                assert ("differs" in there[4]) == (row.agrees is False), again


def test_references_agree_to_eight_digits() -> None:
    assert [row.quantity for row in computed("references") if not row.agrees] == []


def numbers(text: str) -> set[tuple[int, int]]:
    """Return chapter and number of all figures, or tables, in a text such as 2.9-2.18, 2.20a."""
    found = set()
    for chapter, first, last in re.findall(r"\b(\d)\.(\d+)[a-f]?(?:-\d\.(\d+))?", text):
        found |= {(int(chapter), number) for number in range(int(first), int(last or first) + 1)}
    return found


def test_every_figure_and_table_has_its_row_or_a_reason() -> None:
    named = [row.figure for name in names() for row in load(name).rows] + [item.figures for item in not_computed()]
    figures = set().union(*(numbers(text.partition("Table")[0]) for text in named if text.startswith(("Fig", "All"))))
    tables = set().union(*(numbers(text) for text in named if text.startswith("Table")))
    assert {(chapter, k + 1) for chapter, last in FIGURES.items() for k in range(last)} - figures == set()
    assert {(chapter, k + 1) for chapter, last in TABLES.items() for k in range(last)} - tables == set()


def test_a_finished_study_is_kept_until_its_inputs_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["thesis", "constants", "--out", str(tmp_path), "--scenes", str(ROOT / "scenes")]
    assert main(command) == 0
    assert "Table 3.2" in capsys.readouterr().out
    rows = tmp_path / "constants/rows.json"
    before = rows.stat().st_mtime_ns
    assert (tmp_path / "constants/rows.csv").read_text().startswith("figure,quantity,unit,ours,thesis,difference,")
    assert main(command) == 0
    assert rows.stat().st_mtime_ns == before
    rows.write_text("damaged")
    assert main(command) == 0
    kept = rows.read_text()
    monkeypatch.setattr(run, "_sources_key", lambda: "changed")
    assert main(command) == 0
    assert rows.read_text() != kept


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("nothing --out out", {"nothing", "all", "list", "adaptive"}),
        ("heights --out out --page page.md", {"--page", "all"}),
        ("adaptive --out out --scenes nowhere", {"--scenes", "nowhere"}),
    ],
)
def test_bad_input_is_one_line(arguments: str, words: set[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["thesis", *arguments.split()]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert words <= set(re.findall(r"[\w-]+", captured.err))
