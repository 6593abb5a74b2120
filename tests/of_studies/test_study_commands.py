# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each study makes its result for its least size, and what studies make for pages is what is computed now."""

import itertools
import json
import re
from pathlib import Path

import pytest
import yaml

from atpid_common.files import FileError
from atpid_control.identification import linear
from atpid_sim.scene import load_scene, scene_from_mapping, standard_bench
from atpid_sim.scene.plausibility import FRICTION_LIMIT, SLOPE_LIMIT
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation.batch import Workers
from studies import designs, modal, peace01, time_base
from studies.atlas.atlas import Atlas
from studies.atlas.build import build_atlas
from studies.atlas.plan import Plan
from studies.cli import main
from studies.figures import contact, free_decay, identification
from studies.figures.scenes import schema_tables
from studies.identification import coverage
from studies.identification import measure as showcase
from studies.identification.analysis_coverage import main as analysis_coverage
from studies.off_resonance.command import METHODS
from studies.off_resonance.measure import compared, systems, table_lines
from studies.tradeoff.measure import measure, reference_of, with_front

#: A study, the arguments of its least size, and a pattern of what it prints.
CASES = {
    "dampers": ("--systems 0 --wild 3 --seed 7", r"DONE +\d"),
    "designs": ("--draws 1 --seed 1 --points 2 --page {}", r"farthest.*0\.\d"),
    "extremes": ("--systems 4 --seed 7 --fidelities impact --out {}", r"\| impact \|"),
    "identification": ("--signals 2 --seed 1 --page {}", r"\| white noise, 1 % \| 2 \|"),
    "modes": ("--systems 1 --seed 11", r"impacts, median +\d"),
    "off-resonance": ("--systems 1 --seed 8 --json", '"brute": 0.499'),
    "peace01": ("--order 15", "multiplier"),
    "planar": ("--systems 1 --seed 3 --page {}", r"\| friction \|"),
    "random-selection": ("--systems 1 --seed 2 --only direct --page {}", r"\| systems \| 1 \|"),
    "selection-speed": ("--systems 1 --busy 1 --page {}", r"\| systems held out \| 1 \|"),
    "steady": ("--systems 1 --seed 4 --workers 1 --page {}", r"\| all \| 1 \| 1 \| 1 \| 1 \|"),
    "sweep": ("--points 4 --rtol 1e-2 --fidelity impact --steady", '"steady": '),
    "time-base": ("--pairs 1 --signals 1 --page {}", r"\| sweep of"),
}


@pytest.fixture
def least_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    """What no option of a study makes smaller."""
    monkeypatch.setattr(designs, "STRUCTURES", {})
    monkeypatch.setattr("studies.designs._SYSTEMS", 2)
    monkeypatch.setattr(coverage, "CASES", {"white noise, 1 %": coverage.CASES["white noise, 1 %"]})
    drawn = modal.drawn
    monkeypatch.setattr(modal, "drawn", lambda rng: drawn(rng).with_(duration=0.8, steady_window=[0.4, 0.8]))
    monkeypatch.setattr("studies.modal._LONGEST", 4e-4)
    monkeypatch.setattr("studies.modal._REPEATS", 1)
    monkeypatch.setattr(peace01, "SPAN", (0.8, 1.1))
    monkeypatch.setattr("studies.peace01._CHECKED", 2)
    monkeypatch.setattr("studies.peace01._STEP", 2e-2)
    monkeypatch.setattr(time_base, "HOUR", 700.0)


