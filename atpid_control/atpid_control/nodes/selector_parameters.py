# SPDX-License-Identifier: Apache-2.0
"""The selector's parameters; `config/selector.yaml` has the same values, docs/parameters.md the table."""

from __future__ import annotations

from dataclasses import replace

from atpid_common.nodes.parameters import Row
from atpid_control.selection.registry import METHODS, plug_ins

TABLE = (
    Row("scene", "", "scene file: the system, the ceiling's range and the frequency the heights are for"),
    Row("map", "", "height map for the look-up; empty: the one the scene names"),
    Row("method", "", "method of selection; empty: the scene's controller", choices=("", *METHODS)),
    Row("lockstep", False, "true: commands are queued, heights computed inline; false: only the newest counts"),
    Row("dead_band", 0.01, "relative change of amplitude that moves nothing", "-", 0.0, 0.9, live=True),
    Row("sigmas", 4.0, "a change must also exceed this many standard deviations", "-", 0.0, 100.0, live=True),
    Row("steady_count", 4, "consecutive agreeing steady estimates that are acted on", "", 1, 1000, live=True),
    Row("rising_count", 4, "consecutive rising estimates that are a ramp to follow", "", 2, 1000, live=True),
    Row("falling_count", 2, "consecutive lower estimates before the ceiling goes down", "", 1, 1000, live=True),
    Row(
        "frequency_tolerance", 0.03, "relative distance from resonance at which heights still hold", "-", 1e-6, 1.0,
        live=True,
    ),
    Row("step_back", 0.06, "share of the clearance given up when the beam rumbles", "-", 1e-3, 0.9, live=True),
    Row(
        "settle_count", 24, "estimates after the ceiling has come to rest that do not count as rumble", "", 0, 10_000,
        live=True,
    ),
    Row(
        "rumble_count", 6, "consecutive estimates that rumble after that, before the ceiling steps back", "", 1, 10_000,
        live=True,
    ),
    Row(
        "step_back_excess", 0.15, "amplitude of the beam above the predicted that is more than inaccuracy", "-", 0.0,
        10.0, live=True,
    ),
    Row(
        "step_back_memory", 0.05, "change of the excitation's amplitude over which a step back applies", "-", 0.0,
        10.0, live=True,
    ),
    Row("drift_tolerance", 0.15, "relative error the model may have without a drift alarm", "-", 1e-3, 10.0, live=True),
    Row(
        "drift_noise", 0.02, "standard deviation of the beam's amplitude from period to period", "-", 1e-4, 1.0,
        live=True,
    ),
    Row(
        "drift_periods", 10_000.0, "settled periods between false alarms of a model at the edge of its tolerance", "-",
        1.0, 1e12, live=True,
    ),
    Row(
        "margin", 3.0, "standard deviations of the amplitude the height must be safe for; 0: bare optimum", "-", 0.0,
        100.0, live=True,
    ),
    Row("stiffness_uncertainty", 0.02, "relative error of the model's stiffness, in direct's margin", "-", 0.0, 0.5),
    Row(
        "stale_timeout", 0.4, "silence of excitation or ceiling/state after which an event is published", "s", 0.1,
        60.0, live=True,
    ),
)  # fmt: skip


def table() -> tuple[Row, ...]:
    """Return the table with the methods that other distributions have installed. Raises SelectionError."""
    further = tuple(plug_ins())
    return tuple(replace(row, choices=(*row.choices, *further)) if row.name == "method" else row for row in TABLE)
