# SPDX-License-Identifier: Apache-2.0
"""The controller and the identifier that parameter files describe; the nodes and the bench of seeds share it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from atpid_control import hold, identification
from atpid_control.controller import Controller, ControlSettings, ProfileController, SelectingController
from atpid_control.selection import HeightSelector, make_selector
from atpid_control.step_back import StepBack
from atpid_control.watch import DriftSettings, SteadyTwin
from atpid_sim.scene import ControlledCeiling, HarmonicExcitation, Scene

#: The value of a parameter; raises a ValueError of ours where the parameter file has none.
Value = Callable[[str], Any]


def selector_of(value: Value, method: str, scene: Scene, height_map: Path | None) -> HeightSelector:
    """Return the method called `method`, by selector.yaml. Raises SelectionError or MapError where it cannot be."""
    if method != "direct":
        return make_selector(method, scene, height_map)
    # here, since only this method has to load the simulation
    from atpid_control.selection.direct import DirectSelector
    from atpid_control.selection.margin import Uncertainty

    return DirectSelector(scene, Uncertainty(stiffness=float(value("stiffness_uncertainty"))))


def settings_of(value: Value, frequency: float) -> ControlSettings:
    """Return the controller's settings by selector.yaml, for heights made for `frequency` [Hz].

    Raises HoldError or WatchError where they contradict themselves.
    """
    return ControlSettings(
        hold=hold.Settings(
            dead_band=float(value("dead_band")),
            sigmas=float(value("sigmas")),
            steady_count=int(value("steady_count")),
            rising_count=int(value("rising_count")),
            falling_count=int(value("falling_count")),
            frequency=frequency,
            frequency_tolerance=float(value("frequency_tolerance")),
        ),
        step_back=StepBack(
            share=float(value("step_back")),
            settle=int(value("settle_count")),
            count=int(value("rumble_count")),
            excess=float(value("step_back_excess")),
            memory=float(value("step_back_memory")),
        ),
        drift=DriftSettings(
            tolerance=float(value("drift_tolerance")),
            noise=float(value("drift_noise")),
            periods=float(value("drift_periods")),
        ),
        margin=float(value("margin")),
    )


def controller_of(value: Value, scene: Scene, selector: HeightSelector, executor: Executor | None = None) -> Controller:
    """Return the controller for a scene, by the parameters of selector.yaml.

    executor: where heights are computed; None: inline. Raises HoldError or WatchError where the parameters contradict
    themselves.
    """
    if not isinstance(scene.ceiling, ControlledCeiling):
        return ProfileController(scene.ceiling.heights)
    # only a tone has a steady state to compare the beam with
    twin = SteadyTwin(scene) if isinstance(scene.excitation, HarmonicExcitation) else None
    settings = settings_of(value, scene.frequency_hz)
    return SelectingController(settings, selector, scene.ceiling.range, twin, executor)


def identifier_of(parameters: Mapping[str, Any]) -> identification.Identifier:
    """Return the identifier of identifier.yaml's parameters, reading the support. Raises IdentificationError."""
    names = [name for name in identification.Settings.__dataclass_fields__ if name != "saturation"]
    limits = float(parameters["lower_limit"]), float(parameters["upper_limit"])
    saturation = None if limits == (float("-inf"), float("inf")) else limits
    return identification.Identifier(
        identification.Settings(saturation=saturation, **{name: float(parameters[name]) for name in names})
    )