@pytest.mark.usefixtures("least_sizes")
@pytest.mark.parametrize("name", CASES)
def test_a_study_makes_its_result(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, pattern = CASES[name]
    page = tmp_path / "page.md"
    begin = f"before\n<!-- made by python -m studies {name} -->\n"
    end = f"<!-- end of {name} -->" if name in ("planar", "random-selection") else "<!-- end -->"
    into_a_page = "--page" in arguments and name != "designs"  # which makes the whole page
    if into_a_page:
        page.write_text(f"{begin}old\n{end}\nafter\n", encoding="utf-8")
    assert main([name, *arguments.format(page).split()]) == 0
    written = page.read_text(encoding="utf-8") if page.is_file() else ""
    assert re.search(pattern, capsys.readouterr().out + written)
    if into_a_page:
        assert (written.startswith(begin), written.endswith(f"{end}\nafter\n"), "old\n" in written) == (
            True,
            True,
            False,
        )


def test_the_atlas_makes_its_result_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    tiny, out = Plan((0.1,), (0.005, 0.01), (0.01,), (1.0,), (0.3, 0.6)), tmp_path / "atlas.npz"

    def stop(done: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"\d.*2"):
        build_atlas(standard_bench(), tiny, out, stop, Workers(1))
    rows = build_atlas(standard_bench(), tiny, out).rows()
    assert len(rows) == 2
    assert rows == Atlas.load(out).rows()
    for row in rows:
        assert row["largest"] < 1.0
        assert row["best_height"] <= row["cliff"]
    with pytest.raises(FileError, match="page"):
        Atlas.load(tmp_path / "page.npz")


def test_the_coverage_of_analyses_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    analysis_coverage(1, 1)
    assert {line.count("|") for line in capsys.readouterr().out.splitlines()} == {5}


def test_every_scan_at_full_rate_arrives_or_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    """That none is dropped depends on what else the machine does; `python -m studies load` measures it."""
    status = main(["load", "--seconds", "2", "--json"])
    result = json.loads(capsys.readouterr().out)
    laser, acceleration = result["topics"]["sensors/laser"], result["topics"]["sensors/accelerometer"]
    assert (laser["channels"], laser["rate"]) == (2, 50_000.0)
    assert (acceleration["channels"], acceleration["rate"]) == (3, 12_800.0)
    for tally in (laser, acceleration):
        assert (tally["gaps"], tally["lost"]) == ([], 0)
        assert tally["invalid"] == tally["channels"] * tally["dropped"]
        assert tally["scans"] == tally["next_index"] > 0
    assert result["lost"] == laser["dropped"] + acceleration["dropped"]
    assert status == (1 if result["lost"] else 0)


def test_a_tradeoff_has_what_nothing_beats_and_levels_that_converge() -> None:
    short = standard_bench(
        duration=1.6, steady_window=[1.2, 1.6], ceiling={"closed": 0.017, "open": 0.1, "start": 0.6, "end": 0.7}
    )
    reference = reference_of(short)
    assert reference.agreement < 1e-8
    points = list(itertools.takewhile(lambda point: point.method != "lsoda", measure(short, reference)))
    found = {(point.method, point.tolerance): point for point in points}
    assert found["soft", 1e-6].amplitude_error < 1e-5
    assert found["soft", 1e-8].amplitude_error < 1e-7
    assert found["soft", 1e-6].trajectory_error < 1e-4
    assert found["finite", 1e-6].amplitude_error < 1e-3  # the damper is open for half a second: what was closed counts
    assert any(point.front for point in with_front(points))


DOCS = Path(__file__).parents[2] / "docs"


def page(name: str) -> str:
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_tables_are_the_computed_ones() -> None:
    assert contact.table() in page("contact")
    assert free_decay.table() in page("scenes")


def test_the_documented_keys_are_those_that_are_checked() -> None:
    text = page("scenes")
    assert schema_tables() in text
    assert [path.name for path in DOCS.parent.glob("scenes/*.yaml") if f"`{path.name}`" not in text] == []
    example = text.split("```yaml\n")[1].split("```")[0]
    assert scene_from_mapping(read_yaml(example, "docs")) == load_scene(DOCS.parent / "scenes" / "standard.yaml")


@pytest.mark.parametrize("case", free_decay.MEASURED, ids=lambda case: f"{case.mass_fraction}-{case.height}")
def test_decrements_are_those_measured_on_the_stand(case: free_decay.Measurement) -> None:
    """The only real measurements there are: the free decays of thesis section 2.3.1."""
    largest = free_decay.decrements(free_decay.free_decay(case.mass_fraction, case.height)).max()
    if case.within is None:
        assert largest > case.decrement
    else:
        assert largest == pytest.approx(case.decrement, rel=case.within)


def test_the_closed_damper_decays_at_one_rate_and_the_scene_that_comes_along_is_compared() -> None:
    ratios = free_decay.decrements(free_decay.free_decay(0.1, 0.017))
    assert ratios.max() / ratios.min() < 1.002
    shipped = load_scene(DOCS.parent / "scenes" / "free_decay.yaml").to_mapping()
    compared = free_decay.free_decay(0.1, 0.2).to_mapping()
    assert shipped | {"steady_window": None} == compared | {"steady_window": None}


def test_pictures_are_drawn(tmp_path: Path) -> None:
    for file in (*contact.draw(tmp_path), *free_decay.draw(tmp_path)):
        assert file.stat().st_size > 20_000
        assert (DOCS / "figures" / file.name).is_file()
    assert set(re.findall(r"figures/identification_(\w+)\.png", page("identification"))) == set(identification.FIGURES)
    assert identification.FIGURES["ramps"]().get_axes()


def test_the_pictures_of_the_identifier_are_made_with_the_parameter_file_s_values() -> None:
    text = (DOCS.parent / "atpid_control" / "config" / "identifier.yaml").read_text(encoding="utf-8")
    given = yaml.safe_load(text)["/**/identifier_node"]["ros__parameters"]
    shown = vars(showcase.SETTINGS) | {f"rumble_{name}": value for name, value in vars(showcase.RUMBLE).items()}
    assert {name: given.get(name) for name in shown if name != "saturation"} == {
        name: value for name, value in shown.items() if name != "saturation"
    }


def test_the_cache_of_compiled_functions_covers_all_their_sources() -> None:
    package = DOCS.parent / "atpid_control" / "atpid_control"
    users = {path.stem for path in package.rglob("*.py") if "\n@compiled\n" in path.read_text(encoding="utf-8")}
    assert users == set(linear.KERNELS)


def test_the_page_shows_the_coverage_that_is_counted_now() -> None:
    name = "white noise, 1 %"
    text = page("identification")
    made = re.search(r"studies identification --signals (\d+) --seed (\d+) --page", text)
    row = re.search(rf"^\| {re.escape(name)} \| (\d+) \| (.*) \|$", text, re.MULTILINE)
    assert made is not None
    assert row is not None
    found = coverage.coverage(name, int(made[1]), int(made[2]))
    # another processor may round one of them to the other side of a threshold
    assert found.steady == pytest.approx(int(row[1]), abs=2)
    shares = [float(share.removesuffix(" %")) for share in row[2].split(" | ") if share != "-"]
    held = (found.amplitude, found.frequency, found.phase) if found.steady else ()
    assert [100.0 * one / found.steady for one in held] == pytest.approx(shares, abs=1.0)


def test_the_page_shows_the_selection_off_resonance_that_is_computed_now() -> None:
    after = page("selection").partition("| f / f_0 |")[2].splitlines()[2:]
    rows = [cells(line) for line in after[: after.index("")]]
    assert len(rows) == 40
    assert max(float(row[5].split(" %")[0]) - float(row[6].split(" %")[0]) for row in rows) <= 2.0
    (done,) = compared([systems(40, 1)[8]], METHODS)
    now = cells(list(table_lines([done], METHODS))[2])
    assert rows[8][:5] == now[:5]
    for ours, theirs in zip(now[5:], rows[8][5:], strict=True):
        assert float(ours.split(" %")[0]) == pytest.approx(float(theirs.split(" %")[0]), abs=0.3)
    assert done.short("direct") < 0.02


def test_the_table_of_friction_and_slope_keeps_the_limits() -> None:
    """Within each limit 95 % of the regular motions lie within two points, and none moves two points more."""
    text = page("horizontal")
    rows = [cells(line) for line in text.splitlines() if "| within the limit |" in line]
    rows = [row for row in rows if row[1] == "within the limit"]
    assert [row[0] for row in rows] == ["friction", "slope", "both"]
    assert all(int(row[2]) > 50 and float(row[3].rstrip(" %")) >= 95.0 for row in rows[:2])
    assert all(float(row[5].rstrip(" %")) == 0.0 for row in rows)
    assert {f"{FRICTION_LIMIT:g}", f"{SLOPE_LIMIT:g}"} <= set(re.findall(r"[\d.]+\d", text))
