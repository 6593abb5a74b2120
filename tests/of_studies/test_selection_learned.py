# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The learned selector: against the best of a simulation, beyond its range, its file, and its training."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_control.cli import main
from atpid_control.selection import Excitation, SelectionError, learning
from atpid_control.selection.height_model import SHARE, HeightModel, ModelError, inputs_of
from atpid_control.selection.learned import LearnedSelector
from atpid_control.selection.map_cache import map_for
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import Scene, load_scene
from studies.pure_loop import run_loop
from studies.seeds.measure import configured
from studies.thorough_search import thorough_best

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "atpid_control/config/learned/heights.npz"


@pytest.fixture(scope="module")
def model() -> HeightModel:
    return HeightModel.load(MODEL)


@pytest.fixture(scope="module")
def bench() -> Scene:
    return load_scene(ROOT / "scenes/thesis_4_3.yaml")


def other_beam() -> Scene:
    return load_scene(ROOT / "scenes/stiff_beam.yaml")


@pytest.mark.parametrize(
    ("name", "amplitude"), [("thesis_4_3", 0.012), ("thesis_4_3", 0.05), ("stiff_beam", 0.002), ("stiff_beam", 0.005)]
)
def test_the_height_is_a_little_below_the_best(model: HeightModel, name: str, amplitude: float) -> None:
    scene = load_scene(ROOT / f"scenes/{name}.yaml")  # soft contacts, which the training has not seen
    damper = DamperResponse(scene, 1e-5)
    chosen, best = LearnedSelector(scene, model).select(Excitation(amplitude)), thorough_best(damper, amplitude)
    share = (chosen.height - damper.diameter) / (best.height - damper.diameter)
    assert share == pytest.approx(SHARE, abs=0.035)
    there = learning.remaining_at(
        damper, amplitude, (chosen.height - damper.diameter) / damper.ballistic_clearance(amplitude)
    )
    assert 1.0 - chosen.efficiency == pytest.approx(there, abs=0.04)
    assert chosen.beam_amplitude == pytest.approx(there * damper.closed_amplitude(amplitude), rel=0.25)
    assert there < 1.0 - best.efficiency + 0.04


