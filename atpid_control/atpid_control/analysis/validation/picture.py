# SPDX-License-Identifier: Apache-2.0
"""The picture of a comparison: motions, their difference, amplitudes period by period, ceiling, the last periods."""

from pathlib import Path
from typing import Any

import numpy as np

from atpid_control.analysis.validation.compare import Agreement
from atpid_sim.figure_numbers import drawn

#: Periods shown close up, at the end.
_CLOSE_UP = 6


def draw(found: Agreement, path: Path) -> None:
    """Draw the comparison as PNG. Raises OutputError."""
    ends = (found.time[0], found.time[-1])
    with drawn(path, "--out", nrows=5, figsize=(10.0, 12.5), height_ratios=(2.2, 1.2, 1.8, 1.2, 2.0)) as (_, axes):
        _motions(axes[0], found, *ends)
        axes[0].set(title="Beam displacement from rest", xlabel="")
        axes[1].plot(found.time, 1e3 * (found.measured - found.simulated), "C3", linewidth=0.7)
        axes[1].set(xlim=ends, ylabel="mm", title="Measured less simulated")
        axes[2].plot(found.period_time, 1e3 * found.measured_amplitude, "0.45", marker=".", label="measured")
        axes[2].plot(found.period_time, 1e3 * found.simulated_amplitude, "C0", linewidth=1.2, label="simulated")
        title = f"Amplitude of each period; relative RMSE {100.0 * found.rmse:.2g} %"
        axes[2].set(xlim=ends, ylim=(0.0, None), ylabel="mm", title=title)
        axes[2].legend(fontsize=8, loc="lower right")
        axes[3].plot(found.time, 1e3 * found.ceiling, "C0", linewidth=1.4)
        axes[3].set(xlim=ends, ylim=(0.0, None), ylabel="mm", title="Ceiling height")
        period = float(np.diff(found.period_time)[0]) if len(found.period_time) > 1 else ends[1] - ends[0]
        _motions(axes[4], found, max(ends[0], ends[1] - _CLOSE_UP * period), ends[1])
        axes[4].set(title=f"The last {_CLOSE_UP} periods")


def _motions(ax: Any, found: Agreement, begin: float, end: float) -> None:
    shown = (found.time >= begin) & (found.time <= end)
    ax.plot(found.time[shown], 1e3 * found.measured[shown], "0.6", linewidth=2.0, label="measured")
    ax.plot(found.time[shown], 1e3 * found.simulated[shown], "C0", linewidth=0.8, label="simulated")
    ax.set(xlim=(begin, end), ylabel="mm", xlabel="time [s]")
    ax.legend(fontsize=8, loc="lower right")
