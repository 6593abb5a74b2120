# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""docs/design.md: its worked example is run as it stands there; its files are whole, and its scene runs."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from documented import ROOT, code
from page_visit import visited
from test_figures import differences

from atpid_control.cli import main
from atpid_control.design.problem import Uncertainty
from atpid_sim.figure_numbers import numbers_in
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene

PAGE = ROOT / "docs/design.md"
#: The panel that shows irregular motion, whose numbers are luck.
_LUCK = "over the height"
#: The least favourable case of an interval may move irregularly, and then differs from processor to processor, by 1.3 %
#: where seen.
_CLOSE = 0.03


def documented(program: str) -> list[str]:
    """Return the arguments of the page's own example of a program."""
    (line,) = [line for line in code(PAGE) if line.startswith(program) and "out/design" in line]
    return line.removeprefix(program).split()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder the worked example writes."""
    out = tmp_path_factory.mktemp("design")
    arguments = documented("atpid design ")
    arguments[arguments.index("--out") + 1] = str(out)
    assert main(["design", *arguments]) == 0
    return out


@pytest.fixture(scope="module")
def made(folder: Path) -> Any:
    return json.loads((folder / "design.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_worked_example_is_what_is_computed_now(folder: Path, made: Any) -> None:
    text = PAGE.read_text(encoding="utf-8")
    low, high = made["heights"]
    for shown in (
        f"{1e3 * made['grain_mass']:.0f} g, {100 * made['mass_fraction']:.0f} % of beam and grain, "
        f"{2e3 * made['radius']:.1f} mm in diameter",
        f"{1e3 * low:.1f} to {1e3 * high:.1f} mm, closed {2e3 * made['radius']:.1f} mm",
        f"at least {100 * made['efficiency']['low']:.0f} %, at most {100 * made['efficiency']['high']:.0f} %",
        f"{made['motor']['speed']:.3g} m/s",
        f"{made['motor']['force']:.0f} N, {made['motor']['impact_rate']:.1f} times a second; on the floor "
        f"{made['motor']['floor_force']:.0f} N",
        f"{100 * made['reduction']['low']:.0f} to {100 * made['reduction']['high']:.0f} %",
        f"{made['motor']['sound_power_level']:.0f} dB re 1 pW",
        f"{1e3 * made['points'][-1]['beam_amplitude']['expected']:.1f} mm, at most "
        f"{1e3 * made['points'][-1]['beam_amplitude']['high']:.1f} mm",
        f"today {1e3 * made['points'][-1]['bare_amplitude']['expected']:.1f} mm there, "
        f"{1e3 * made['bare_resonance_amplitude']:.0f} mm at its own resonance",
        f"a tuned mass of 500 g | {1e3 * made['tuned_mass']['rows'][2]['tuned']:.1f} mm",
    ):
        assert shown in text, "run `make figures` and look at docs/design.md"
    printed, now = numbers_in(ROOT / "docs/figures/design.png"), numbers_in(folder / "design.png")
    steady, steady_now = ({k: v for k, v in numbers.items() if _LUCK not in k} for numbers in (printed, now))
    assert differences(steady, steady_now, _CLOSE) == []
    assert [line.partition(":")[0] for line in made["warnings"]] == [
        "reduction below 0", "structure", "--young-modulus",
    ]  # fmt: skip


@pytest.mark.slow
def test_the_page_is_whole_and_needs_no_other_file(folder: Path) -> None:
    text = (folder / "design.html").read_text(encoding="utf-8")

    class Tags(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.open: list[str] = []
            self.sources: list[str] = []

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.sources += [value or "" for name, value in attrs if name in ("src", "srcset", "href")]
            if tag not in ("meta", "img", "source"):
                self.open.append(tag)

        def handle_endtag(self, tag: str) -> None:
            assert self.open.pop() == tag

    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.sources == []
    assert text.count("<figcaption>") == len(numbers_in(folder / "design.png"))  # a panel
    for words in ("The choice of the grain", "Over the amplitudes", "Motor and container", "What is assumed", "500 g"):
        assert words in text


@pytest.mark.slow
def test_the_page_is_accessible_on_every_screen(folder: Path) -> None:
    assert {name: wrong for name, wrong in visited(folder / "design.html").items() if wrong} == {}


@pytest.mark.slow
def test_every_number_is_finite_and_in_its_interval(made: Any) -> None:
    assert [point["amplitude"] for point in made["points"]] == sorted(point["amplitude"] for point in made["points"])
    for point in made["points"]:
        for name in ("efficiency", "reduction", "beam_amplitude", "bare_amplitude", "ceiling_force"):
            assert point[name]["low"] <= point[name]["expected"] <= point[name]["high"]
    assert made["motor"]["force"] == max(point["ceiling_force"]["high"] for point in made["points"])
    assert min(point["efficiency"]["low"] for point in made["points"]) >= made["problem"]["target_efficiency"]


@pytest.mark.slow
def test_the_scene_loads_simulates_and_has_its_map(folder: Path, made: Any, capsys: pytest.CaptureFixture[str]) -> None:
    scene = load_scene(folder / "scene.yaml")
    assert [line.partition(":")[0] for line in scene.warnings()] == ["contact.young_modulus"]
    heights = HeightMap.load(folder / "heights.npz")
    heights.check(scene)
    middle = made["points"][len(made["points"]) // 2]
    assert heights.lookup(middle["amplitude"], scene.grain.mass_fraction).height == pytest.approx(middle["height"])
    assert main(["simulate", str(folder / "scene.yaml"), "--height", str(middle["height"]), "--json"]) == 0
    efficiency = json.loads(capsys.readouterr().out)["efficiency"]
    assert middle["efficiency"]["low"] <= efficiency <= middle["efficiency"]["high"]


@pytest.mark.slow
def test_the_bench_keeps_the_promise_at_every_stage(folder: Path, made: Any, tmp_path: Path) -> None:
    assert main(["bench", str(folder / "scene.yaml"), "--out", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run/summary.json").read_text(encoding="utf-8"))
    points = {round(point["amplitude"], 5): point["efficiency"] for point in made["points"]}
    assert len(summary["stages"]) == 3
    for stage in summary["stages"]:
        promised = points[round(stage["excitation_amplitude"], 5)]
        assert promised["low"] <= stage["efficiency"] <= promised["high"]
    shown = re.findall(r"ends with ([\d.]+), ([\d.]+) and ([\d.]+) %", PAGE.read_text(encoding="utf-8"))
    assert [float(one) for one in shown[0]] == [
        pytest.approx(100 * stage["efficiency"], abs=0.1) for stage in summary["stages"]
    ]
    assert not any(event in summary["events"] for event in ("drift", "refused", "step_back"))


def test_the_uncertainties_of_the_page_are_the_defaults() -> None:
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) (%|mm) \|", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    shown = {name: float(value) / (100.0 if unit == "%" else 1e3) for name, value, unit in rows}
    assert shown == pytest.approx(Uncertainty().model_dump())


def test_make_figures_runs_the_command_of_the_page() -> None:
    joined = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    (line,) = re.findall(r"atpid design ([^;]*);", joined)
    assert line.split() == documented("atpid design ")
