# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of identifier and selector; those of the supervisor are in `supervision`, which loads sooner.

`python -m studies parameters` makes docs/parameters.md and `config/*.yaml` from these tables.
"""

import math
from dataclasses import replace
from functools import partial

from atpid_common.parameters import Entry, rows_of
from atpid_control.identification import Settings
from atpid_control.loop.controller import ControlSettings
from atpid_control.loop.drift import DriftSettings
from atpid_control.loop.hold import HoldSettings, StepBack
from atpid_control.loop.rumble import RumbleSettings
from atpid_control.loop.signal_watch import SignalSettings
from atpid_control.selection.registry import METHODS, plug_ins

_live = partial(Entry, live=True)

IDENTIFIER = (
    Entry("support_channel", "support_displacement", "channel with the support's displacement or the force"),
    Entry("beam_channel", "beam_displacement", "name of the channel with the beam's displacement"),
    Entry("origin", "support", "read from support_channel, or by `scene` from the beam", choices=("support", "beam")),
    Entry("scene", "", "scene file with the beam and damper, for origin: beam"),
    Entry("lockstep", False, "true: time is that of the stamps, so that no silence is reported"),
    *rows_of(Settings),
    Entry("lower_limit", -math.inf, "readings at or below it are saturated [m, of a force N]"),
    Entry("upper_limit", math.inf, "readings at or above it are saturated [m, of a force N]"),
    *rows_of(RumbleSettings, "rumble_"),
    _live("stale_timeout", 0.4, "silence of sensors/laser that is an event, at least three blocks", "s", 0.1, 60.0),
    *rows_of(SignalSettings),
    _live("clock_tolerance", 0.1, "how far stamps may move away from the indices; 0: not judged", "s", 0.0, 3600.0),
)

SELECTOR = (
    Entry("scene", "", "scene file: the system, the ceiling's range and the frequency the heights are for"),
    Entry("map", "", "height map for the look-up; empty: the one the scene names"),
    _live("method", "", "method of selection; empty: the scene's controller", choices=("", *METHODS)),
    _live("hold", False, "true: the ceiling stays where it is, whatever is selected"),
    _live("manual_height", 0.0, "where the ceiling is sent in any case; 0: where the method has it", "m", 0.0, 1e6),
    Entry("lockstep", False, "true: commands are queued, heights computed inline; false: only the newest counts"),
    *rows_of(HoldSettings),
    *rows_of(StepBack),
    *rows_of(DriftSettings, "drift_"),
    *rows_of(ControlSettings),
    Entry("stiffness_uncertainty", 0.02, "relative error of the model's stiffness, in direct's margin", "-", 0.0, 0.5),
    Entry("selection_deadline", 0.15, "time for a selection by direct with a margin; not in lockstep", "s", 0.01, 60.0),
    _live(
        "stale_timeout",
        0.4,
        "silence of excitation or ceiling/state that is an event, >= 3 blocks",
        "s",
        0.1,
        60.0,
    ),
)


def selector_table() -> tuple[Entry, ...]:
    """Return the selector's table with the methods that other distributions have installed. Raises SelectionError."""
    further = tuple(plug_ins())
    return tuple(replace(row, choices=(*row.choices, *further)) if row.name == "method" else row for row in SELECTOR)
