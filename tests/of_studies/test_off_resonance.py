# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selection off resonance: the predicted amplitude against simulation, `direct` against brute force, and no use."""

import json
import math
from pathlib import Path

import pytest

from atpid_control.selection import Excitation, SelectionError, make_selector
from atpid_control.selection.predictive import simplified
from atpid_sim.kernel_inputs import system_of
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.integration import undamped_amplitude
from studies.cli import main
from studies.off_resonance.command import METHODS
from studies.off_resonance.measure import compared, modal_systems, systems, table_lines
from studies.thorough_search import thorough_best

PAGE = Path(__file__).parents[2] / "docs" / "selection.md"
NATURAL = standard_bench().natural_frequency_hz


def tone(ratio: float, amplitude: float = 0.015, **changes: object) -> Scene:
    """Return the standard bench under a tone at a ratio to its natural frequency."""
    return standard_bench(excitation={"amplitude": amplitude, "frequency": ratio * NATURAL}, **changes)


@pytest.mark.parametrize("ratio", [0.5, 0.8, 0.95, 1.0, 1.03, 1.1, 1.4, 2.0])
def test_the_predicted_amplitude_is_the_lesser_of_two_simulated_beams(ratio: float) -> None:
    """The closed damper and the beam without its grain, each integrated until its transient is gone."""
    scene = tone(ratio, ceiling={"height": 0.017}, duration=40.0, steady_window=[38.0, 40.0])
    closed = undamped_amplitude(scene)
    light = scene.with_(mass_fraction=1e-6)
    bare = undamped_amplitude(light)
    predicted = simplified(system_of(scene), scene.frequency_hz, 0.015).amplitude
    assert predicted == pytest.approx(min(closed, bare), rel=1e-3)


@pytest.mark.parametrize(("ratio", "share"), [(0.85, 1.4), (0.95, 1.0), (1.0, 0.7), (1.05, 0.8), (1.1, 1.0)])
def test_the_best_height_lies_below_the_first_guess_of_its_frequency(ratio: float, share: float) -> None:
    damper = DamperResponse(tone(ratio), 1e-4)
    guess = simplified(damper.system, damper.frequency, 0.015).amplitude * math.pi
    assert guess == pytest.approx(damper.ballistic_clearance(0.015))
    best = thorough_best(damper, 0.015)
    assert 0.15 * guess < best.height - damper.diameter < share * guess


def test_at_resonance_nothing_has_changed() -> None:
    for amplitude, height in ((0.07, 1.98), (0.05, 1.41), (0.02, 0.55)):
        scene = standard_bench(excitation={"amplitude": amplitude, "frequency": "resonance"})
        model = simplified(system_of(scene), scene.frequency_hz, amplitude)
        assert model.first_height() == pytest.approx(height, rel=0.01)


@pytest.mark.parametrize("method", ["pca", "direct"])
def test_where_the_grain_is_not_lifted_nothing_is_simulated_and_it_stays_closed(method: str) -> None:
    chosen = make_selector(method, tone(1.0)).select(Excitation(0.015, frequency=0.55 * NATURAL))
    assert (chosen.height, chosen.efficiency, chosen.evaluations) == (0.017, 0.0, 0)
    assert chosen.beam_amplitude == pytest.approx(DamperResponse(tone(0.55)).closed_amplitude(0.015))
    assert "of no use at 0.015 m and 3.008 Hz" in chosen.no_use
    assert "does not lift it; it stays closed" in chosen.no_use


def test_where_every_height_is_worse_it_stays_closed() -> None:
    """12.6 m/s^2 lift the grain, but no height takes a hundredth off the beam."""
    chosen = make_selector("direct", tone(0.7, 0.01)).select(Excitation(0.01))
    assert chosen.height == 0.017
    assert chosen.evaluations > 50
    assert "the best height found" in chosen.no_use


@pytest.mark.parametrize("method", ["pca", "direct"])
def test_an_undamped_beam_is_refused_at_resonance_alone(method: str) -> None:
    undamped = standard_bench(beam={"mass": 0.3258, "stiffness": 427.6, "damping": 0.0})
    selector = make_selector(method, undamped)
    with pytest.raises(SelectionError, match=f"^{method}: a beam without damping grows without limit at resonance"):
        selector.select(Excitation(0.01))
    assert selector.select(Excitation(0.01, frequency=1.2 * undamped.natural_frequency_hz)).height >= 0.017


@pytest.mark.parametrize("method", ["pca", "direct"])
def test_a_stiff_beam_is_selected_for_at_small_amplitudes(method: str) -> None:
    """At 1 mm the grain would be pressed deeper into a wall than its radius."""
    stiff = standard_bench(beam={"mass": 1.2, "stiffness": 3.0e5, "damping": 6.0})
    selector = make_selector(method, stiff)
    with pytest.raises(SelectionError, match="deeper into a wall"):
        selector.select(Excitation(0.02))
    assert 0.017 < selector.select(Excitation(5e-5)).height < 0.1


def test_frequencies_beyond_half_and_twice_the_natural_one_are_refused() -> None:
    selector = make_selector("direct", tone(1.0))
    for ratio in (0.49, 2.01):
        with pytest.raises(SelectionError, match=r"allowed: 2\.735 to 10\.94 Hz, half to twice the natural"):
            selector.select(Excitation(0.015, frequency=ratio * NATURAL))


def shown() -> list[list[str]]:
    """Return the rows of the table of docs/selection.md."""
    after = PAGE.read_text(encoding="utf-8").partition("| f / f_0 |")[2].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in after[: after.index("")]]


@pytest.mark.slow
@pytest.mark.parametrize("number", [9])
def test_the_page_shows_what_is_computed_now(number: int) -> None:
    chosen = systems(40, 1)[number - 1]
    (done,) = compared([chosen], METHODS)
    row = [cell.strip() for cell in list(table_lines([done], METHODS))[2].strip("|").split("|")]
    there = shown()[number - 1]
    assert there[:5] == row[:5]
    for ours, theirs in zip(row[5:], there[5:], strict=True):
        assert float(ours.split(" %")[0]) == pytest.approx(float(theirs.split(" %")[0]), abs=0.3)
    assert done.short("direct") < 0.02


def test_direct_is_within_two_points_of_brute_force() -> None:
    rows = shown()
    assert len(rows) == 40
    short = [float(row[5].split(" %")[0]) - float(row[6].split(" %")[0]) for row in rows]
    assert max(short) <= 2.0


@pytest.mark.slow
def test_the_command_prints_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["off-resonance", "--systems", "1", "--seed", "7", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)["systems"]
    assert set(one["reductions"]) == {"direct", "pca"}
    assert one["brute"] >= 0.0


def test_modal_systems_have_two_and_three_modes_on_support_and_under_force() -> None:
    scenes = [one.scene() for one in modal_systems(8, 1)]
    assert {len(scene.further_modes) for scene in scenes} == {1, 2}
    assert {scene.drive for scene in scenes} == {"support", "force"}
    assert all(0.94 <= scene.frequency_hz / scene.natural_frequency_hz <= 1.08 for scene in scenes)


@pytest.mark.slow
def test_direct_is_as_good_as_brute_force_with_modes_under_a_force() -> None:
    (system,) = [one for one in modal_systems(30, 1) if one.number == 14]
    (found,) = compared([system], METHODS)
    assert system.drive == "force"
    assert found.short("direct") < 0.01
    assert found.brute == pytest.approx(0.785, abs=0.005)
    (row,) = list(table_lines([found], METHODS))[2:]
    assert "| 3.672 N |" in row
    assert row.endswith("| 1.73, 26.5 |")
