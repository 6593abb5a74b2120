# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The panels of a comparison: motions, their difference, amplitudes period by period, ceiling, the last periods."""

from functools import partial
from typing import Any

import numpy as np

from atpid_lab.validation.compare import Agreement
from atpid_sim.figure_style import LIGHT, Panels

#: Periods shown close up, at the end.
_CLOSE_UP = 6


def panels(found: Agreement) -> Panels:
    """Return the panels of a comparison."""
    return [[partial(drawer, found=found)] for drawer in (_whole, _difference, _amplitudes, _ceiling, _last)]


def _whole(ax: Any, found: Agreement) -> None:
    _motions(ax, found, found.time[0])
    ax.set(title="Beam displacement from rest")


def _difference(ax: Any, found: Agreement) -> None:
    ax.plot(found.time, 1e3 * (found.measured - found.simulated), LIGHT.accent, linewidth=0.7)
    _over_time(ax, found, "Measured less simulated")


def _amplitudes(ax: Any, found: Agreement) -> None:
    ax.plot(found.period_time, 1e3 * found.measured_amplitude, LIGHT.given_text, marker=".", label="measured")
    ax.plot(found.period_time, 1e3 * found.simulated_amplitude, LIGHT.own, linewidth=1.2, label="simulated")
    _over_time(ax, found, f"Amplitude of each period; relative RMSE {100.0 * found.rmse:.2g} %")
    ax.set_ylim(0.0, None)


def _ceiling(ax: Any, found: Agreement) -> None:
    ax.plot(found.time, 1e3 * found.ceiling, LIGHT.own, linewidth=1.4)
    _over_time(ax, found, "Ceiling height")
    ax.set_ylim(0.0, None)


def _last(ax: Any, found: Agreement) -> None:
    period = float(np.diff(found.period_time)[0]) if len(found.period_time) > 1 else np.inf
    _motions(ax, found, max(found.time[0], found.time[-1] - _CLOSE_UP * period))
    ax.set(title=f"The last {_CLOSE_UP} periods")


def _motions(ax: Any, found: Agreement, begin: float) -> None:
    shown = found.time >= begin
    ax.plot(found.time[shown], 1e3 * found.measured[shown], LIGHT.given_text, linewidth=2.4, label="measured")
    ax.plot(found.time[shown], 1e3 * found.simulated[shown], LIGHT.own, linewidth=0.8, label="simulated")
    ax.set(xlim=(begin, found.time[-1]), ylabel="mm", xlabel="time [s]")


def _over_time(ax: Any, found: Agreement, title: str) -> None:
    ax.set(xlim=(found.time[0], found.time[-1]), xlabel="time [s]", ylabel="mm", title=title)
