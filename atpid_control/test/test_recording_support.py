# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a bag to a series, and from that series to a run of the simulation."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import block

from atpid_control.cli import main
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run
from atpid_control.runs.support import support_series
from atpid_control.runs.writer import BagWriter
from atpid_sim.scene import load_scene, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation.integration import drive_table, undamped_amplitude

BLOCK = "atpid_interfaces/msg/SampleBlock"
SHORT = Path(__file__).parents[2] / "bags" / "thesis_4_3_short"


def bag_of(folder: Path, blocks: list[tuple[int, Any]], rates: tuple[float, ...] = (1000.0,), **fields: Any) -> Path:
    """A bag with blocks (index of the first scan, data (n, 2))."""
    writer = BagWriter(folder, new_run(run_id="series", commit="none"))
    writer.add_topic("/sensors/laser", BLOCK)
    for number, (index, data) in enumerate(blocks):
        message = block(index, data, rates[number % len(rates)], **fields)
        writer.write("/sensors/laser", message, 50_000_000 * number, 50_000_000 * number)
    writer.close()
    return folder


def scans(first: int, count: int = 50) -> Any:
    """Data (count, 2): the support is at 1 mm a scan."""
    return np.column_stack([1e-3 * np.arange(first, first + count), np.full(count, 9.0)])


def test_a_recorded_support_drives_a_simulation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "extract", str(SHORT), "--out", str(tmp_path), "--support"]) == 0
    assert "support.csv: 8000 samples over 7.999 s, from -0.025" in capsys.readouterr().out
    recorded = read_yaml((open_bag(SHORT).scene_text or ""), "bag")
    changed = recorded | {"duration": 7.9, "steady_window": [6.0, 7.9], "ceiling": {"height": 0.2}}
    measured = scene_from_mapping(changed | {"excitation": {"series": {"file": str(tmp_path / "support.csv")}}})
    tone = scene_from_mapping(changed)
    both = [undamped_amplitude(scene, drive_table(scene, scene.steady_window)) for scene in (measured, tone)]
    assert both[0] == pytest.approx(both[1], rel=1e-4)  # the laser's noise is 20 um


def test_the_command_simulate_takes_the_series(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "extract", str(SHORT), "--out", str(tmp_path), "--support", "6:8"]) == 0
    scene = load_scene(SHORT.with_suffix(".yaml")).to_mapping() | {"duration": 1.9, "steady_window": [0.0, 1.9]}
    scene |= {"ceiling": {"height": 0.2}, "excitation": {"series": {"file": "support.csv"}}}
    (tmp_path / "measured.yaml").write_text(scene_from_mapping(scene, folder=tmp_path).to_yaml())
    capsys.readouterr()
    assert main(["simulate", str(tmp_path / "measured.yaml"), "--json"]) == 0
    assert '"result": "the run reached its end"' in capsys.readouterr().out


def test_times_are_index_over_rate(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "bag", [(300, scans(0)), (350, np.zeros((0, 2))), (350, scans(50))])
    times, values = support_series(open_run(bag))
    assert np.array_equal(times, np.arange(100) / 1000.0)
    assert np.array_equal(values, 1e-3 * np.arange(100))
    times, values = support_series(open_run(bag, begin=0.02, end=0.06), 0.02, 0.06)
    assert np.array_equal(times, np.arange(20, 61) / 1000.0)
    assert np.array_equal(values, 1e-3 * np.arange(20, 61))


def test_what_is_missing_is_reported_and_can_be_left_out(tmp_path: Path) -> None:
    holed = scans(200)
    holed[7, 0] = np.nan
    laser = [(0, scans(0)), (50, scans(50)), (150, scans(150)), (200, holed), (0, scans(0))]
    bag = bag_of(tmp_path / "bag", laser)
    with pytest.raises(BagError, match=r"support_displacement is lost or invalid at 0\.1 s; take a part without it"):
        support_series(open_run(bag))
    with pytest.raises(BagError, match=r"support_displacement is lost or invalid at 0\.207 s; take a part"):
        support_series(open_run(bag, begin=0.15), 0.15)
    with pytest.raises(BagError, match="starts anew"):
        support_series(open_run(bag, begin=0.0, end=0.09), 0.0, 0.09)
    with pytest.raises(BagError, match=r"no sample from --from to --to; allowed: rising times from 0 to"):
        support_series(open_run(bag, begin=7.0, end=8.0), 7.0, 8.0)
    assert len(support_series(open_run(bag, begin=0.15, end=0.2), 0.15, 0.2)[0]) == 51


def test_a_rate_that_changes_is_another_recording(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "bag", [(0, scans(0)), (50, scans(50))], rates=(1000.0, 500.0))
    with pytest.raises(BagError, match="starts anew"):
        support_series(open_run(bag))


def test_a_bag_without_the_support_is_refused_with_what_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_of(tmp_path / "bag", [(0, scans(0))], channels=["beam_acceleration", "temperature"])
    assert main(["bag", "extract", str(bag), "--out", str(tmp_path), "--support"]) == 2
    said = capsys.readouterr().err
    assert "no samples of support_displacement; channels in it: beam_acceleration, temperature" in said
    assert said.count("\n") == 1


def test_nothing_is_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "support.csv").write_text("mine")
    assert main(["bag", "extract", str(SHORT), "--out", str(tmp_path), "--support", "1:2"]) == 2
    assert (tmp_path / "support.csv").read_text() == "mine"
    (tmp_path / "file").write_text("")
    assert main(["bag", "extract", str(SHORT), "--out", str(tmp_path / "file" / "in"), "--support", "1:2"]) == 2
    assert capsys.readouterr().err.count("\n") == 2


@pytest.mark.parametrize("given", ["2", "3:2", "a:b", "-1:2", "nan:1", "1:2:3"])
def test_an_interval_that_is_none_is_refused(given: str) -> None:
    assert main(["bag", "extract", "bag", f"--support={given}"]) == 2
    assert main(["bag", "verify", "bag", "--support"]) == 2
