# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies modes`: a random structure of several modes beside scipy's integration, and what a mode costs."""

import pytest

from studies import modal
from studies.cli import main

#: Eight times the study's: scipy's own error control keeps to the contacts, of milliseconds, with longer steps as well.
LONGEST = 4e-4


@pytest.mark.slow
def test_a_structure_is_that_of_scipy_and_the_tables_show_what_a_mode_costs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = modal.drawn
    monkeypatch.setattr(modal, "drawn", lambda rng: drawn(rng).with_(duration=1.2, steady_window=[0.6, 1.2]))
    monkeypatch.setattr(modal, "_LONGEST", LONGEST)
    monkeypatch.setattr(modal, "_REPEATS", 1)
    assert main(["modes", "--systems", "1", "--seed", "11"]) == 0
    rows = dict(line.strip().rsplit("  ", 1) for line in capsys.readouterr().out.splitlines() if "  " in line.strip())
    found = {name.strip(): value.strip() for name, value in rows.items()}
    assert float(found["impacts, median"]) > 5
    assert found["amplitude reproducible"] == "1"
    assert found["of these within 0.2 % of scipy's"] == "1"
    assert float(found["difference, median and worst"].split(", ")[1]) < 2e-3
    assert float(found["ledger of a mode, worst"]) < 2e-6
    assert any(name.startswith("8 ") for name in found)
