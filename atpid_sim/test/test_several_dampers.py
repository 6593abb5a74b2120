# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Several dampers on one structure: against the engine of one, closed forms, and the limits that a scene has."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atpid_sim.engine.power_series import ORDER, first_zero
from atpid_sim.maps.response import DamperResponse
from atpid_sim.periodic.basin import Starts, basin
from atpid_sim.periodic.over_heights import over_heights
from atpid_sim.periodic.steady import steady_state
from atpid_sim.plant.plant import Plant
from atpid_sim.scene import Scene, SceneError, standard_bench
from atpid_sim.simulation.fidelity import choose
from atpid_sim.simulation.integration import Integration, Observation, amplitude_without_damper
from atpid_sim.simulation.simulate import simulate, trajectory

IMPACT = {"law": "impact", "restitution": 0.6}
TSUJI = {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0}
FURTHER_MODE = {"mass": 2.4, "frequency": 31.0, "damping_ratio": 0.02, "drive_factor": -0.3}
#: A further damper that does (nearly) nothing: a light grain where the only mode has a node, held.
IDLE = {"mass_fraction": 1e-6, "height": 0.017, "shapes": [0.0]}


def several(*dampers: dict[str, Any], **changes: Any) -> Scene:
    """The standard bench with instantaneous impacts and further dampers."""
    given: dict[str, Any] = {"contact": IMPACT, "excitation": {"amplitude": 0.01, "frequency": 5.4}}
    return standard_bench(**({"further_dampers": list(dampers)} | given | changes))


def equal(count: int, mass_fraction: float, height: float) -> dict[str, Any]:
    """Keys of so many equal cells that share the mass of one grain of `mass_fraction`."""
    share = mass_fraction / (1.0 - mass_fraction) / count
    own = {"mass_fraction": share / (1.0 + share)}
    cells = [own | {"height": height, "count": count - 1}]
    return {"further_dampers": cells, "grain": own | {"radius": 0.0085}, "ceiling": {"height": height}}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"gravity": 0.0, "ceiling": {"height": 0.19}},
        {"ceiling": {"closed": 0.017, "open": 0.15, "start": 3.0, "end": 5.0}},
        {"excitation": {"free": {"deflection": 0.05}}},
        {"contact": TSUJI},
        {"initial": {"grain_height": 0.05, "grain_velocity": 0.3}},
    ],
)
def test_one_damper_is_what_the_engine_of_one_computes(changes: dict[str, Any]) -> None:
    one = trajectory(several(**changes, duration=6.0), 500.0, "impact")
    other = trajectory(several(IDLE, **changes, duration=6.0), 500.0, "impact")
    assert len(one.impacts) > 10
    # the bounces that lead to rest are cut off by the same rule, and resting grains by another one
    early = one.time < 2.0
    assert np.abs(one.beam - other.beam)[early].max() < 1e-7 * np.ptp(one.beam)
    assert np.abs(one.grain - other.grain)[early].max() < 1e-7 * np.ptp(one.grain)
    assert np.abs(one.beam - other.beam).max() < 1e-4 * np.ptp(one.beam)


def test_equal_cells_that_start_alike_move_as_one_grain() -> None:
    grain = {"mass_fraction": 0.1, "radius": 0.0085}
    one = trajectory(several(grain=grain, ceiling={"height": 0.2}, duration=5.0), 500.0, "impact")
    cells = trajectory(several(**equal(3, 0.1, 0.2), duration=5.0), 500.0, "impact")
    assert np.abs(one.beam - cells.beam).max() < 1e-6 * np.ptp(one.beam)
    assert cells.further_grains == pytest.approx(np.array([cells.grain, cells.grain]))
    assert sorted(set(cells.impacts["damper"])) == [1.0, 2.0, 3.0]
    assert len(cells.impacts) == 3 * len(one.impacts)


@pytest.mark.parametrize("drive", ["support", "force"])
def test_closed_dampers_at_several_points_in_closed_form(drive: str) -> None:
    shapes, size, omega = np.array([[1.0, 1.0], [0.4, -1.3], [0.8, 0.2]]), 0.02, 2.0 * math.pi * 5.0
    dampers = [{"mass_fraction": 0.2, "height": 0.017, "shapes": [float(s) for s in row]} for row in shapes[1:]]
    scene = several(
        *dampers, further_modes=[FURTHER_MODE], drive=drive, ceiling={"height": 0.017}, duration=120.0,
        excitation={"amplitude": size, "frequency": 5.0}, steady_window=[119.0, 120.0],
    )  # fmt: skip
    modes = scene.modes
    assert modes is not None
    grains = np.array([one.grain_mass for one in scene.dampers])
    matrix = np.diag(modes.free.stiffness + 1j * omega * modes.free.damping)
    matrix = matrix - omega**2 * (np.diag(modes.free.mass) + (shapes.T * grains) @ shapes)
    expected = size * abs(np.linalg.solve(matrix, modes.free.direct + 1j * omega * modes.free.rate).sum())
    found = Integration(scene, "impact").run(Observation(scene.steady_window))
    assert found.last.amplitude == pytest.approx(expected, rel=1e-9)  # what couples modes by damping included
    assert abs(found.ledger.residual) < 1e-12
    assert simulate(scene, check=False).motion == "closed"


