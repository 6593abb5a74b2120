# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recording against its simulation: the bag that comes along, tables with known faults, bad input."""

import json
import math
from pathlib import Path
from typing import Any

import bag_files
import numpy as np
import pytest
from bag_files import RATE, ROOT, without_pictures
from recorded import Capture, refused

from atpid_control.cli import main
from atpid_lab.validation import (
    Agreement,
    Measured,
    aligned,
    compare,
    driven_scene,
    lag_of,
)
from atpid_sim.scene import Scene, load_scene, standard_bench
from atpid_sim.simulation.quantities import amplitudes_per_period, efficiency
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

BAG, README, STANDARD = str(bag_files.BAG), str(ROOT / "README.md"), str(ROOT / "scenes/standard.yaml")


def recorded(scene: Scene, lag: int = 0, offset: float = 0.0, noise: float = 0.0) -> tuple[Measured, Array]:
    """Return what sensors would have recorded of a scene, the beam `lag` samples late and off by `offset` [m]."""
    motion = trajectory(scene, RATE)
    beam = motion.beam + scene.static_deflection + np.random.default_rng(1).normal(0.0, noise, len(motion.beam))
    beam = np.concatenate([np.full(lag, beam[0]), beam[: len(beam) - lag]]) + offset
    ceiling = np.column_stack([motion.time, motion.ceiling])[::50]
    return Measured(RATE, motion.support, beam, ceiling), np.column_stack([motion.time, motion.support, beam])


def table(path: Path, data: Array, header: str = "time,support_displacement,beam_displacement") -> Path:
    np.savetxt(path, data, fmt="%.12g", delimiter=",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def opening() -> Scene:
    ceiling = {"closed": 0.017, "open": 0.2, "start": 1.0, "end": 2.0}
    return standard_bench(ceiling=ceiling, duration=5.0, steady_window=[4.0, 5.0], tolerance=1e-5)


def test_the_bag_that_comes_along_is_its_own_simulation(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["bag", "validate", BAG, "--out", str(out), "--json"]) == 0
    found = json.loads((out / "agreement.json").read_text())
    assert found["relative_rmse"] < 0.01
    assert found["displacement_error"] < 0.01
    assert abs(found["lag"]) <= 1.0 / RATE
    assert found["compared_periods"] > 40
    assert (out / "agreement.png").stat().st_size > 10_000
    assert load_scene(out / "scene.yaml").initial is not None


def test_a_fault_within_the_part_is_named(tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    without_pictures(monkeypatch)
    stuck = ["bag", "validate", str(ROOT / "bags/laser_stuck"), "--out"]
    assert main([*stuck, str(tmp_path)]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if "trusted: " in line)
    assert {"2.699", "identifier_node:", "support_displacement:", "frozen"} <= set(line.replace(";", "").split())
    assert len(json.loads((tmp_path / "agreement.json").read_text())["faults"]) == 1
    assert main([*stuck, str(tmp_path / "before"), "--to", "2.4"]) == 0
    assert "trusted: " not in capsys.readouterr().out


def compared(folder: Path, scene: Scene, *others: Scene, **how: float) -> list[Agreement]:
    """Return how a recording of a scene agrees with that scene, and with others."""
    measured, data = recorded(scene, **how)  # type: ignore[arg-type]
    series = table(folder / "support.csv", data[:, :2], "time,support_displacement")
    return [compare(driven_scene(one, measured, series, None), measured) for one in (scene, *others)]


def test_lag_and_offset_of_a_sensor_are_found_and_taken_off(opening: Scene, tmp_path: Path) -> None:
    (found,) = compared(tmp_path, opening, lag=7, offset=0.3, noise=20e-6)
    assert found.lag == pytest.approx(7.0 / RATE, abs=1.01 / RATE)
    assert found.rmse < 0.005
    assert found.reproducible


def test_a_wrong_model_shows(opening: Scene, tmp_path: Path) -> None:
    """One per cent of stiffness moves the resonance by half a per cent and the amplitude by more."""
    wrong = opening.with_(beam=opening.to_mapping()["beam"] | {"stiffness": 1.01 * opening.beam.stiffness})
    right, off = compared(tmp_path, opening, wrong)
    assert right.rmse < 0.005
    assert off.rmse > 3.0 * right.rmse
    assert off.displacement_error > 3.0 * right.displacement_error


DECAY = standard_bench(excitation={"free": {"deflection": 0.1}}, ceiling={"height": 0.017}, duration=6.0)


def test_a_part_of_a_free_decay_and_the_longest_without_a_gap(tmp_path: Path, capsys: Capture) -> None:
    """The initial state is measured: a closed damper that decays from it is that of the whole recording."""
    _, data = recorded(DECAY, noise=20e-6)
    (tmp_path / "decay.yaml").write_text(DECAY.to_yaml())

    def agreement(*options: str) -> dict[str, Any]:
        recording, out = table(tmp_path / "decay.csv", data), tmp_path / f"out{len(options)}"
        given = ["--scene", str(tmp_path / "decay.yaml"), "--height", "0.017", "--out", str(out)]
        assert main(["bag", "validate", str(recording), *given, *options]) == 0
        return dict(json.loads((out / "agreement.json").read_text()))

    assert agreement("--from", "0.7", "--to", "3.7")["relative_rmse"] < 0.01
    data[700:760, 2] = math.nan
    data[5000, 1] = math.nan
    found = agreement()
    assert "0.76 to 4.999 s, " in capsys.readouterr().out
    assert found["relative_rmse"] < 0.01
    assert (found["begin"], found["end"], found["without_gap"]) == (0.76, pytest.approx(4.999), True)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ([BAG, "--from", "3", "--to", "5"], ["ceiling", " 5 "]),
        ([BAG, "--from", "9"], [" 0 to 8 s"]),
        ([BAG, "--from", "1", "--to", "1.05"], ["samples", " 100"]),
        ([README], ["README.md"]),
        ([BAG, "--scene", README], ["README.md"]),
        ([BAG, "--height", "0.01"], ["ceiling.height: given 0.01"]),
        (["GAPS.csv", "--scene", STANDARD, "--from", "1"], ["beam_displacement", " 2 s"]),
        (["HEIGHT.csv", "--scene", STANDARD], ["--height"]),
        (["HEIGHT.csv"], ["--scene"]),
        (["SUPPORT.csv", "--scene", STANDARD], ["support_displacement"]),
    ],
)
def test_the_incomparable_is_one_line(arguments: list[str], parts: list[str], tmp_path: Path, capsys: Capture) -> None:
    time = np.arange(4000) / RATE
    data = np.column_stack([time, 0.01 * np.sin(34.0 * time), 0.1 * np.cos(34.0 * time)])
    table(tmp_path / "HEIGHT.csv", data)
    table(tmp_path / "SUPPORT.csv", data[:, [0, 2]], "time,beam_displacement")
    data[2000, 2] = math.nan
    table(tmp_path / "GAPS.csv", data)
    given = [str(tmp_path / word) if word.endswith(".csv") else word for word in arguments]
    refused(capsys, ["bag", "validate", *given, "--out", tmp_path / "out"], *parts)


