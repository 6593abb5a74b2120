# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The study of the identifier's error bars: it counts and prints, and what its page shows is so."""

import math
import re
from pathlib import Path

import pytest

from studies.cli import main as studies
from studies.identification import coverage

PAGE = Path(__file__).parents[2] / "docs/identification.md"
#: Slow noise beneath white noise of its own size: two periods show it in two of three windows, as the page states.
HIDDEN = "AR(0.99), 0.5 %, and white, 0.5 %"


def test_the_command_puts_its_table_into_a_page(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- made by python -m studies identification -->\n<!-- end -->\nafter\n")
    monkeypatch.setattr(coverage, "CASES", {"white noise, 1 %": coverage.CASES["white noise, 1 %"]})
    assert studies(["identification", "--signals", "2", "--seed", "1", "--page", str(page)]) == 0
    lines = page.read_text().splitlines()
    assert lines[-3].startswith("| white noise, 1 % | 2 |")
    assert (lines[0], lines[-2:]) == ("before", ["<!-- end -->", "after"])
    assert lines[-3] in capsys.readouterr().out


def test_modes_that_ring_do_not_spoil_what_excites(capsys: pytest.CaptureFixture[str]) -> None:
    assert studies(["identification", "--structures", "8", "--seed", "1"]) == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if "e-" in line]
    assert len(rows) == 2  # support and force
    assert sum(int(row[2]) for row in rows) == sum(int(row[3]) for row in rows) == 80
    for row in rows:
        assert float(row[4].split(", ")[1]) < 5e-3
        assert float(row[6].split(", ")[1]) < 1.5e-3
        assert float(row[5].split()[0]) > 80.0
        assert float(row[7].split()[0]) > 80.0


@pytest.mark.parametrize("name", sorted(set(coverage.CASES) - {HIDDEN}))
def test_bars_hold_or_the_estimate_is_not_steady(name: str) -> None:
    found = coverage.coverage(name, 120, 31)
    if found.steady > 0.04 * found.signals:
        least = found.steady * 0.93 - 3.5 * math.sqrt(found.steady * 0.93 * 0.07)
        assert min(found.amplitude, found.frequency, found.phase) >= least, found


@pytest.mark.parametrize("name", ["white noise, 1 %", "AR(0.9), 1 %", "clipped at 0.9 A, then noise 0.3 %", HIDDEN])
def test_the_page_shows_what_is_counted_now(name: str) -> None:
    page = PAGE.read_text(encoding="utf-8")
    made = re.search(r"studies identification --signals (\d+) --seed (\d+) --page", page)
    row = re.search(rf"^\| {re.escape(name)} \| (\d+) \| (.*) \|$", page, re.MULTILINE)
    assert made is not None
    assert row is not None
    found = coverage.coverage(name, int(made[1]), int(made[2]))
    # another processor may round one of them to the other side of a threshold
    assert found.steady == pytest.approx(int(row[1]), abs=2)
    shares = [float(share.removesuffix(" %")) for share in row[2].split(" | ") if share != "-"]
    held = (found.amplitude, found.frequency, found.phase) if found.steady else ()
    assert [100.0 * one / found.steady for one in held] == pytest.approx(shares, abs=1.0)