def test_the_ledger_closes_and_impacts_are_counted_by_damper() -> None:
    scene = several(
        {"mass_fraction": 0.05, "height": 0.1, "shapes": [0.7, -1.2]},
        {"mass_fraction": 0.02, "height": 0.03, "radius": 0.004, "count": 2},
        further_modes=[FURTHER_MODE], ceiling={"closed": 0.017, "open": 0.2, "start": 1.0, "end": 3.0}, duration=8.0,
    )  # fmt: skip
    result = simulate(scene, check=False)
    assert len(result.impacts_per_damper) == 4
    assert min(result.impacts_per_damper) > 0
    assert sum(result.impacts_per_damper) == result.impacts
    assert abs(result.energy_residual) < 1e-9
    assert result.ledger.contact_loss > 0.1 * result.ledger.input
    assert result.ledger.ceiling_work != 0.0


def test_momentum_and_restitution_of_one_impact_where_the_shape_is_another() -> None:
    scene = several(
        {"mass_fraction": 0.3, "height": 0.5, "shapes": [0.5, -2.0]}, further_modes=[FURTHER_MODE], gravity=9.81,
        grain={"mass_fraction": 1e-6, "radius": 0.0085}, ceiling={"height": 0.017}, duration=0.5,
        excitation={"amplitude": 0.08, "frequency": 5.0},
    )  # fmt: skip
    motion = trajectory(scene, 1e5, "impact")
    time, side, speed, _damper = motion.impacts[motion.impacts["damper"] == 2.0][0]
    modes, damper = [scene.beam, *scene.further_modes], scene.dampers[1]
    compliance = sum(shape**2 / mode.mass for shape, mode in zip(damper.shapes, modes, strict=True))
    impulse = 1.6 * side * speed / (compliance + 1.0 / damper.grain_mass)
    before = int(time * 1e5)
    leap = motion.beam_velocity[before + 1] - motion.beam_velocity[before]
    expected = -impulse * sum(shape / mode.mass for shape, mode in zip(damper.shapes, modes, strict=True))
    assert leap == pytest.approx(expected, abs=1e-5 * np.abs(motion.beam_acceleration).max() + 1e-6)


def test_cells_that_start_apart_scatter_and_this_is_named() -> None:
    scene = several(**equal(5, 0.1, 0.35), gravity=0.0, duration=20.0)
    result = simulate(scene)
    assert not result.reproducible
    assert result.spread is not None


@settings(max_examples=200, deadline=None)
@given(
    coefficients=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=8), first=st.floats(0.0, 1.0),
    length=st.floats(1e-3, 1.0),
)  # fmt: skip
def test_no_zero_of_a_polynomial_is_passed(coefficients: list[float], first: float, length: float) -> None:
    series = np.zeros(ORDER + 1)
    series[0], series[1 : 1 + len(coefficients)] = first, coefficients
    reached, found = first_zero(series, length, 1e-14)
    inside = np.linspace(0.0, reached, 2000)
    assert np.polynomial.polynomial.polyval(inside, series)[1:].min(initial=1.0) > -1e-12
    if found:
        assert np.polynomial.polynomial.polyval(reached, series) <= 1e-12


def test_errors_name_the_key_and_what_is_allowed() -> None:
    with pytest.raises(SceneError, match=r"further_dampers\[0\].height: given 0.01; allowed: at least the grain"):
        several({"mass_fraction": 0.1, "height": 0.01})
    with pytest.raises(SceneError, match=r"further_dampers\[1\].shapes: .* allowed: 1 numbers, for beam and each"):
        several({"mass_fraction": 0.1, "height": 0.1}, {"mass_fraction": 0.1, "height": 0.1, "shapes": [1.0, 2.0]})
    with pytest.raises(SceneError, match="further_dampers: given 201 grains in all; allowed: at most 200"):
        several({"mass_fraction": 0.01, "height": 0.1, "count": 200})
    with pytest.raises(SceneError, match=r"grain.count: given 3; allowed: one grain in a cell; grains that touch each"):
        several(grain={"mass_fraction": 0.1, "radius": 0.0085, "count": 3})


def test_what_takes_one_damper_refuses_several() -> None:
    scene = several({"mass_fraction": 0.1, "height": 0.1})
    for refused in (
        lambda: steady_state(scene),
        lambda: basin(scene, Starts(0.1)),
        lambda: Plant(scene),
        lambda: DamperResponse(scene),
        lambda: over_heights([scene], np.array([0.1])),
    ):
        with pytest.raises(SceneError, match=r"further_dampers: given 1 beside the first; .* takes one damper; leave"):
            refused()
    for fidelity in ("soft", "finite", "simplified"):
        with pytest.raises(ValueError, match=rf"{fidelity}: given with further_dampers; allowed: auto, impact"):
            choose(scene, fidelity)
    with pytest.raises(ValueError, match="fidelity finite: given with further_dampers"):
        Integration(several({"mass_fraction": 0.1, "height": 0.1}, contact=TSUJI), "finite")


def test_a_held_grain_too_soft_for_its_weight_ends_the_run() -> None:
    soft = {"law": "linear", "stiffness": 20.0, "restitution": 0.5}
    scene = several({"mass_fraction": 0.5, "height": 0.017}, contact=soft)
    state = (integration := Integration(scene, "impact")).initial_state()
    assert integration.advance(state, integration.table).name == "OVERLAP_TOO_DEEP"


def test_the_reference_without_damper_is_that_of_one() -> None:
    scene = several({"mass_fraction": 0.1, "height": 0.1})
    alone = several()
    assert amplitude_without_damper(scene) == pytest.approx(amplitude_without_damper(alone), rel=1e-12)
