# SPDX-License-Identifier: Apache-2.0
"""The identifier's parameters; `config/identifier.yaml` has the same values, docs/parameters.md the table."""

from __future__ import annotations

import math

from atpid_common.nodes.parameters import Row, Value
from atpid_control.identification import BeamInverse, IdentificationError
from atpid_control.identification.from_beam import ModelInverse
from atpid_sim.scene import load_scene

TABLE = (
    Row("support_channel", "support_displacement", "name of the channel with the support's displacement"),
    Row("beam_channel", "beam_displacement", "name of the channel with the beam's displacement"),
    Row(
        "origin", "support", "support: the excitation is read from the support; beam: inferred from it and `scene`",
        choices=("support", "beam"),
    ),
    Row("scene", "", "scene file with the beam and damper, for origin: beam"),
    Row("lockstep", False, "true: time is that of the stamps, so that no silence is reported"),
    Row("window_periods", 2.0, "length of the sliding window in periods of the tone", "-", 1.0, 20.0),
    Row("lowest_frequency", 1.0, "tones are looked for above this", "Hz", 0.01, 1e4),
    Row("highest_frequency", 40.0, "tones are looked for below this", "Hz", 0.02, 1e4),
    Row("mains_frequency", 50.0, "hum that joins the fit where it is present; 0: none", "Hz", 0.0, 1e4),
    Row("least_amplitude", 5e-5, "a smaller tone is no excitation", "m", 0.0, 1.0, live=True),
    Row("lower_limit", -math.inf, "readings at or below it are saturated [m]"),
    Row("upper_limit", math.inf, "readings at or above it are saturated [m]"),
    Row("change", 0.01, "relative change of a steady amplitude that counts as one", "-", 1e-5, 0.9, live=True),
    Row(
        "change_likelihood", 20.0, "log-likelihood from which a tone counts as changing inside the window", "-", 0.1,
        1e6, live=True,
    ),
    Row("poor_residual", 0.3, "residual over amplitude from which an estimate is poor", "-", 1e-4, 100.0, live=True),
    Row("poor_harmonics", 0.2, "harmonics over amplitude from which an estimate is poor", "-", 1e-4, 100.0, live=True),
    Row("poor_lost", 0.5, "share of lost samples from which an estimate is poor", "-", 1e-4, 1.0, live=True),
    Row("analysis_rate", 1000.0, "streams of twice this rate and more are averaged down to it", "Hz", 1.0, 1e6),
    Row("rumble_onset", 0.06, "scatter of the beam's amplitude from which it rumbles", "-", 1e-4, 0.99, live=True),
    Row("rumble_calm", 0.03, "scatter below which a period is calm, at most rumble_onset", "-", 1e-4, 0.99, live=True),
    Row("rumble_calm_periods", 3, "consecutive calm periods that end the rumble", "", 1, 1000, live=True),
    Row("rumble_least_amplitude", 0.002, "a smaller response of the beam is not judged", "m", 0.0, 10.0, live=True),
    Row("stale_timeout", 0.4, "silence of sensors/laser after which an event is published", "s", 0.1, 60.0, live=True),
)  # fmt: skip


def inverse_of(value: Value) -> BeamInverse | None:
    """Return the model from beam to support, None where the support is measured.

    Raises IdentificationError, SceneError.
    """
    if value("origin") == "support":
        return None
    if not value("scene"):
        raise IdentificationError("scene: given none; allowed with origin beam: the scene file of the beam and damper")
    return ModelInverse.of_scene(load_scene(value("scene")))
