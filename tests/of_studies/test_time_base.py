# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The study of clocks, sweeps and accelerations: what it draws, and the table it puts into a page."""

from pathlib import Path

import numpy as np
import pytest

from studies import time_base
from studies.cli import main


@pytest.mark.parametrize("name", time_base.TRANSPORTS)
def test_delays_are_never_negative_and_rarely_the_least(name: str) -> None:
    delays, _, block = time_base.TRANSPORTS[name]
    found = delays(np.random.default_rng(1), np.arange(1.0, 70_000.0) * block)
    assert found.min() >= 0.0
    assert np.median(found) > 1e-4


def test_the_command_puts_its_table_into_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of twelve minutes instead of an hour: drifts to 1 ppm, and every row is there."""
    monkeypatch.setattr(time_base, "HOUR", 700.0)
    page = tmp_path / "page.md"
    begin, end = "<!-- made by python -m studies time-base -->", "<!-- end -->"
    page.write_text(f"before\n{begin}\nold\n{end}\nafter\n", encoding="utf-8")
    assert main(["time-base", "--pairs", "1", "--signals", "3", "--page", str(page)]) == 0
    text = capsys.readouterr().out
    assert page.read_text(encoding="utf-8") == f"before\n{begin}\n{text}{end}\nafter\n"
    rows = {line.split(" | ")[0]: line.split(" | ") for line in text.splitlines()}
    assert float(rows["| 0.3 ms, heavy tail, 50 s late"][1]) < 1.0
    assert len([line for line in text.splitlines() if line.startswith(("| sweep of", "| noise of"))]) == 7
