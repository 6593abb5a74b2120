# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selection for structures of several modes, under a force, and by root mean square."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands_run import answered, refusal

from atpid_control.selection import Excitation, SelectionError, make_selector
from atpid_control.selection.by_rms import Rated, Realisation, _as_good, least_rms
from atpid_control.selection.complex_model import ComplexModel
from atpid_control.selection.predictive import equilibrium, simplified
from atpid_sim.kernel_inputs import system_of
from atpid_sim.maps import DamperResponse, best_height, build_map
from atpid_sim.scene import Scene, scene_from_mapping, standard_bench
from atpid_sim.simulation.simulate import simulate
from atpid_sim.simulation.unrepeated import vibration

SECOND = {"mass": 2.4, "frequency": 56.0, "damping_ratio": 0.02, "drive_factor": -0.18}
AMPLITUDE = {"support": 0.01, "force": 4.0}


def two_modes(drive: str = "support", **changes: Any) -> Scene:
    tone = {"amplitude": AMPLITUDE[drive], "frequency": "resonance"}
    return standard_bench(**({"further_modes": [SECOND], "drive": drive, "excitation": tone} | changes))


@pytest.mark.parametrize("drive", AMPLITUDE)
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
    """Without a ceiling to meet and a grain of no weight the structure goes on as it was, from the first period."""
    scene = two_modes("force", gravity=0.0, grain={"mass_fraction": 1e-6, "radius": 0.0085})
    damper = DamperResponse(scene, 1e-8)
    sm = simplified(damper.system, damper.frequency, 4.0)
    model = ComplexModel(damper, 4.0, *sm.first_return(0.3), 1e3)
    assert model.observe(1e3, 0.0, 4.0)[0] == pytest.approx(sm.amplitude, rel=1e-3)


@pytest.mark.parametrize("drive", AMPLITUDE)
def test_pca_is_close_to_the_best(drive: str) -> None:
    scene = two_modes(drive)
    chosen = make_selector("pca", scene).select(Excitation(AMPLITUDE[drive]))
    assert [stage.name for stage in chosen.stages][:3] == ["SM", "SM + PM1", "CM1"]
    assert chosen.beam_amplitude < 1.05 * best_height(DamperResponse(scene, 1e-5), AMPLITUDE[drive]).amplitude


def test_learned_states_that_it_knows_one_mode() -> None:
    notes = [make_selector("learned", scene).select(Excitation(0.01)).note for scene in (two_modes(), standard_bench())]
    assert [bool(re.match(r"learned\b.*\bone\b", note)) for note in notes] == [True, False]
    assert notes[1] == ""


def test_a_force_is_refused_in_newtons(tmp_path: Path) -> None:
    scene = two_modes("force")
    with pytest.raises(SelectionError, match=r"^amplitude: given 0\.001 N; .* N\b"):
        make_selector("learned", scene).select(Excitation(0.001))
    made = build_map(scene, [3.0, 4.0], [scene.grain.mass_fraction], tmp_path / "force.npz")
    assert np.isnan(made.reductions).all()  # of one mode on its support, which is not this structure
    lookup = make_selector("lookup", scene, tmp_path / "force.npz")
    assert lookup.select(Excitation(4.0)).efficiency > 0.7
    with pytest.raises(SelectionError, match=r"\b5 N .*\b3 to 4 N"):
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


def test_what_lies_within_the_error_is_named_and_what_does_not_is_not() -> None:
    """The drive's own fluctuation, the same at every height, is no error of the difference."""
    rng = np.random.default_rng(1)
    common = 1.0 + 0.5 * rng.standard_normal(400)

    def rated(at: dict[float, float]) -> list[Rated]:
        return [Rated(height, rms**2 * (common + 0.02 * rng.standard_normal(400))) for height, rms in at.items()]

    seen = rated({0.05: 1.2, 0.06: 1.0003, 0.07: 1.0, 0.08: 1.0002, 0.09: 1.1, 0.10: 1.0001})
    as_good, _, worse = _as_good(seen, min(seen, key=lambda one: one.rms)).partition("; ")
    assert re.findall(r"0\.\d+", as_good) == ["0.0600", "0.0800", "0.1000", "0.1000"]
    assert re.findall(r"(0\.\d+) m by (\d+) ± ", worse) == [("0.0500", "20"), ("0.0900", "10")]
    alone = rated({0.05: 1.2, 0.06: 1.0, 0.07: 1.1})
    as_good, _, worse = _as_good(alone, alone[1]).partition("; ")
    assert re.findall(r"0\.\d+", as_good) == []
    assert worse.startswith("worse: 0.0500 m by 20 ± ")


def test_the_height_of_least_rms_is_that_of_a_scan() -> None:
    force = {"random": {"psd": [[2.0, 1.5], [12.0, 1.5]], "unit": "m^2/Hz"}}
    scene = noisy(drive="force", further_modes=[SECOND], excitation=force)
    chosen, bare, _ = least_rms(scene)
    own = Realisation(scene)
    scanned = [own.rated(float(height)).rms for height in np.linspace(0.02, 2.0 * chosen.height, 20)]
    assert chosen.beam_amplitude <= 1.01 * min(scanned)
    assert chosen.efficiency > 0.2
    assert chosen.beam_amplitude < bare
    assert [stage.name.split()[0] for stage in chosen.stages] == ["RMS", "as", "again"]
    assert re.match(r"seed 4,.* 0\.\d+ ± ", chosen.stages[2].note)


def test_heights_keep_to_the_range_and_where_the_grain_is_not_lifted_the_damper_stays_closed() -> None:
    ceiling = {"closed": 0.05, "range": [0.05, 0.08], "speed": 0.3, "controller": "direct"}
    assert 0.05 <= least_rms(noisy(8.0, ceiling=ceiling))[0].height <= 0.08
    quiet = {"tones": [{"amplitude": 1e-4, "frequency": 5.3}, {"amplitude": 1e-4, "frequency": 5.9}]}
    chosen, _, _ = least_rms(noisy(8.0, excitation=quiet))
    assert (chosen.height, chosen.efficiency) == (0.017, 0.0)
    assert re.search(r"0\.\d{4} m, .*-?\d+\.\d % .* closed$", chosen.no_use)


def test_the_command_selects_by_rms_and_refuses_the_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tones = {"tones": [{"amplitude": 0.004, "frequency": 5.3}, {"amplitude": 0.003, "frequency": 5.9}]}
    scene = scene_from_mapping(noisy(excitation=tones).to_mapping())
    file = tmp_path / "tones.yaml"
    file.write_text(scene.to_yaml())
    found = answered(capsys, "select", file, "--method", "direct")
    assert found["measure"].split() == ["root", "mean", "square"]
    assert found["amplitude"] == pytest.approx(simulate(scene.with_(height=found["height"]), check=False).rms, rel=1e-9)
    assert len(found["stages"]) == 2  # tones are the same again
    for given in (["--method", "pca"], ["--method", "direct", "--margin", "2"]):
        assert re.match(rf"error: excitation: .*tones.* {given[1]}", refusal(capsys, "select", file, *given))
