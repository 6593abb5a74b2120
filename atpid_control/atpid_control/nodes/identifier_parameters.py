# SPDX-License-Identifier: Apache-2.0
"""The identifier's parameters, and what is made of them."""

from __future__ import annotations

import math
from typing import cast

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import ParameterUninitializedException
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_control.identification import BeamInverse, IdentificationError, Settings
from atpid_control.identification.from_beam import ModelInverse
from atpid_control.watch import RumbleSettings
from atpid_sim.scene import load_scene

_DOUBLE, _STRING = Parameter.Type.DOUBLE, Parameter.Type.STRING
_ALL: tuple[tuple[str, Parameter.Type, str], ...] = (
    ("support_channel", _STRING, "name of the channel with the support's displacement"),
    ("beam_channel", _STRING, "name of the channel with the beam's displacement"),
    ("origin", _STRING, "support: read the excitation from the support; beam: infer it through the model of `scene`"),
    ("window_periods", _DOUBLE, "length of the sliding window in periods, at least 1"),
    ("lowest_frequency", _DOUBLE, "tones are looked for above this [Hz]"),
    ("highest_frequency", _DOUBLE, "tones are looked for below this [Hz]"),
    ("mains_frequency", _DOUBLE, "hum that joins the fit where it is seen [Hz]; 0: none"),
    ("least_amplitude", _DOUBLE, "a smaller tone is no excitation [m]"),
    ("lower_limit", _DOUBLE, "readings at or below it are saturated [m]"),
    ("upper_limit", _DOUBLE, "readings at or above it are saturated [m]"),
    ("change", _DOUBLE, "relative change of a steady amplitude that counts as one [-]"),
    ("change_likelihood", _DOUBLE, "log-likelihood from which a tone is believed to change [-]"),
    ("poor_residual", _DOUBLE, "residual over amplitude from which an estimate is poor [-]"),
    ("poor_harmonics", _DOUBLE, "harmonics over amplitude from which an estimate is poor [-]"),
    ("poor_lost", _DOUBLE, "share of lost samples from which an estimate is poor [-]"),
    ("rumble_onset", _DOUBLE, "scatter of the beam's amplitude from which it rumbles [-]"),
    ("rumble_calm", _DOUBLE, "scatter below which a period is calm again [-]"),
    ("rumble_calm_periods", Parameter.Type.INTEGER, "calm periods in a row that end the rumble"),
    ("rumble_least_amplitude", _DOUBLE, "a smaller response of the beam is not judged [m]"),
    ("analysis_rate", _DOUBLE, "streams of twice this rate and more are averaged down to it [Hz]"),
)
_SETTINGS = tuple(name for name in Settings.__dataclass_fields__ if name != "saturation")


def text_of(node: Node, name: str) -> str:
    """Return a parameter that is a text; raise IdentificationError where nothing was given."""
    return str(_value(node, name))


def declare(node: Node) -> None:
    """Declare all parameters; they have no defaults, the parameter file says them. Only `scene` may stay empty."""
    for name, kind, text in _ALL:
        node.declare_parameter(name, kind, ParameterDescriptor(description=text, read_only=True))
    text = "scene file with the beam and damper, for origin: beam"
    node.declare_parameter("scene", "", ParameterDescriptor(description=text, read_only=True))


def settings_of(node: Node) -> Settings:
    """Return the identification's settings; raise IdentificationError where they contradict themselves."""
    lower, upper = _number(node, "lower_limit"), _number(node, "upper_limit")
    saturation = None if math.isinf(lower) and math.isinf(upper) else (lower, upper)
    return Settings(saturation=saturation, **{name: _number(node, name) for name in _SETTINGS})


def rumble_of(node: Node) -> RumbleSettings:
    """Return the rumble watch's settings; raise WatchError where they contradict themselves."""
    return RumbleSettings(
        onset=_number(node, "rumble_onset"),
        calm=_number(node, "rumble_calm"),
        calm_periods=int(_number(node, "rumble_calm_periods")),
        least_amplitude=_number(node, "rumble_least_amplitude"),
    )


def inverse_of(node: Node) -> BeamInverse | None:
    """Return the way from beam to support, None where that is measured; raise IdentificationError, SceneError."""
    origin = text_of(node, "origin")
    if origin == "support":
        return None
    if origin != "beam":
        raise IdentificationError(f"origin: given {origin!r}; allowed: support, beam")
    scene = text_of(node, "scene")
    if not scene:
        raise IdentificationError("scene: given none; allowed with origin beam: the scene file of the beam and damper")
    return ModelInverse.of_scene(load_scene(scene))


def _number(node: Node, name: str) -> float:
    return cast(float, _value(node, name))


def _value(node: Node, name: str) -> object:
    try:
        return cast(object, node.get_parameter(name).value)
    except ParameterUninitializedException:
        raise IdentificationError(
            f"{name}: given nothing; start the node with --params-file .../atpid_control/config/identifier.yaml"
        ) from None
