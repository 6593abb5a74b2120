# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tutorial, command by command, in a folder of its own: what a reader types is what runs."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from documented import ROOT
from test_figures import differences
from tutorial import PICTURES, blocks, type_all

from atpid_sim.figure_numbers import numbers_in

#: What each command has to print, so that a step that silently does nothing fails.
_PRINTED = {
    r"atpid --help": "bench",
    r"atpid simulate scenes/standard\.yaml": "efficiency",
    r"atpid simulate my_beam\.yaml --height": "efficiency",
    r"atpid map ": "my_map.npz",
    r"atpid select ": "height",
    r"atpid bench ": "lost scans: 0",
    r"atpid bag verify ": "/ceiling/command",
    r"atpid bag extract ": "scene.yaml",
    r"atpid bag traces ": "/traces/beam_displacement",
    r"atpid replay ": "240 of 240 agree",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the clone's, in which the whole tutorial was typed; `printed.json` has what each command printed."""
    place = tmp_path_factory.mktemp("tutorial")
    printed = type_all(place)
    (place / "printed.json").write_text(json.dumps(printed), encoding="utf-8")
    return place


@pytest.mark.slow
def test_each_command_does_its_step(folder: Path) -> None:
    printed = json.loads((folder / "printed.json").read_text(encoding="utf-8"))
    assert len(printed) == len(_PRINTED)
    for (command, text), (pattern, word) in zip(printed.items(), _PRINTED.items(), strict=True):
        assert re.match(pattern, command)
        assert word in text, f"{command}\n{text}"


@pytest.mark.slow
def test_the_own_beam_is_damped_in_both_stages_and_the_replay_agrees(folder: Path) -> None:
    summary = json.loads((folder / "out/my_beam/summary.json").read_text(encoding="utf-8"))
    assert [stage["excitation_amplitude"] for stage in summary["stages"]] == pytest.approx([0.001, 0.002])
    assert all(stage["efficiency"] > 0.5 for stage in summary["stages"])
    (warning,) = summary["warnings"]
    assert "the thesis's contact, not that of steel" in warning  # as the page says
    assert summary["lost_scans"] == 0
    assert "<html" in (folder / "out/my_beam/report.html").read_text(encoding="utf-8")
    topics = json.loads((folder / "out/again/replay.json").read_text(encoding="utf-8"))["topics"]
    assert len(topics) == 2
    assert all(topic["agreeing"] == 240 for topic in topics)


@pytest.mark.slow
def test_the_python_example_reads_the_own_bag(folder: Path) -> None:
    (example,) = blocks("python")
    words = [sys.executable, "-W", "error", "-c", example]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False, timeout=300.0)
    assert done.returncode == 0, done.stderr
    times, amplitudes = zip(*(map(float, line.split()) for line in done.stdout.splitlines()), strict=True)
    assert len(times) == 240
    assert amplitudes[-1] == pytest.approx(0.002, rel=0.01)


@pytest.mark.slow
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
