# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The atlas: what its quick grid shows, the thesis's own labels, resuming, and what is refused."""

import csv
import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from atpid_common.files import FileError
from atpid_sim.figure_numbers import numbers_in
from atpid_sim.maps import DamperResponse, MapError
from atpid_sim.periodic import Conditions, ReturnMap, periodic_motion
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.journal import JournalError
from studies.atlas import build
from studies.atlas.atlas import Atlas
from studies.atlas.column import FAILED, TYPES, Cell, Column, column_at, column_of, sweep
from studies.atlas.picture import THESIS
from studies.atlas.plan import FREQUENCY, MASS, Place, Plan, plan_of
from studies.atlas.stability import FINE, Stability, settled
from studies.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The quick atlas of the standard bench."""
    out = tmp_path_factory.mktemp("atlas")
    assert main(["atlas", "--out", str(out), "--quick"]) == 0
    return out


@pytest.mark.slow
def test_the_command_writes_data_tables_and_pictures(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == [
        "atlas.csv", "atlas.json", "atlas.npz", "atlas.png", "atlas_stability.png",
    ]  # fmt: skip
    atlas = Atlas.load(folder / "atlas.npz")
    summary = json.loads((folder / "atlas.json").read_text())
    rows = list(csv.DictReader((folder / "atlas.csv").read_text(encoding="utf-8").splitlines()))
    assert summary["columns"] == len(rows) == len(atlas.plan.places) == 12
    assert summary["simulations"] == atlas.simulations > 1000
    assert summary["cells_failed"] == 0
    assert sum(summary["share_of_cells"].values()) == pytest.approx(1.0)
    for name in ("atlas.png", "atlas_stability.png"):
        assert any(numbers_in(folder / name).values())


@pytest.mark.slow
def test_types_and_amplitudes_are_possible_ones(folder: Path) -> None:
    atlas = Atlas.load(folder / "atlas.npz")
    for block in atlas.blocks.values():
        types = block["types"]
        assert ((types >= 0) & (types < len(TYPES))).all()
        assert (np.diff(block["heights"], axis=-1) > 0.0).all()
        assert (np.diff(block["heights"][..., 0]) >= 0.0).all()  # higher for larger amplitudes
        # where the grain sticks to both walls its motion is regular, in both directions
        assert block["regular"][types == TYPES.index("sticking")].all()
    mass = atlas.blocks[MASS]  # a grain that moves regularly between floor and ceiling lowers a resonance
    useful = mass["regular"] & (mass["types"] <= TYPES.index("optimal"))
    assert (mass["amplitudes"] < 1.02 * mass["closed"][..., None, None])[useful].all()


@pytest.mark.slow
def test_best_heights_are_stable_and_below_their_cliffs(folder: Path) -> None:
    rows = [row for row in Atlas.load(folder / "atlas.npz").rows() if row["reproducible"]]
    assert len(rows) >= 10
    for row in rows:
        assert row["ending"] == "FOUND", row
        assert row["largest"] < 1.0, row
        assert row["largest_error"] < 1e-3, row
        if math.isfinite(row["cliff"]):
            assert row["best_height"] <= row["recovered"] <= row["cliff"], row
            assert row["loss"] in ("FOLD", "DOUBLING", "BEATING", "GRAZING")
    assert sum(math.isfinite(row["cliff"]) for row in rows) >= 4


@pytest.mark.slow
def test_simulated_disturbances_at_best_heights_decay_by_the_multipliers(folder: Path) -> None:
    rows = [row for row in Atlas.load(folder / "atlas.npz").rows() if row["amplitude"] == 0.01 and row["periods"] == 1]
    assert len(rows) >= 3
    for row in rows:
        scene = standard_bench(grain={"mass_fraction": row["mass_fraction"], "radius": 0.0085})
        scene = scene.with_(frequency=row["frequency_ratio"] * scene.frequency_hz)
        damper = DamperResponse(scene)
        conditions = Conditions(row["amplitude"], damper.frequency, row["best_height"])
        integration = Integration(scene, complete_fidelity(scene), FINE)
        motion = periodic_motion(integration, conditions, settled(damper, conditions)).motion
        assert motion is not None
        assert motion.largest_multiplier == pytest.approx(row["largest"], abs=1e-3)
        returns = ReturnMap(integration, conditions, motion.phase)
        disturbed, distances = motion.section * (1.0 + 1e-5), []
        for _ in range(25):
            disturbed = returns(disturbed)
            distances.append(float(np.linalg.norm(disturbed - motion.section)))
        assert (distances[24] / distances[12]) ** (1.0 / 12.0) == pytest.approx(row["largest"], abs=0.05)


#: Periods in which the thesis's ceiling opens, from 6.5 to 9 s.
OPENING = 14


@pytest.mark.parametrize(("mass_fraction", "amplitude", "height", "printed"), THESIS)
def test_types_are_those_the_thesis_prints(mass_fraction: float, amplitude: float, height: float, printed: str) -> None:
    scene = standard_bench(grain={"mass_fraction": mass_fraction, "radius": 0.0085})
    damper = DamperResponse(scene, 1e-5)
    (cell,) = sweep(damper, amplitude, damper.closed_state(amplitude), damper.diameter, [height], OPENING)
    # of the lightest grain the thesis prints that it sticks to floor or ceiling: mixed by the rule (docs/thesis.md)
    assert TYPES[cell.type] == ("mixed" if mass_fraction == 0.05 else printed)


def test_the_irregular_motion_of_a_heavy_grain_is_a_transient() -> None:
    damper = DamperResponse(standard_bench(grain={"mass_fraction": 0.2, "radius": 0.0085}), 1e-5)
    cells = sweep(damper, 0.01, damper.closed_state(0.01), damper.diameter, [0.2] * 6, OPENING)
    assert TYPES[cells[0].type] == "irregular"  # as in Fig. 3.14
    assert {TYPES[cell.type] for cell in cells[3:]} == {"no_ceiling"}


def test_a_sweep_past_the_cliff_and_back_is_irregular_beyond_it_only() -> None:
    damper = DamperResponse(standard_bench(), 1e-5)
    heights = [0.15, 0.2, 0.23, 0.26]
    state = damper.closed_state(0.01)
    up = sweep(damper, 0.01, state, damper.diameter, heights)
    down = sweep(damper, 0.01, state, heights[-1], heights[::-1])[::-1]
    for cells in (up, down):
        assert [cell.regular for cell in cells] == [True, True, False, False]
        assert [TYPES[cell.type] == "irregular" for cell in cells] == [False, False, True, True]
    assert down[1].amplitude == pytest.approx(up[1].amplitude, rel=1e-3)


def test_hysteresis_is_a_difference_of_amplitudes_where_one_motion_is_regular() -> None:
    regular, other, irregular = Cell(2, 1.0, True), Cell(1, 1.02, True), Cell(3, 1.5, False)
    failed = Cell(FAILED, math.nan, False)
    up = [regular, regular, regular, irregular, failed]
    down = [regular, other, irregular, irregular, regular]
    column = replace(small_column(), up=up, down=down)
    assert column.hysteresis == [False, True, True, False, False]


def small_column() -> Column:
    return column_of(standard_bench(), 0.01, [0.1, 0.2])


def test_a_column_is_the_same_after_the_journal() -> None:
    column = small_column()
    again = Column.from_mapping(json.loads(json.dumps(asdict(column))))
    assert again == column
    assert column.best.height == pytest.approx(0.2007, abs=2e-3)
    assert column.stability.cliff == pytest.approx(0.20528, abs=2e-4)
    assert column.simulations > 100


def test_runs_that_fail_are_cells_of_their_own_and_cost_no_other() -> None:
    damper = DamperResponse(standard_bench(), 1e-5)
    assert Stability("NO_SECTION").returns == 0
    column = column_of(standard_bench(), 0.6, [0.018, 12.0])
    assert [cell.type == FAILED for cell in column.up] == [False, True]
    assert math.isnan(column.best.height)
    assert "deeper into a wall" in column.best.failure
    assert damper.diameter == 0.017


TINY = Plan((0.1,), (0.005, 0.01), (0.01,), (0.98, 1.0), (0.3, 0.6))


def test_an_interrupted_atlas_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, scene = tmp_path / "atlas.npz", standard_bench()

    def stop(done: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"interrupted: 2 of 3 done; the same command goes on from them, kept "):
        build.build_atlas(scene, TINY, out, stop, Workers(1))
    assert not out.exists()
    computed: list[Place] = []

    def counted(scene: Scene, place: Place, shares: tuple[float, ...]) -> Column:
        computed.append(place)
        return column_at(scene, place, shares)

    monkeypatch.setattr(build, "column_at", counted)
    atlas = build.build_atlas(scene, TINY, out)
    assert len(computed) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["atlas.npz"]
    loaded = Atlas.load(out)
    assert loaded.plan == TINY
    for block in (MASS, FREQUENCY):
        for name, array in atlas.blocks[block].items():
            assert np.array_equal(array, loaded.blocks[block][name], equal_nan=array.dtype.kind == "f"), name
    with (tmp_path / "atlas.npz.journal").open("w") as journal:
        journal.write(json.dumps({"atlas": 1, "system": {}}) + "\n")
    with pytest.raises(JournalError, match="begun for another system or tolerance"):
        build.build_atlas(scene, TINY, out)


def test_another_system_with_instantaneous_impacts_has_an_atlas_too(tmp_path: Path) -> None:
    scene = standard_bench(
        beam={"mass": 4.0, "frequency": 12.0, "damping_ratio": 0.02}, contact={"law": "impact", "restitution": 0.3}
    )
    rows = build.build_atlas(scene, replace(TINY, shares=(0.2, 0.5)), tmp_path / "atlas.npz").rows()
    assert len(rows) == 3
    assert all(row["best_amplitude"] < 0.6 * row["closed"] for row in rows)
    assert [row["reproducible"] for row in rows] == [True, True, False]  # off resonance it lies beyond a fold
    assert [row["distance"] > 0.0 for row in rows] == [True, True, False]
    assert [row["largest"] < 1.0 for row in rows] == [True, True, False]


def test_the_plan_is_round_about_the_standard_task() -> None:
    plan = plan_of(0.00125, 0.08)
    assert 0.01 in plan.amplitudes
    assert 0.01 in plan.slices
    assert 1.0 in plan.frequency_ratios
    assert plan.slice_fraction in plan.mass_fractions
    assert len(plan.places) == len(set(plan.places)) > 400


@pytest.mark.parametrize("given", ["0.01", "0.08:0.01", "0:1", "a:b", "nan:1", "1:2:3"])
def test_the_command_refuses_amplitudes_it_cannot_use(
    given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["atlas", "--out", str(tmp_path), "--amplitudes", given]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f"error: --amplitudes: given {given}; allowed: A0:A1 with 0 < A0 < A1")
    assert printed.count("\n") == 1


def test_a_file_that_is_no_atlas_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.npz").write_text("no")
    with pytest.raises(FileError, match=r"x\.npz: "):
        Atlas.load(tmp_path / "x.npz")
    for content in ({"a": np.zeros(2)}, {"plan": np.array("{}")}, {"plan": np.array("[]")}):
        np.savez(tmp_path / "y.npz", **content)
        with pytest.raises(MapError, match=r"y\.npz: is no atlas; make one with `python -m studies atlas`"):
            Atlas.load(tmp_path / "y.npz")