def test_nothing_is_written_over(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "scene.yaml").write_text("mine")
    refused(capsys, ["bag", "validate", BAG, "--out", tmp_path], "scene.yaml: exists")
    assert (tmp_path / "scene.yaml").read_text() == "mine"


SAMPLED = 1000.0
TIMES = np.arange(4000) / SAMPLED


def test_efficiency_and_amplitudes_of_periods() -> None:
    assert efficiency(0.05, 0.2) == pytest.approx(0.75)
    swelling = (1.0 + TIMES) * np.sin(2.0 * np.pi * 5.0 * TIMES)
    found = amplitudes_per_period(swelling, SAMPLED / 5.0)
    assert len(found) == 20
    assert found == pytest.approx(1.1 + 0.2 * np.arange(20), rel=0.01)


def test_lag_and_offset_are_removed_and_the_error_is_that_of_the_amplitude() -> None:
    simulated = (1.0 + 0.1 * TIMES) * np.sin(2.0 * np.pi * 5.0 * TIMES)
    measured = 0.04 + 1.1 * np.roll(simulated, 13)
    assert lag_of(measured, simulated, 50) == 13
    one, other = aligned(measured, simulated, 13)
    assert np.mean(one) == pytest.approx(np.mean(other))
    experiment, simulation = (amplitudes_per_period(series, SAMPLED / 5.0) for series in (one, other))
    assert 1.0 - simulation / experiment == pytest.approx(1.0 - 1.0 / 1.1, rel=1e-6)
