# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of an analysis: over which frequencies its panels go, and which orders have a bar."""

from pathlib import Path

import pytest
from made_signals import RATE, noise, tone
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from atpid_control.analysis import Signals
from atpid_control.analysis.analyse import analyse
from atpid_control.analysis.picture import _coherence, _excited, _orders, _phases, _sizes, panels
from atpid_sim.figure_numbers import numbers_in, save_panels
from atpid_sim.system import Array


def signals(response: Array) -> Signals:
    return Signals(RATE, tone(29.0, 1e-3, 8.0) + noise(8000, 1, 1e-8), response)


def test_an_order_below_the_noise_has_no_bar() -> None:
    found = analyse(signals(tone(29.0, 1e-2, 8.0) + tone(87.0, 1e-4, 8.0) + noise(8000, 2, 1e-5)))
    assert found.orders is not None
    axes = Figure().subplots()
    _orders(axes, found)
    bars = [bar for bar in axes.patches if isinstance(bar, Rectangle)]
    assert [round(bar.get_x() + 0.5 * bar.get_width()) for bar in bars] == [1, 3]
    tops = [bar.get_y() + bar.get_height() for bar in bars]
    assert tops == pytest.approx([10.0, 0.1], rel=0.02)  # mm
    assert axes.get_ylabel() == "mm"
    (limit,) = axes.get_lines()
    assert limit.get_ydata() == pytest.approx(3e3 * found.orders.amplitude_std)


def test_the_response_is_shown_where_lines_are_excited() -> None:
    found = analyse(signals(tone(29.0, 1e-2, 8.0) + noise(8000, 2, 1e-5)))
    assert found.response is not None
    low, high = _excited(found.response)
    lines = found.response.frequency[found.response.excited]
    assert 20.0 < low < lines.min() <= 29.0 <= lines.max() < high < 38.0
    for panel in (_sizes, _phases, _coherence):
        axes = Figure().subplots()
        panel(axes, found)
        assert axes.get_xlim() == (low, high)
        assert len(axes.get_ylabel()) > 1


def test_an_analysis_without_a_tone_is_drawn_too(tmp_path: Path) -> None:
    save_panels(panels(analyse(Signals(RATE, noise(8000, 1), noise(8000, 2)))), tmp_path / "a.png")
    assert len(numbers_in(tmp_path / "a.png")) == 6
