# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A regression of best heights over dimensionless systems: the data it was trained on, from which it is made again.

The model is a smoothing thin-plate spline (scipy's RBFInterpolator) through simulated systems. Its file holds these
systems and no coefficients: solving for them takes some 20 ms, and nothing but numbers is read.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from atpid_common.errors import InputError
from atpid_common.files import FileError, read_arrays
from atpid_common.output import writing
from atpid_sim.kernel_inputs import contact_of, restitution_of
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import Scene
from atpid_sim.system import Array, reduced_mass

#: Version of the file and of what it calls the best height.
FORMAT = 1
#: Inputs of the model. acceleration: largest of the beam without grain, over gravity [-]; damping_ratio: of the beam
#: alone [-].
INPUTS = ("acceleration", "mass_fraction", "damping_ratio", "restitution")
#: Least mass fraction over damping ratio: below, the beam's own damping does more than any grain.
LEAST_RATIO = 2.0
#: The height selected, as a share of the best clearance: below it by about the error that 5 % of systems exceed.
SHARE = 0.96
#: Smoothing of the spline, chosen by cross-validation from 0.01 to 10 (docs/decisions/0026-thesis-side-by-side.md).
_SMOOTHING = 1.0

#: Most systems of a model: solving it takes their number squared in memory, cubed in time. Largest file [bytes].
MOST_SYSTEMS, _LARGEST = 4096, 2_000_000

_GRIDS = ("inputs", "clearances", "remaining", "drawn_from")
_MAKE = "train one with `atpid learn --out DIR`"


class ModelError(InputError):
    """A model that cannot be made or read; one line: what was given, what is allowed, what to do."""


@dataclass(frozen=True)
class HeightModel:
    """Best clearances over dimensionless systems, and what is left of the beam's amplitude."""

    inputs: Array  # (n, 4) acceleration, mass fraction, damping ratio, restitution [-]
    clearances: Array  # (n,) best clearance over the ballistic one [-]
    remaining: Array  # (n,) amplitude at SHARE of that clearance over the closed damper's, worst approach [-]
    drawn_from: Array  # (2, 4) lowest and highest value of each input among which the systems were drawn [-]
    errors: tuple[dict[str, Any], ...] = ()  # on systems left out of the training (`selection.learning`)
    source: str = "the model"  # its name in messages

    def predict(self, inputs: Array) -> Array:
        """Return best clearance over ballistic clearance, and remaining amplitude (k, 2) [-], for inputs (k, 4)."""
        return np.asarray(np.exp(self._spline((_axes(inputs) - self._middle) / self._spread)))

    def range_of(self, name: str) -> tuple[float, float]:
        """Return lowest and highest value of an input the model holds for [-]."""
        lowest, highest = self.drawn_from[:, INPUTS.index(name)]
        return float(lowest), float(highest)

    def without(self, left_out: Any) -> HeightModel:
        """Return the model trained on the systems that `left_out` (n,) of bool does not mark."""
        kept = ~np.asarray(left_out)
        return HeightModel(self.inputs[kept], self.clearances[kept], self.remaining[kept], self.drawn_from)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the file at once or not at all. Raises OutputError."""
        target = Path(path)
        part = target.with_name(target.name + ".part")
        about = {"format": FORMAT, "inputs": INPUTS, "share": SHARE, "errors": self.errors}
        grids = {name: getattr(self, name) for name in _GRIDS}
        with writing(target):
            with part.open("wb") as file:
                np.savez_compressed(file, about=np.array(json.dumps(about, sort_keys=True)), **grids)
            os.replace(part, target)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> HeightModel:
        """Read a model; raise ModelError for a file that is none."""
        try:
            stored = read_arrays(Path(path), _LARGEST)
            about = json.loads(str(stored["about"]))
            inputs, clearances, remaining, drawn_from = (_real(stored[name]) for name in _GRIDS)
            version, errors = (about["format"], about["share"]), tuple(about["errors"])
        except FileError as error:
            raise ModelError(f"{error}; {_MAKE}") from None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
            raise ModelError(f"{path}: is not a learned model; {_MAKE}") from None
        if version != (FORMAT, SHARE):
            raise ModelError(f"{path}: a model of another version; {_MAKE}")
        model = HeightModel(inputs, clearances, remaining, drawn_from, errors, str(path))
        if not model._sound():
            raise ModelError(f"{path}: a damaged model; {_MAKE}")
        return model

    def _sound(self) -> bool:
        """Whether shapes and numbers can be right."""
        count, width = (self.inputs.shape or (0,))[0], len(INPUTS)
        wanted = [(count, width), (count,), (count,), (2, width)]
        grids = [getattr(self, name) for name in _GRIDS]
        fits = [grid.shape for grid in grids] == wanted and width < count <= MOST_SYSTEMS
        return fits and all(np.isfinite(grid).all() and (grid > 0.0).all() for grid in grids)

    @cached_property
    def _middle(self) -> Array:
        return np.asarray(_axes(self.inputs).mean(0))

    @cached_property
    def _spread(self) -> Array:
        return np.asarray(_axes(self.inputs).std(0))

    @cached_property
    def _spline(self) -> RBFInterpolator:
        points = (_axes(self.inputs) - self._middle) / self._spread
        values = np.log(np.column_stack([self.clearances, self.remaining]))
        return RBFInterpolator(points, values, smoothing=_SMOOTHING, kernel="thin_plate_spline")


def _real(stored: NDArray[np.generic]) -> Array:
    """Return numbers as float64; raise TypeError for anything else, complex ones too."""
    if stored.dtype.kind not in "fiu":
        raise TypeError(f"of type {stored.dtype}")
    return stored.astype(np.float64)


def inputs_of(scene: Scene, damper: DamperResponse, amplitude: float) -> Array:
    """Return the model's inputs (4,) [-] for a scene's system at a support amplitude [m]."""
    system = damper.system
    speed = 2.0 * damper.frequency * damper.ballistic_clearance(amplitude)  # largest of the beam without grain [m/s]
    acceleration = 2.0 * math.pi * damper.frequency * speed
    over_gravity = acceleration / system.gravity if system.gravity > 0.0 else math.inf
    damping = system.damping / (2.0 * math.sqrt(system.stiffness * system.beam_mass))
    restitution = restitution_of(contact_of(scene), speed, reduced_mass(system))
    return np.array([over_gravity, scene.grain.mass_fraction, damping, restitution])


def _axes(inputs: Array) -> Array:
    """Return the coordinates (k, 4) of the spline: all but the restitution in the logarithm."""
    return np.column_stack([np.log(inputs[:, :3]), inputs[:, 3]])
