# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of identifier, selector and supervisor.

`python -m studies parameters` makes docs/parameters.md and `config/*.yaml` from these tables.
"""

import math
from dataclasses import replace
from functools import partial

from atpid_common.nodes.parameters import Entry
from atpid_control.selection.registry import METHODS, plug_ins
from atpid_control.supervision.limits import QUANTITIES

#: A parameter that may change while the node runs.
_live = partial(Entry, live=True)

IDENTIFIER = (
    Entry("support_channel", "support_displacement", "channel with the support's displacement or the force"),
    Entry("beam_channel", "beam_displacement", "name of the channel with the beam's displacement"),
    Entry(
        "origin", "support", "support: the excitation is read from support_channel; beam: inferred from it and `scene`",
        choices=("support", "beam"),
    ),
    Entry("scene", "", "scene file with the beam and damper, for origin: beam"),
    Entry("lockstep", False, "true: time is that of the stamps, so that no silence is reported"),
    Entry("window_periods", 2.0, "sliding window in periods of the tone; 1 is enough for a steady one", "-", 1.0, 20.0),
    Entry("lowest_frequency", 1.0, "tones are looked for above this", "Hz", 0.01, 1e4),
    Entry("highest_frequency", 40.0, "tones are looked for below this", "Hz", 0.02, 1e4),
    Entry("mains_frequency", 50.0, "hum that joins the fit where it is present; 0: none", "Hz", 0.0, 1e4),
    _live("least_amplitude", 5e-5, "a smaller tone is no excitation [m, of a force N]", "", 0.0, 1e6),
    Entry("lower_limit", -math.inf, "readings at or below it are saturated [m, of a force N]"),
    Entry("upper_limit", math.inf, "readings at or above it are saturated [m, of a force N]"),
    _live("change", 0.01, "relative change of a steady amplitude that counts as one", "-", 1e-5, 0.9),
    _live(
        "change_likelihood", 20.0, "log-likelihood from which a tone counts as changing inside the window", "-", 0.1,
        1e6,
    ),
    _live(
        "second_tone", 0.1,
        "amplitude over the first's from which another tone makes an estimate poor, since heights are selected for "
        "one; 0: none does", "-", 0.0, 0.9,
    ),
    _live("slow_drift", 0.03, "relative rate of a frequency up to which its tone is steady", "1/s", 0.0, 0.9),
    _live("poor_residual", 0.3, "residual over amplitude from which an estimate is poor", "-", 1e-4, 100.0),
    _live("poor_harmonics", 0.2, "harmonics over amplitude from which an estimate is poor", "-", 1e-4, 100.0),
    _live("poor_lost", 0.5, "share of lost samples from which an estimate is poor", "-", 1e-4, 1.0),
    Entry("analysis_rate", 1000.0, "streams of twice this rate and more are averaged down to it", "Hz", 1.0, 1e6),
    _live("rumble_onset", 0.06, "scatter of the beam's amplitude from which its motion is irregular", "-", 1e-4, 0.99),
    _live("rumble_calm", 0.03, "scatter below which a period is regular, at most rumble_onset", "-", 1e-4, 0.99),
    _live("rumble_calm_periods", 3, "consecutive regular periods that end irregular motion", "", 1, 1000),
    _live("rumble_least_amplitude", 0.002, "a smaller response of the beam is not judged", "m", 0.0, 10.0),
    _live("stale_timeout", 0.4, "silence of sensors/laser that is an event, at least three blocks", "s", 0.1, 60.0),
    _live("dead_time", 0.2, "a channel without one valid reading for so long is dead", "s", 0.01, 60.0),
    _live("frozen_time", 0.2, "a channel that stops in mid-motion for so long is frozen", "s", 0.01, 60.0),
    _live("largest_velocity", 30.0, "faster steps of a displacement are impossible; 0: not judged", "m/s", 0.0, 1e6),
    _live("invalid_share", 0.2, "share of invalid readings of a second that is intermittent", "-", 0.001, 1.0),
    _live("recovery_time", 0.5, "a channel plausible for so long works again", "s", 0.0, 60.0),
    _live("clock_tolerance", 0.1, "how far stamps may move away from the indices; 0: not judged", "s", 0.0, 3600.0),
)  # fmt: skip

SELECTOR = (
    Entry("scene", "", "scene file: the system, the ceiling's range and the frequency the heights are for"),
    Entry("map", "", "height map for the look-up; empty: the one the scene names"),
    _live("method", "", "method of selection; empty: the scene's controller", choices=("", *METHODS)),
    _live("hold", False, "true: the ceiling stays where it is, whatever is selected"),
    _live(
        "manual_height", 0.0, "where the ceiling is sent, whatever is selected; 0: where the method has it", "m", 0.0,
        1e6,
    ),
    Entry("lockstep", False, "true: commands are queued, heights computed inline; false: only the newest counts"),
    _live(
        "dead_band", 0.01, "relative change of amplitude that moves nothing: below 0.01 the ceiling moves by less than "
        "it can be positioned", "-", 0.0, 0.9,
    ),
    _live("sigmas", 4.0, "a change must also exceed this many standard deviations", "-", 0.0, 100.0),
    _live("steady_count", 4, "consecutive agreeing steady estimates that are acted on", "", 1, 1000),
    _live("rising_count", 4, "consecutive rising estimates that are a ramp to follow", "", 2, 1000),
    _live("falling_count", 2, "consecutive lower estimates before the ceiling goes down", "", 1, 1000),
    _live(
        "frequency_tolerance", 0.03,
        "relative distance from the scene's frequency at which heights of a method for that one still hold; the "
        "standard bench's half-power points lie 0.022 beside it", "-", 1e-6, 1.0,
    ),
    _live(
        "frequency_band", 0.0025,
        "relative change of frequency that moves nothing, of a method that selects at any frequency: "
        "0.01 is up to 0.05 of the height", "-", 0.0, 0.9,
    ),
    _live("step_back", 0.06, "share of the clearance given up when the motion is irregular", "-", 1e-3, 0.9),
    _live(
        "settle_count", 24,
        "estimates after the ceiling has come to rest in which irregular motion does not count: the closed beam's "
        "decay time", "", 0, 10_000,
    ),
    _live(
        "rumble_count", 6, "consecutive irregular estimates after that, before the ceiling steps back", "", 1, 10_000,
    ),
    _live(
        "step_back_excess", 0.15, "amplitude of the beam above the predicted that is more than inaccuracy", "-", 0.0,
        10.0,
    ),
    _live(
        "step_back_memory", 0.05, "change of the excitation's amplitude over which a step back applies", "-", 0.0, 10.0,
    ),
    _live("drift_tolerance", 0.15, "relative error the model may have without a drift alarm", "-", 1e-3, 10.0),
    _live("drift_noise", 0.02, "standard deviation of the beam's amplitude from period to period", "-", 1e-4, 1.0),
    _live(
        "drift_periods", 10_000.0, "settled periods between false alarms of a model at the edge of its tolerance",
        "-", 1.0, 1e12,
    ),
    _live(
        "margin", 3.0, "standard deviations of the amplitude the height must be safe for; 0: bare optimum", "-", 0.0,
        100.0,
    ),
    _live(
        "fallback_count", 20, "estimates in a row without a height, before the look-up answers where a map is given",
        "", 1, 10_000,
    ),
    Entry("stiffness_uncertainty", 0.02, "relative error of the model's stiffness, in direct's margin", "-", 0.0, 0.5),
    Entry("selection_deadline", 0.15, "time for a selection by direct with a margin; not in lockstep", "s", 0.01, 60.0),
    _live(
        "stale_timeout", 0.4, "silence of excitation or ceiling/state that is an event, at least three blocks", "s",
        0.1, 60.0,
    ),
)  # fmt: skip

_NODES = ["identifier_node", "selector_node", "motor_node", "recorder_node"]
SUPERVISOR = (
    Entry("nodes", _NODES, "nodes that have to answer; the bench and the stand add the sources"),
    Entry(
        "needed", ["identifier_node", "selector_node", "recorder_node"],
        "those of them without whose answers the ceiling is held and the motor gets no heartbeat",
    ),
    Entry("scene", "", "scene file, whose ceiling's limits the loop check compares; empty: they are not"),
    Entry("check_time", 5.0, "time from the first sample until the loop check has to pass; 0: none", "s", 0.0, 3600.0),
    Entry("answer_time", 0.4, "silence after which a node is named", "s", 0.15, 10.0),
    Entry("give_up", 10.0, "silence of a needed node after which the run ends; 0: never", "s", 0.0, 3600.0),
    Entry(
        "restart_time", 0.0,
        "how long one whose process has ended may be away before that counts; 0: it is not started again", "s", 0.0,
        3600.0,
    ),
    *(
        Entry(f"{name}_{level}", math.inf, f"{level} level of its magnitude; .inf: none [{unit}]")
        for name, unit in QUANTITIES.items()
        for level in ("warning", "abort")
    ),
    Entry("contact_acceleration", 50.0, "a pulse of beam_acceleration above it is a contact", "m/s^2", 0.0, 1e6),
    Entry("contact_dead_time", 0.005, "a pulse this soon after the last one is the same contact", "s", 0.0, 1.0),
)  # fmt: skip


def selector_table() -> tuple[Entry, ...]:
    """Return the selector's table with the methods that other distributions have installed. Raises SelectionError."""
    further = tuple(plug_ins())
    return tuple(replace(row, choices=(*row.choices, *further)) if row.name == "method" else row for row in SELECTOR)