def test_only_dimensionless_numbers_count(model: HeightModel, bench: Scene) -> None:
    # four times as large at half the frequency: the same accelerations
    large = bench.with_(
        beam={"mass": 0.3258, "stiffness": 427.6 / 4.0, "damping": 0.28},
        grain={"mass_fraction": 0.1, "radius": 0.034},
        ceiling={"height": 0.5},
    )
    small, great = (DamperResponse(scene, 1e-5) for scene in (bench, large))
    assert inputs_of(large, great, 0.08) == pytest.approx(inputs_of(bench, small, 0.02), rel=1e-4)
    heights = [LearnedSelector(s, model).select(Excitation(a)).height for s, a in ((bench, 0.02), (large, 0.08))]
    assert heights[1] == pytest.approx(4.0 * heights[0], rel=1e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mass_fraction": 0.02}, "mass fraction: the scene's is 0.02"),
        ({"beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 3.0}}, "damping ratio: the scene's is"),
        ({"beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 1.1}, "mass_fraction": 0.05}, "times the beam's"),
        ({"contact": {"law": "impact", "restitution": 0.9}}, "restitution: the scene's is 0.9"),
        ({"gravity": 0.0}, "gravity: the scene's is 0"),
        ({"frequency": 6.0}, "frequency: given 6 Hz"),
    ],
)
def test_a_system_beyond_the_range_is_refused(
    model: HeightModel, bench: Scene, change: dict[str, Any], words: str
) -> None:
    with pytest.raises(SelectionError, match=words) as caught:
        LearnedSelector(bench.with_(**change), model)
    assert "\n" not in str(caught.value)
    assert "direct" in str(caught.value)


def test_an_excitation_beyond_the_range_is_refused(model: HeightModel, bench: Scene) -> None:
    selector = LearnedSelector(bench, model)
    for amplitude in (0.005, 0.5):
        with pytest.raises(SelectionError, match=r"covers 0\.007279 to 0\.182 m for this beam and grain"):
            selector.select(Excitation(amplitude))
    with pytest.raises(SelectionError, match="frequency: given 6 Hz"):
        selector.select(Excitation(0.02, frequency=6.0))
    assert (
        selector.select(Excitation(0.02, frequency=1.02 * bench.frequency_hz)).height
        == selector.select(Excitation(0.02)).height
    )


def test_a_margin_takes_the_lower_end_and_its_price_is_unknown(model: HeightModel, bench: Scene) -> None:
    selector = LearnedSelector(bench, model)
    safe = selector.select(Excitation(0.02, 0.001), 3.0)
    assert safe.height == selector.select(Excitation(0.017)).height
    assert math.isnan(safe.price)
    # not below what the model covers
    assert selector.select(Excitation(0.02, 0.02), 1.0).height < selector.select(Excitation(0.0075)).height


@pytest.mark.slow
def test_the_shipped_errors_are_those_of_the_shipped_systems(model: HeightModel) -> None:
    again = learning.with_errors(model, lambda done: None).errors
    assert [row["left_out"] for row in again] == [row["left_out"] for row in model.errors]
    for now, kept in zip(again, model.errors, strict=True):
        assert now["systems"] == kept["systems"]
        assert now["clearance"] == pytest.approx(kept["clearance"], rel=0.02)
        assert now["above"] == pytest.approx(kept["above"], abs=0.02)
        assert now["amplitude"] == pytest.approx(kept["amplitude"], abs=0.02)
        assert now["lost"] == pytest.approx(kept["lost"], abs=0.005)
        assert now["clearance"][0] < 0.01
        assert now["lost"][0] < 0.03


@pytest.mark.slow
def test_shipped_systems_simulated_again_are_the_same(model: HeightModel) -> None:
    rows = np.arange(0, len(model.inputs), 60)
    # the shipped model, as the shipped map, was made with the thorough search
    again = learning.train(model.inputs[rows], lambda done: None, thorough_best)
    assert np.median(np.abs(again.clearances / model.clearances[rows] - 1.0)) < 1e-6
    assert model.inputs[:8] == pytest.approx(learning.draw(1024)[:8])
    assert (model.inputs >= learning.LOWEST).all()
    assert (model.inputs <= learning.HIGHEST).all()


def test_a_system_drawn_has_the_inputs_it_was_drawn_with() -> None:
    for inputs in learning.draw(32)[:5]:
        drawn = learning.system_of(inputs)
        damper = DamperResponse(drawn.scene, 1e-5)
        assert inputs_of(drawn.scene, damper, drawn.amplitude) == pytest.approx(inputs, rel=1e-9)


@pytest.mark.slow
def test_the_command_trains_a_model_that_selects(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["learn", "--out", str(tmp_path), "--systems", "32"]) == 0
    printed = capsys.readouterr().out
    assert "every fifth system" in printed
    file = tmp_path / "heights.npz"
    assert main(["select", str(ROOT / "scenes/stiff_beam.yaml"), "--method", "learned", "--map", str(file)]) == 0
    small = HeightModel.load(file)
    assert len(small.inputs) == 29
    # coarse, but of the same physics
    best = thorough_best(DamperResponse(other_beam(), 1e-5), 0.004).height
    assert LearnedSelector(other_beam(), small).select(Excitation(0.004)).height == pytest.approx(best, rel=0.15)


def test_too_few_systems_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["learn", "--out", str(tmp_path), "--systems", "5"]) == 2
    assert "--systems: given 5; allowed: a whole number from 32 to 4096" in capsys.readouterr().err


def test_a_file_that_is_no_model_is_one_line(model: HeightModel, tmp_path: Path) -> None:
    saved = tmp_path / "copy.npz"
    model.save(saved)
    read = HeightModel.load(saved)
    assert np.array_equal(read.predict(model.inputs[:5]), model.predict(model.inputs[:5]))
    assert read.errors == model.errors
    text, cut, pickled, damaged = (tmp_path / f"{name}.npz" for name in ("text", "cut", "pickled", "damaged"))
    text.write_text("no model")
    cut.write_bytes(saved.read_bytes()[:1000])
    np.savez(pickled, about=np.array({"format": 1}, dtype=object))
    HeightModel(model.inputs, model.clearances[:3], model.remaining, model.drawn_from).save(damaged)
    maps = ROOT / "atpid_control/config/maps/standard.npz"
    for path in (text, cut, pickled, damaged, maps, tmp_path / "none.npz"):
        with pytest.raises(ModelError, match="learn --out DIR") as caught:
            HeightModel.load(path)
        assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_the_loop_is_damped_by_it() -> None:
    scene = other_beam()
    ran = run_loop(scene, configured(), map_for(scene))
    beam, damper, rate = ran.beam, DamperResponse(scene, 1e-5), scene.sensors.laser.rate
    for end, amplitude in ((8.0, 0.002), (16.0, 0.006), (24.0, 0.004)):
        there = 0.5 * float(np.ptp(beam[round((end - 1.0) * rate) : round(end * rate)]))
        assert there < 0.2 * damper.closed_amplitude(amplitude)
    assert not any(ran.rumbling[-20:])
