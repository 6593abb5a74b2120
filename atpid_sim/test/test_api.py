# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`import atpid_sim as ap`: the same numbers as the modules below it, with names, units and pictures."""

from importlib.metadata import entry_points
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from sim_refusals import refused

import atpid_sim as ap
from atpid_common.errors import InputError
from atpid_sim import api, maps, periodic
from atpid_sim.results import IMPACT, named_impacts
from atpid_sim.simulation import simulate as module

mpl.use("Agg")


SCENE = ap.standard_bench(contact={"law": "impact", "restitution": 0.2}, duration=8.0)
LOW = SCENE.with_(height=0.1)


def test_every_name_is_there_and_no_other() -> None:
    assert {name for name in dir(ap) if not hasattr(ap, name)} == set()
    assert set(dir(ap)) == {*api.__all__, "__version__", *(added.name for added in entry_points(group="atpid_sim"))}
    with refused(AttributeError, "simulat"):
        _ = ap.simulat  # type: ignore[attr-defined]
    with refused(ap.SceneError, "scene", "'a.yaml'", "Scene"):
        ap.simulate("a.yaml")  # type: ignore[arg-type]


def test_a_name_of_a_package_that_is_not_installed_is_answered_with_the_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: [])
    for name, package in (("sweep", "atpid_dynamics"), ("kicked", "atpid_dynamics"), ("open_run", "atpid_control")):
        with refused(AttributeError, name, package, "not installed"):
            getattr(ap, name)


def test_a_run_is_the_run() -> None:
    result, below = ap.simulate(LOW), module.simulate(LOW)
    assert (result.amplitude, result.ledger, result.impacts) == (below.amplitude, below.ledger, below.impacts)
    table = result.to_xarray()
    assert table.amplitude.units == "m"
    assert table.resonance.units == "Hz"
    assert table.amplitude.item() == result.amplitude
    assert table.attrs["motion"] == result.motion


@pytest.mark.parametrize(("first", "last", "count"), [(0.0, 8.0, 7919), (6.5, 8.0, 333), (0.3, 7.7, 2)])
def test_instants_are_those_asked_for(first: float, last: float, count: int) -> None:
    instants = np.linspace(first, last, count)
    motion = ap.trajectory(LOW, t_eval=instants)
    assert np.array_equal(motion.time, instants)
    assert len(motion.beam) == count
    fine = module.trajectory(LOW, 1e5)
    assert np.abs(np.interp(instants, fine.time, fine.beam) - motion.beam).max() < 1e-6


@pytest.mark.parametrize("wrong", [[0.0, 1.0, 3.0], [1.0, 0.0], [0.0], [0.0, 9.0], [-1.0, 1.0], [0.0, np.nan], 3.0])
def test_other_instants_are_refused_in_one_line(wrong: object) -> None:
    with refused(InputError, "t_eval", "two", "0", "8 s"):
        ap.trajectory(LOW, t_eval=wrong)  # type: ignore[arg-type]


def test_impacts_have_named_columns() -> None:
    motion = ap.trajectory(LOW, t_eval=np.linspace(0.0, 8.0, 801))
    assert motion.impacts.dtype.names == tuple(IMPACT)[:3]
    assert set(motion.impacts["wall"]) == {1.0, -1.0}
    assert len(motion.impacts) == pytest.approx(ap.simulate(LOW).impacts, rel=0.05)  # of bounces before it sticks
    assert motion.to_xarray().impact_speed.units == "m/s"
    assert named_impacts(np.zeros((0, 4))).dtype.names == tuple(IMPACT)


def test_a_steady_state_is_found_or_the_reason_named() -> None:
    found, below = ap.steady_state(LOW).state, periodic.steady_state(LOW).state
    assert found is not None
    assert below is not None
    assert found.amplitude == below.amplitude
    assert "amplitude" in repr(found)
    assert ap.steady_state(ap.standard_bench(excitation={"free": {"deflection": 0.1}})).state is None


def test_a_map_is_its_best_heights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    made = ap.height_map(SCENE, [0.008, 0.01], [0.1], out=tmp_path / "map.npz")
    assert np.array_equal(ap.load_map(tmp_path / "map.npz").heights, made.heights)
    best = ap.best_height(SCENE)
    damper = maps.DamperResponse(SCENE, maps.map_tolerance(SCENE))
    assert best == maps.best_height(damper, 0.01)
    assert made.heights[0, 1] == pytest.approx(best.height, rel=0.2)  # a map stays in one well
    assert ap.best_height(SCENE, bounds=(0.03, 0.08)).height <= 0.08
    assert made.to_xarray().heights.dims == ("mass_fractions", "amplitudes")
    assert list(tmp_path.iterdir()) == [tmp_path / "map.npz"]
