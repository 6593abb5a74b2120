# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tutorial, command by command, in a folder of its own: what a reader types is what runs."""

import json
import re
from pathlib import Path

import pytest
from documented import ROOT, blocks
from test_figures import differences
from tutorial import PAGE, PICTURES, type_all

from atpid_sim.figure_numbers import numbers_in

#: What each command has to print, so that a step that silently does nothing fails.
PRINTED = {
    r"atpid --help": "bench",
    r"atpid simulate scenes/standard\.yaml": "efficiency",
    r"atpid simulate my_beam\.yaml --height": "efficiency",
    r"atpid map ": "my_map.npz",
    r"atpid select ": "height",
    r"atpid bench ": "lost scans: 0",
    r"atpid bag verify ": "/ceiling/command",
    r"atpid bag extract ": "scene.yaml",
    r"atpid bag traces ": "/traces/beam_displacement",
    r"atpid replay ": "240 of 240",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the clone's, in which the whole tutorial was typed."""
    place = tmp_path_factory.mktemp("tutorial")
    printed = type_all(place)
    for (command, text), (pattern, word) in zip(printed.items(), PRINTED.items(), strict=True):
        assert re.match(pattern, command)
        assert word in text, f"{command}\n{text}"
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


@pytest.mark.parametrize("picture", PICTURES)
def test_the_pictures_are_those_a_reader_gets(folder: Path, picture: str) -> None:
    printed, now = numbers_in(ROOT / "docs/figures" / picture), numbers_in(folder / PICTURES[picture])
    if picture == "tutorial_bench.png":
        # in the map's narrow wells the last digit of the arithmetic decides between heights some 3 % apart
        heights = next(panel for panel in printed if "Ceiling height" in panel)
        assert now[heights][0] == pytest.approx(printed[heights][0], rel=0.05)
        printed, now = ({panel: found[panel] for panel in found if "Support" in panel} for found in (printed, now))
        assert len(printed) == 1
    assert differences(printed, now) == [], f"{picture} is out of date: run `make figures`"
