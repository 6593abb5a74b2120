# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tutorial, command by command, in a folder of its own: what a reader types is what runs."""

import json
from pathlib import Path

import pytest
from documented import blocks
from tutorial import PAGE, type_all


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the clone's, in which the whole tutorial was typed."""
    place = tmp_path_factory.mktemp("tutorial")
    type_all(place)
    return place


def test_the_own_beam_is_damped_in_both_stages_and_the_replay_agrees(folder: Path) -> None:
    summary = json.loads((folder / "out/my_beam/summary.json").read_text(encoding="utf-8"))
    assert [stage["excitation_amplitude"] for stage in summary["stages"]] == pytest.approx([0.001, 0.002])
    assert all(stage["efficiency"] > 0.5 for stage in summary["stages"])
    (warning,) = summary["warnings"]
    assert "steel" in warning  # as the page says
    assert summary["lost_scans"] == 0
    assert "<html" in (folder / "out/my_beam/report.html").read_text(encoding="utf-8")
    topics = json.loads((folder / "out/again/replay.json").read_text(encoding="utf-8"))["topics"]
    assert [topic["agreeing"] for topic in topics] == [240, 240]


def test_the_python_example_reads_the_own_bag(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    (example,) = blocks(PAGE, "python")
    exec(compile(example, PAGE.name, "exec"), {"__name__": "__main__"})
    printed = capsys.readouterr().out.splitlines()
    _, amplitudes = zip(*(map(float, line.split()) for line in printed), strict=True)
    assert len(amplitudes) == 240
    assert amplitudes[-1] == pytest.approx(0.002, rel=0.01)
