# SPDX-License-Identifier: Apache-2.0
"""What the figures of docs/selection.md show, computed: landscapes, the margin, and the error of the PCA."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_control.selection.direct import DirectSelector, with_stiffness
from atpid_control.selection.pca import PcaSelector
from atpid_sim.maps import DamperResponse, Timing, best_height
from atpid_sim.scene import standard_bench
from atpid_sim.simulation.batch import on_all_cores

Array = NDArray[np.float64]

_RTOL = 1e-5


@dataclass(frozen=True)
class Landscape:
    """The beam's amplitude over the ceiling's height at one support amplitude."""

    amplitude: float  # of the support [m]
    heights: Array  # (n,) [m]
    remaining: Array  # (n, 2) amplitude over that of the closed damper, opened slowly and at once [-]
    best: float  # the best height [m]
    first_guess: float  # of the PCA [m]


def landscape(amplitude: float, mass_fraction: float = 0.1, count: int = 120) -> Landscape:
    """Compute the landscape around the best height of the standard bench."""
    scene = standard_bench().with_(mass_fraction=mass_fraction)
    damper = DamperResponse(scene, _RTOL)
    best = best_height(damper, amplitude).height
    heights = np.linspace(0.3 * best, 1.6 * best, count)
    timing, closed = Timing(1.5 * damper.settling(), 16.0), damper.closed_amplitude(amplitude)

    def remaining(height: float) -> tuple[float, float]:
        slow, sudden = (damper.opened(amplitude, height, timing, travel).amplitude / closed for travel in (1.0, 0.0))
        return slow, sudden

    found = dict(on_all_cores(remaining, [float(h) for h in heights]))
    guess = PcaSelector(scene).select(amplitude).stages[1].height
    return Landscape(amplitude, heights, np.array([found[float(h)] for h in heights]), best, guess)


@dataclass(frozen=True)
class MarginCurve:
    """The amplitude at a height where the beam is stiffer or softer than assumed."""

    errors: Array  # (n,) relative error of the stiffness [-]
    bare: Array  # (n,) remaining amplitude at the bare optimum [-]
    safe: Array  # (n,) and with the margin [-]
    bare_height: float  # [m]
    safe_height: float  # [m]
    price: float  # efficiency given up where the stiffness is as assumed [-]


def margin_curve(amplitude: float, mass_fraction: float = 0.1, count: int = 21) -> MarginCurve:
    """Compute both heights on beams whose stiffness is up to 5 % off, driven at the frequency of the one thought."""
    scene = standard_bench().with_(mass_fraction=mass_fraction)
    selector = DirectSelector(scene)
    bare, safe = selector.select(amplitude), selector.select(amplitude, margin=1.0)
    damper = DamperResponse(scene, _RTOL)
    errors = np.linspace(-0.05, 0.05, count)

    def worst(job: tuple[float, float]) -> float:
        error, height = job
        other = with_stiffness(scene, damper, 1.0 + error)
        timing = Timing(1.5 * damper.settling(), 16.0)
        amplitudes = [other.opened(amplitude, height, timing, travel).amplitude for travel in (1.0, 0.0)]
        return max(amplitudes) / damper.closed_amplitude(amplitude)

    jobs = [(float(error), height) for height in (bare.height, safe.height) for error in errors]
    found = dict(on_all_cores(worst, jobs))
    left, right = (np.array([found[(float(e), height)] for e in errors]) for height in (bare.height, safe.height))
    return MarginCurve(errors, left, right, bare.height, safe.height, safe.price)


@dataclass(frozen=True)
class PcaErrors:
    """How far the PCA is off, over the support's amplitude."""

    amplitudes: Array  # (n,) [m]
    before: Array  # (n,) height before tuning against the best [-]
    after: Array  # (n,) height after tuning against the best [-]
    direct: Array  # (n,) height of the direct selection against the best [-]
    lost_before: Array  # (n,) beam amplitude at the height before tuning against that at the best [-]
    lost_after: Array  # (n,)
    lost_direct: Array  # (n,)


def pca_errors(amplitudes: Array, mass_fraction: float = 0.1, gravity: bool = True) -> PcaErrors:
    """Compute Figs 4.37 to 4.43: the best height is that of a fine scan, finer than any of the methods."""
    scene = standard_bench(gravity=9.81 if gravity else 0.0).with_(mass_fraction=mass_fraction)
    damper = DamperResponse(scene, _RTOL)
    pca, direct = PcaSelector(scene), DirectSelector(scene, workers=1)
    rows = dict(on_all_cores(lambda a: _row(damper, pca, direct, a), [float(a) for a in amplitudes]))
    columns = np.array([rows[float(a)] for a in amplitudes]).T
    return PcaErrors(np.asarray(amplitudes), *columns)


def _row(damper: DamperResponse, pca: PcaSelector, direct: DirectSelector, amplitude: float) -> list[float]:
    timing = Timing(1.5 * damper.settling(), 16.0)

    def remaining(height: float) -> float:
        return max(damper.opened(amplitude, height, timing, travel).amplitude for travel in (1.0, 0.0))

    unit = damper.ballistic_clearance(amplitude)
    scan = [
        (remaining(damper.diameter + share * unit), damper.diameter + share * unit)
        for share in np.arange(0.36, 0.95, 0.005)
    ]
    least, best = min(scan)
    chosen = pca.select(amplitude)
    before = next(stage.height for stage in chosen.stages if stage.name == "PCA")
    heights = [before, chosen.height, direct.select(amplitude).height]
    return [h / best - 1.0 for h in heights] + [remaining(h) / least - 1.0 for h in heights]
