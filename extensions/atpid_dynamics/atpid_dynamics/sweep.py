# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The steady motions of a scene over heights, amplitudes and grain masses at once."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from atpid_dynamics.over_heights import Way, over_heights
from atpid_sim.results import Drawn, in_unit
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import Workers
from atpid_sim.system import Array

_GRID = "mass_fractions amplitudes heights"
_LABELS = in_unit("m", "heights", "heights") | in_unit("amplitude_unit", "amplitudes", "amplitudes")
_LABELS |= in_unit("1", "mass_fractions", "mass_fractions") | in_unit("m", "beam_amplitudes", _GRID)
_LABELS |= in_unit("1", "efficiencies reductions errors multipliers periods ways", _GRID)


@dataclass(frozen=True, repr=False)
class Sweep(Drawn):
    """What a scene comes to; grids are (mass fractions, amplitudes, heights)."""

    heights: Array  # (n,) to which the ceiling goes last [m]
    amplitudes: Array  # (a,) of the support [m], of a force [N]
    mass_fractions: Array  # (m,) grain over total mass [-]
    beam_amplitudes: Array  # (m, a, n) half peak-to-peak [m]; NaN: the run did not reach its end
    efficiencies: Array  # (m, a, n) against the damper closed [-]
    reductions: Array  # (m, a, n) against the structure without the damper [-]
    errors: Array  # (m, a, n) relative, of the amplitude of a steady motion; NaN without one
    multipliers: Array  # (m, a, n) largest modulus; NaN without a steady motion
    periods: NDArray[np.int64]  # (m, a, n) of the drive after which the motion repeats itself; 0 where it does not
    ways: NDArray[np.str_]  # (m, a, n) how each was found: the names of `Way` in lower case
    fidelity: str
    amplitude_unit: str = "m"

    labels = _LABELS
    drawn = ("beam_amplitudes",)


def cases(scene: Scene, mass_fractions: ArrayLike | None, amplitudes: ArrayLike | None) -> list[Scene]:
    """Return the scene with each mass fraction [-] and, of each, each amplitude [m or N]; None: those of the scene."""
    given = {"mass_fraction": mass_fractions, "amplitude": amplitudes}
    made = [scene]
    for name, values in given.items():
        if values is not None:
            made = [one.with_(**{name: value}) for one in made for value in np.ravel(values)]
    return made


def sweep(
    scene: Scene,
    heights: ArrayLike,
    amplitudes: ArrayLike | None = None,
    mass_fractions: ArrayLike | None = None,
    fidelity: str = "auto",
    rtol: float | None = None,
    workers: int | None = None,
) -> Sweep:
    """Return what a scene comes to at heights (n,), rising [m]; see `cases` and, for the rest, `over_heights`."""
    scenes = cases(scene, mass_fractions, amplitudes)
    found = over_heights(scenes, np.ravel(heights), fidelity, rtol, Workers(workers))
    last = [one.excitation.amplitude_points[-1][1] for one in scenes]
    shape = (
        1 if mass_fractions is None else np.size(mass_fractions),
        1 if amplitudes is None else np.size(amplitudes),
        -1,
    )

    def grid(name: str) -> Any:
        return np.reshape([getattr(one, name) for one in found], shape)

    def less_than(*, grain: bool) -> Array:
        linear = [one.linear_amplitude(a, grain=grain) for one, a in zip(scenes, last, strict=True)]
        return np.asarray(1.0 - grid("amplitudes") / np.reshape(linear, (*shape[:2], 1)))

    return Sweep(
        heights=found[0].heights,
        amplitudes=np.array(last[: shape[1]]),
        mass_fractions=np.array([one.grain.mass_fraction for one in scenes[:: shape[1]]]),
        beam_amplitudes=grid("amplitudes"),
        efficiencies=less_than(grain=True),
        reductions=less_than(grain=False),
        errors=grid("errors"),
        multipliers=grid("multipliers"),
        periods=grid("periods"),
        ways=np.array([way.name.lower() for way in Way])[grid("ways")],
        fidelity=found[0].fidelity,
        amplitude_unit=scene.driven_by.unit,
    )
