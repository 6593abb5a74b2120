# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selection for structures of several modes, under a force, and by root mean square."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_control.cli import main
from atpid_control.selection import Excitation, SelectionError, make_selector
from atpid_control.selection.by_rms import Rated, Realisation, _as_good, least_rms
from atpid_control.selection.complex_model import ComplexModel
from atpid_control.selection.predictive import equilibrium, simplified
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import system_of
from atpid_sim.maps import DamperResponse, best_height, build_map
from atpid_sim.scene import Scene, scene_from_mapping, standard_bench
from atpid_sim.simulation.simulate import simulate
from atpid_sim.simulation.unrepeated import vibration

SECOND = {"mass": 2.4, "frequency": 56.0, "damping_ratio": 0.02, "drive_factor": -0.18}


def two_modes(drive: str = "support", **changes: Any) -> Scene:
    amplitude = 0.01 if drive == "support" else 4.0
    tone = {"amplitude": amplitude, "frequency": "resonance"}
    return standard_bench(**({"further_modes": [SECOND], "drive": drive, "excitation": tone} | changes))


@pytest.mark.parametrize("drive", ["support", "force"])
@pytest.mark.parametrize("ratio", [0.9, 1.0, 1.04, 1.15])
def test_the_simplified_model_is_the_lesser_of_free_and_closed_modes(drive: str, ratio: float) -> None:
    scene = two_modes(drive)
    frequency = ratio * scene.natural_frequency_hz
    model = simplified(system_of(scene), frequency, 0.01)
    both = [scene.linear_amplitude(0.01, frequency, grain=grain) for grain in (False, True)]
    assert model.amplitude == pytest.approx(min(both), rel=1e-12)


def test_one_heavy_mode_beside_changes_nothing() -> None:
    alone = standard_bench(excitation={"amplitude": 0.01, "frequency": "resonance"})
    beside = two_modes(further_modes=[{"mass": 1e6, "frequency": 56.0, "damping_ratio": 0.02}])
    one, two = (simplified(system_of(scene), alone.frequency_hz, 0.01) for scene in (alone, beside))
    assert two.amplitude == pytest.approx(one.amplitude, rel=1e-5)
    assert equilibrium(system_of(beside)) == pytest.approx(equilibrium(system_of(alone)), rel=1e-12)


def test_the_complex_model_begins_where_the_simplified_one_is() -> None:
    """Without a ceiling to meet and a grain of no weight the structure goes on as it was."""
    scene = two_modes("force", gravity=0.0, grain={"mass_fraction": 1e-6, "radius": 0.0085})
    damper = DamperResponse(scene, 1e-8)
    sm = simplified(damper.system, damper.frequency, 4.0)
    t, start = sm.first_return(0.3)
    model = ComplexModel(damper, 4.0, t, start, 1e3)
    state: State = model._state
    assert (state.beam, state.beam_velocity) == pytest.approx((start.beam, start.beam_velocity), rel=1e-9)
    amplitude, _ = model.observe(1e3, 3.0, 4.0)
    assert amplitude == pytest.approx(sm.amplitude, rel=1e-3)


@pytest.mark.parametrize("drive", ["support", "force"])
def test_pca_is_close_to_the_best(drive: str) -> None:
    scene = two_modes(drive)
    amplitude = 0.01 if drive == "support" else 4.0
    chosen = make_selector("pca", scene).select(Excitation(amplitude))
    assert [stage.name for stage in chosen.stages][:3] == ["SM", "SM + PM1", "CM1"]
    assert chosen.beam_amplitude < 1.05 * best_height(DamperResponse(scene, 1e-5), amplitude).amplitude


def test_learned_states_that_it_knows_one_mode() -> None:
    chosen = make_selector("learned", two_modes()).select(Excitation(0.01))
    assert chosen.note.startswith("learned from structures of one mode, shaken at the support")
    assert not make_selector("learned", standard_bench()).select(Excitation(0.01)).note


def test_a_force_is_refused_in_newtons(tmp_path: Path) -> None:
    scene = two_modes("force")
    with pytest.raises(SelectionError, match=r"amplitude: given 0\.001 N; the learned model covers .* N for this beam"):
        make_selector("learned", scene).select(Excitation(0.001))
    made = build_map(scene, [3.0, 4.0], [scene.grain.mass_fraction], tmp_path / "force.npz")
    assert np.isnan(made.reductions).all()  # of one mode on its support, which is not this structure
    lookup = make_selector("lookup", scene, tmp_path / "force.npz")
    assert lookup.select(Excitation(4.0)).efficiency > 0.7
    with pytest.raises(SelectionError, match=r"amplitude 5 N is outside its 3 to 4 N"):
        lookup.select(Excitation(5.0))


# by root mean square


