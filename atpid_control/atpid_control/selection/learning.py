# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Trains the learned selector: systems drawn over its whole range, each simulated, and its errors on those left out."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from atpid_control.selection.height_model import LEAST_RATIO, SHARE, HeightModel
from atpid_sim.maps import Best, DamperResponse, Timing, best_height
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.system import Array

#: Range of each input: lowest and highest value. Below an acceleration of 8 the best heights of neighbouring systems
#: lie in different wells, and no smooth function gives them.
LOWEST = np.array([8.0, 0.04, 0.005, 0.05])
HIGHEST = np.array([200.0, 0.32, 0.05, 0.5])
#: Tolerance of the runs, and by how much a well must be better than a lower one: as in a height map.
_RTOL, _HYSTERESIS = 1e-5, 0.15
#: One beam stands for all: only dimensionless numbers matter. Frequency [Hz], grain radius [m].
_FREQUENCY, _RADIUS = 5.0, 0.005
#: Every which system is left out of the training for its errors.
_LEFT_OUT = 5
#: The bands left out, by the name of the errors: input, lowest and highest value.
_BANDS = {"amplitudes": (0, 30.0, 50.0), "masses": (1, 0.10, 0.14), "beams": (2, 0.015, 0.022)}

#: Number of steps done.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Drawn:
    """A dimensionless system with dimensions."""

    scene: Scene
    amplitude: float  # of the support [m]


def draw(count: int) -> Array:
    """Return inputs (k, 4): a Sobol sequence of 2^n >= `count` points, less those whose grain is too light."""
    sequence = qmc.Sobol(4, seed=1).random_base2(max(math.ceil(math.log2(count)), 5))
    low, high = (np.append(np.log(ends[:3]), ends[3]) for ends in (LOWEST, HIGHEST))
    points = low + (high - low) * sequence
    inputs = np.column_stack([np.exp(points[:, :3]), points[:, 3]])
    return np.asarray(inputs[inputs[:, 1] >= LEAST_RATIO * inputs[:, 2]])


def system_of(inputs: Array) -> Drawn:
    """Return a system with these inputs (4,): impacts are instantaneous, so that its size does not matter."""
    acceleration, fraction, damping_ratio, restitution = map(float, inputs)
    omega = 2.0 * math.pi * _FREQUENCY
    mass, stiffness = 1.0 - fraction, omega**2
    damping = 2.0 * damping_ratio * math.sqrt(stiffness * mass)
    scene = standard_bench(
        beam={"mass": mass, "stiffness": stiffness, "damping": damping},
        grain={"mass_fraction": fraction, "radius": _RADIUS},
        contact={"law": "impact", "restitution": restitution},
    )
    per_metre = DamperResponse(scene, _RTOL).ballistic_clearance(1.0) / math.pi  # beam without grain over support [-]
    return Drawn(scene, acceleration * scene.gravity / (omega**2 * per_metre))


def train(inputs: Array, progress: Progress, search: Callable[..., Best] = best_height) -> HeightModel:
    """Simulate every system of `inputs` (n, 4) on all cores and return the model. Raises NumericalFailure.

    search: finds the best heights, with the arguments of `best_height`.
    """
    found: dict[int, tuple[float, float]] = {}
    for row, values in on_all_cores(lambda row: _simulated(inputs[row], search), range(len(inputs))):
        found[row] = values
        progress(len(found))
    clearances, remaining = np.array([found[row] for row in range(len(inputs))]).T
    return HeightModel(inputs, clearances, remaining, np.stack([LOWEST, HIGHEST]))


def _simulated(inputs: Array, search: Callable[..., Best]) -> tuple[float, float]:
    drawn = system_of(inputs)
    damper = DamperResponse(drawn.scene, _RTOL)
    best = search(damper, drawn.amplitude, _HYSTERESIS)
    clearance = (best.height - damper.diameter) / damper.ballistic_clearance(drawn.amplitude)
    return clearance, remaining_at(damper, drawn.amplitude, SHARE * clearance)


def remaining_at(damper: DamperResponse, amplitude: float, share: float) -> float:
    """Return the beam's amplitude over the closed damper's [-] at a share of the ballistic clearance.

    amplitude: of the support [m]. The worse of the closed damper opened at once and in 1 s.
    """
    height = damper.diameter + share * damper.ballistic_clearance(amplitude)
    timing = Timing(damper.settling(), 16.0)
    worst = max(damper.opened(amplitude, height, timing, travel).amplitude for travel in (0.0, 1.0))
    return worst / damper.closed_amplitude(amplitude)


def groups(model: HeightModel) -> dict[str, NDArray[np.bool_]]:
    """Return {name: systems (n,) that are left out together}: every fifth, and bands of one input each."""
    left_out = {"every fifth system": np.arange(len(model.inputs)) % _LEFT_OUT == 0}
    for name, (column, low, high) in _BANDS.items():
        inside = (model.inputs[:, column] > low) & (model.inputs[:, column] < high)
        left_out[f"{name}: {('acceleration', 'mass fraction', 'damping ratio')[column]} {low:g} to {high:g}"] = inside
    return left_out


def with_errors(model: HeightModel, progress: Progress) -> HeightModel:
    """Return the model with its errors on each group of systems left out of the training. Raises NumericalFailure."""
    done = 0
    errors: list[dict[str, Any]] = []
    for name, left_out in groups(model).items():
        errors.append({"left_out": name} | _errors(model, left_out, partial(_later, progress, done)))
        done += int(left_out.sum())
    return replace(model, errors=tuple(errors))


def _later(progress: Progress, before: int, count: int) -> None:
    progress(before + count)


def _errors(model: HeightModel, left_out: NDArray[np.bool_], progress: Progress) -> dict[str, Any]:
    """Return the errors of a model trained without some systems, on these: of the clearance, and what it costs.

    clearance: relative error of the best clearance, median and 95th percentile; above: share of the systems whose
    selected height lies above the best; lost: efficiency given up against the best height; amplitude: relative error of
    the beam's predicted amplitude; both median and 95th percentile.
    """
    inputs, best = model.inputs[left_out], model.clearances[left_out]
    predicted, expected = model.without(left_out).predict(inputs).T
    found: list[tuple[float, float]] = []

    def simulated(row: int) -> tuple[float, float]:
        drawn = system_of(inputs[row])
        damper = DamperResponse(drawn.scene, _RTOL)
        chosen, ideal = (remaining_at(damper, drawn.amplitude, s) for s in (SHARE * predicted[row], best[row]))
        return chosen - ideal, abs(expected[row] / chosen - 1.0)

    for _, values in on_all_cores(simulated, range(len(inputs))):
        found.append(values)
        progress(len(found))
    off, (lost, amplitude) = np.abs(predicted / best - 1.0), np.array(found).T
    return {
        "systems": len(inputs),
        "clearance": [float(value) for value in np.quantile(off, [0.5, 0.95])],
        "above": float(np.mean(SHARE * predicted > best)),
        "lost": [float(value) for value in np.quantile(lost, [0.5, 0.95])],
        "amplitude": [float(value) for value in np.quantile(amplitude, [0.5, 0.95])],
    }
