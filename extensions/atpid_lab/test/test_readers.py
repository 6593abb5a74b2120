# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every reader of a recording sees the same samples, rate, instants and gaps, of any bag."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from bag_files import EXACT, RATE, exported, without_repetition
from recorded import LASER
from test_run import BAGS

from atpid_control.analysis.analyse import analyse
from atpid_control.analysis.signals import Signals, signals_of
from atpid_control.cli import main
from atpid_control.runs.playback import support_series
from atpid_control.runs.run import BEAM, SUPPORT, open_run
from atpid_control.views.report.page import analysis_of
from atpid_control.views.report.view import view_of
from atpid_lab import comparison as compare
from atpid_lab.beam import command as beam_command
from atpid_lab.beam.fit import BeamCalibrationError
from atpid_lab.validation import read_measured


@pytest.mark.parametrize("name", list(BAGS))
def test_every_reader_sees_the_same(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = BAGS[name](tmp_path / "bag")
    run = open_run(bag)
    support, beam = run.signals(SUPPORT, BEAM)
    assert (beam.rate, beam.origin) == (RATE, "laser")  # as the messages state it, not by their stamps

    def agrees(signals: Signals) -> None:
        np.testing.assert_array_equal(signals.response, beam.values)
        np.testing.assert_array_equal(signals.excitation, support.values)
        assert (signals.rate, signals.start, signals.start_ns) == (beam.rate, beam.time0, beam.start_ns)
        np.testing.assert_array_equal(signals.time, beam.time)

    signals, missing = signals_of(run)
    agrees(signals)
    assert set(run.missing) <= set(missing)

    without_repetition(monkeypatch)
    monkeypatch.setattr("atpid_control.views.report.stages.closed_by_simulation", lambda _scene, times: np.sin(times))
    view = view_of(run)
    np.testing.assert_array_equal(run.measured.beam, beam.values)
    np.testing.assert_array_equal(run.measured.time, beam.time)
    on_the_page = analysis_of(view.run)
    assert on_the_page is not None
    assert on_the_page.to_json() == analyse(signals).to_json()

    compared = compare.compare_bags(bag, bag)
    agrees(compared.runs[0].signals)
    assert compared.to_json()["origin"] == ["laser", "laser"]
    np.testing.assert_array_equal(compared.runs[1].view.run.motion.beam, beam.values)

    fitted: list[Signals] = []

    def fit(given: Signals) -> None:
        fitted.append(given)
        raise BeamCalibrationError("taken")

    monkeypatch.setattr(beam_command, "fit_beam", fit)
    assert main(["calibrate", "beam", str(bag)]) == 2
    agrees(fitted[0])

    measured = read_measured(run)
    first = round((measured.begin - beam.time0) * RATE)
    np.testing.assert_array_equal(measured.beam, beam.values[first : first + len(measured.beam)])
    assert (measured.rate, measured.origin) == (beam.rate, beam.origin)

    path = exported(bag, "csv", tmp_path / "run.csv", "--topic", LASER)
    written = [pd.read_csv(file, comment="#", **EXACT) for file in (path, *tmp_path.glob("run.sensors_laser_?.csv"))]
    table = max(written, key=len)
    np.testing.assert_array_equal(table[f"{BEAM} [m]"], beam.values)
    np.testing.assert_array_equal(table["stamp [ns]"].iloc[0], beam.start_ns)
    np.testing.assert_allclose(table["time [s]"], beam.time, rtol=0.0, atol=1e-9)

    node = max((node for node in run.tree().leaves if BEAM in node), key=lambda node: node.sizes["time"])
    np.testing.assert_array_equal(node[BEAM], beam.values)

    if np.isfinite(support.values).all() and not support.others:
        times, values = support_series(run)
        np.testing.assert_array_equal(values, support.values)
        np.testing.assert_array_equal(times, support.time)