def noisy(duration: float = 12.0, **changes: Any) -> Scene:
    """Heights of one realisation are compared, which a window of some forty periods does as well as a long one."""
    psd = {"psd": [[2.0, 1.0e-5], [12.0, 1.0e-5]], "unit": "m^2/Hz"}
    scene = {"excitation": {"random": psd}, "tolerance": 1e-4, "seed": 3, "steady_window": [5.0, duration]}
    return standard_bench(**(scene | changes), duration=duration)


def test_a_height_is_rated_as_a_run_is() -> None:
    """Every height under the same drive, that of `simulate`."""
    scene = noisy()
    own = Realisation(scene)
    for height in (0.06, 0.12):
        run = simulate(scene.with_(height=height), check=False)
        assert own.rated(height).rms == pytest.approx(run.rms, rel=1e-12)
        assert math.sqrt(float(np.mean(own.closed))) == pytest.approx(run.undamped_rms, rel=1e-12)
    low, high = (vibration(scene.with_(height=height)).support for height in (0.06, 0.12))
    assert np.array_equal(low, high)


def squares(rms: float, spread: float, rng: np.random.Generator, common: np.ndarray) -> np.ndarray:
    found: np.ndarray = rms**2 * (common + spread * rng.standard_normal(len(common)))
    return found


def test_what_lies_within_the_error_is_named_and_what_does_not_is_not() -> None:
    """The drive's own fluctuation, the same at every height, is no error of the difference."""
    rng = np.random.default_rng(1)
    common = 1.0 + 0.5 * rng.standard_normal(400)
    at = {0.05: 1.2, 0.06: 1.0003, 0.07: 1.0, 0.08: 1.0002, 0.09: 1.1, 0.10: 1.0001}
    seen = [Rated(height, squares(rms, 0.02, rng, common)) for height, rms in at.items()]
    best = min(seen, key=lambda one: one.rms)
    text = _as_good(seen, best)
    assert text.startswith("0.0600 to 0.0800 m are no worse within 2 standard errors, nor are 1 heights elsewhere, 0.1")
    assert "; worse: 0.0500 m by 20 ± " in text
    assert "0.0900 m by 10 ± " in text
    alone = [Rated(height, squares(rms, 0.02, rng, common)) for height, rms in ((0.05, 1.2), (0.06, 1.0), (0.07, 1.1))]
    assert _as_good(alone, alone[1]).startswith("its neighbours are worse; worse: 0.0500 m by 20 ± ")


@pytest.mark.slow
def test_the_height_of_least_rms_is_that_of_a_scan() -> None:
    scene = noisy(drive="force", further_modes=[SECOND],
                  excitation={"random": {"psd": [[2.0, 1.5], [12.0, 1.5]], "unit": "m^2/Hz"}})  # fmt: skip
    chosen, bare, _ = least_rms(scene)
    own = Realisation(scene)
    scanned = [own.rated(float(height)).rms for height in np.linspace(0.02, 2.0 * chosen.height, 20)]
    assert chosen.beam_amplitude <= 1.01 * min(scanned)
    assert chosen.efficiency > 0.2
    assert chosen.beam_amplitude < bare
    assert [stage.name for stage in chosen.stages] == ["RMS", "as good", "again"]
    assert chosen.stages[2].note.startswith("seed 4, with which it was not selected: efficiency 0.")


def test_where_the_grain_is_not_lifted_the_damper_stays_closed() -> None:
    quiet = {"tones": [{"amplitude": 1e-4, "frequency": 5.3}, {"amplitude": 1e-4, "frequency": 5.9}]}
    chosen, _, _ = least_rms(noisy(excitation=quiet))
    assert (chosen.height, chosen.efficiency) == (0.017, 0.0)
    assert chosen.no_use.startswith("the damper is of no use: the best height found, ")
    assert chosen.no_use.endswith(" % off the RMS; it stays closed")


def test_heights_keep_to_the_ceiling_s_range() -> None:
    ceiling = {"closed": 0.05, "range": [0.05, 0.08], "speed": 0.3, "controller": "direct"}
    chosen, _, _ = least_rms(noisy(ceiling=ceiling))
    assert 0.05 <= chosen.height <= 0.08


def test_the_command_selects_by_rms_and_refuses_the_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tones = {"tones": [{"amplitude": 0.004, "frequency": 5.3}, {"amplitude": 0.003, "frequency": 5.9}]}
    scene = scene_from_mapping(noisy(excitation=tones).to_mapping())
    file = tmp_path / "tones.yaml"
    file.write_text(scene.to_yaml())
    assert main(["select", str(file), "--method", "direct", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["measure"] == "root mean square"
    assert found["amplitude"] == pytest.approx(simulate(scene.with_(height=found["height"]), check=False).rms, rel=1e-9)
    assert [stage["name"] for stage in found["stages"]] == ["RMS", "as good"]
    for given in (["--method", "pca"], ["--method", "direct", "--margin", "2"]):
        assert main(["select", str(file), *given]) == 2
        assert capsys.readouterr().err.startswith(f"error: excitation: given a tones one with method {given[1]}")
