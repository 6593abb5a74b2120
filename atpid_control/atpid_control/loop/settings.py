# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the parameter files describe: the controller's and the identifier's parts, for the nodes and the pure loop."""

import math
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TypeVar

from atpid_common.parameters import Value, rows_of
from atpid_control import identification
from atpid_control.loop.controller import Controller, ControlSettings, ProfileController, SelectingController
from atpid_control.loop.drift import DriftSettings, SteadyTwin
from atpid_control.loop.hold import HoldSettings, StepBack
from atpid_control.selection import HeightSelector, Options, make_selector
from atpid_control.selection.protocol import reach_of
from atpid_sim.scene import Scene

S = TypeVar("S")


def selector_of(value: Value, method: str, scene: Scene, height_map: Path | None, *, lockstep: bool) -> HeightSelector:
    """Return the method called `method`, by selector.yaml. Raises SelectionError or MapError where that fails.

    lockstep: the simulation waits for the answer, so a margin has no deadline, and a run is the same on any machine.
    """
    deadline = math.inf if lockstep else float(value("selection_deadline"))
    options = Options(stiffness_uncertainty=float(value("stiffness_uncertainty")), deadline=deadline)
    return make_selector(method, scene, height_map, options)


def control_settings(value: Value, frequency: float, selector: HeightSelector | None = None) -> ControlSettings:
    """Return the controller's settings by selector.yaml, for heights of `selector` made for `frequency` [Hz].

    Raises HoldError or WatchError where they contradict themselves.
    """
    reach = None if selector is None else reach_of(selector)
    hold = settings_of(HoldSettings, value, frequency=frequency, reach=reach)
    step_back, drift = settings_of(StepBack, value), settings_of(DriftSettings, value, "drift_")
    return settings_of(ControlSettings, value, hold=hold, step_back=step_back, drift=drift)


def controller_of(
    value: Value, scene: Scene, selector: HeightSelector, executor: Executor | None, fallback: HeightSelector | None
) -> Controller:
    """Return the controller for a scene, by the parameters of selector.yaml.

    executor: where heights are computed; None: inline. fallback: looks heights up where the selector fails.
    Raises HoldError or WatchError where the parameters contradict themselves.
    """
    if not scene.ceiling.controlled:
        return ProfileController(scene.ceiling.heights)
    # only a tone has a steady state to compare the beam with
    twin = SteadyTwin(scene) if scene.excitation.is_tone else None
    settings = control_settings(value, scene.frequency_hz, selector)
    return SelectingController(settings, selector, scene.ceiling.range, twin, executor, fallback)


def identification_settings(value: Value) -> identification.Settings:
    """Return the identification's settings by identifier.yaml; raise IdentificationError where they do not fit."""
    limits = float(value("lower_limit")), float(value("upper_limit"))
    saturation = None if limits == (-math.inf, math.inf) else limits
    return settings_of(identification.Settings, value, saturation=saturation)


def settings_of(kind: type[S], value: Value, prefix: str = "", **given: Any) -> S:
    """Return the settings `kind`: `given`, and each parameter that it declares, whose name follows `prefix`."""
    return kind(**given, **{row.name: row.kind(value(prefix + row.name)) for row in rows_of(kind)})
