# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid basin`: what it prints and writes; the shares themselves: atpid_sim/test/test_basin.py."""

import csv
import json
from pathlib import Path

import pytest
from dynamics_program import main
from sim_refusals import has_parts

SCENES = Path(__file__).parents[3] / "scenes"


def test_the_command_prints_and_writes_shares(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = str(SCENES / "standard.yaml"), tmp_path / "shares.csv"
    assert main(["basin", scene, "--heights", "0.14:0.24:2", "--kick", "0.1", "--json", "--out", str(out)]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["height"] for row in rows] == [0.14, 0.24]
    assert (rows[0]["share"], rows[1]["share"], rows[1]["starts"]) == (1.0, None, 0)  # the second is irregular
    assert [row["height"] for row in csv.DictReader(out.read_text().splitlines())] == ["0.14", "0.24"]
    assert main(["basin", str(SCENES / "free_decay.yaml")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    has_parts(printed.err.removesuffix("\n"), ("excitation", "tone"))
