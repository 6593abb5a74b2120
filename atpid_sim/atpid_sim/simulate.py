# SPDX-License-Identifier: Apache-2.0
"""`simulate`: one scene from start to end, with the truth about its result."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_sim import trust
from atpid_sim.decay import largest_decrement
from atpid_sim.engine import state
from atpid_sim.fidelity import Choice, choose
from atpid_sim.motion import classify
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.run import (
    LOOSEST,
    Array,
    Counts,
    Ledger,
    Stepper,
    drive_table,
    half_peak_to_peak,
    initial_state,
    ledger_of,
    step_budget,
    stepper_of,
    undamped_amplitude,
)
from atpid_sim.scene import FreeExcitation, Scene

#: Impacts remembered of one run.
_LOG = 20_000

#: Samples a period from which the kind of motion is read.
_STROBES = 64

#: Samples a period from which the peaks of a free decay are read: each is within 1e-5 of the true one.
_DECAY_SAMPLES = 800.0

#: The integrator's relative tolerance is this share of the amplitude error asked for (measured: docs/tradeoff.md).
_TOLERANCE_SHARE = 0.3


@dataclass(frozen=True)
class Result:
    """One run: the beam's amplitude in the steady window, what it rests on, and how far to trust it."""

    amplitude: float  # half peak-to-peak of the beam in the window [m]
    undamped_amplitude: float  # the same with the damper closed [m]
    efficiency: float  # 1 - amplitude / undamped_amplitude [-]
    motion: str  # closed, sticking, mixed, optimal, irregular, no_ceiling
    impacts: int
    floor_impacts: int
    ceiling_impacts: int
    fidelity: str
    rtol: float
    left_out: str  # what the chosen rung leaves out, in words
    error_estimate: float  # relative, of the amplitude: numerical and model error together
    reproducible: bool
    spread: tuple[float, float, float] | None  # least, median, largest amplitude [m] where it is not reproducible
    energy_residual: float  # relative
    ledger: Ledger
    steps: int
    wall_s: float  # the integration alone, compiled [s]
    result: str  # the outcome, a sentence
    resonance: float = math.nan  # natural frequency of beam and grain as one mass [Hz]
    decrement: float = math.nan  # of a free decay: largest ratio of successive upper peaks [-]; else NaN
    undamped_decrement: float = math.nan  # the same with the damper closed [-]
    decrement_error: float = math.nan  # relative, by a hundredth of the tolerance [-]
    warnings: tuple[str, ...] = ()  # unusual values of the scene

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers and text; NaN as None."""
        plain: dict[str, Any] = _finite(asdict(self))
        return plain


@dataclass(frozen=True)
class Trajectory:
    """Series (n,) of one run: time [s], displacements [m], velocity, acceleration, ceiling [m]; impacts (k, 3)."""

    time: NDArray[np.float64]
    support: NDArray[np.float64]
    beam: NDArray[np.float64]
    beam_velocity: NDArray[np.float64]
    beam_acceleration: NDArray[np.float64]
    grain: NDArray[np.float64]
    ceiling: NDArray[np.float64]
    impacts: NDArray[np.float64]  # time [s], wall (+1 floor, -1 ceiling), closing speed [m/s]


def simulate(
    scene: Scene,
    fidelity: str = "auto",
    rtol: float | None = None,
    height: float | None = None,
    check: bool = True,
) -> Result:
    """Run a scene and return its result.

    `height` [m] replaces the ceiling by one that stands still there. With `check` the run is repeated with a finer
    tolerance and a disturbed start, which gives the error estimate and tells whether the amplitude is reproducible.
    Raises NumericalFailure, naming time and state, where the run does not end as it should, and SceneError where a
    controller moves the ceiling and no height is given.
    """
    scene = _with_height(scene, height)
    choice = choose(scene, fidelity)
    tolerance = _tolerance(scene, rtol)
    stepper = stepper_of(scene, choice.fidelity, tolerance)
    table = drive_table(scene, scene.steady_window)
    warm_up(stepper)
    begun = time.perf_counter()
    first, y, n, out, _events = _integrate(scene, stepper, table)
    wall = time.perf_counter() - begun
    amplitude = half_peak_to_peak(y)
    undamped = undamped_amplitude(scene, table)
    verdict = (
        trust.judge(scene, choice.fidelity, tolerance, table, amplitude, int(state.spent(n)))
        if check
        else trust.unchecked()
    )
    ledger = ledger_of(scene, table, first, y, int(n[state.MODE]))
    return Result(
        amplitude=amplitude,
        undamped_amplitude=undamped,
        efficiency=1.0 - amplitude / undamped if undamped > 0.0 else math.nan,
        motion=classify(scene, y, n, out, amplitude),
        impacts=int(n[state.FLOOR_HITS] + n[state.CEILING_HITS]),
        floor_impacts=int(n[state.FLOOR_HITS]),
        ceiling_impacts=int(n[state.CEILING_HITS]),
        fidelity=choice.fidelity,
        rtol=tolerance,
        left_out=choice.left_out,
        error_estimate=verdict.error + choice.model_error,
        reproducible=verdict.reproducible,
        spread=verdict.spread,
        energy_residual=ledger.residual,
        ledger=ledger,
        steps=int(state.spent(n)),
        wall_s=wall,
        result=Outcome.DONE.sentence,
        resonance=scene.natural_frequency_hz,
        warnings=tuple(scene.warnings()),
        **_decay(scene, choice.fidelity, tolerance),
    )


def trajectory(
    scene: Scene, rate: float, fidelity: str = "auto", rtol: float | None = None, height: float | None = None
) -> Trajectory:
    """Run a scene and return its motion at i / rate [s], `rate` in Hz, over the whole run.

    `fidelity`, `rtol` and `height` [m] as in `simulate`. Raises NumericalFailure and SceneError as that does.
    """
    scene = _with_height(scene, height)
    choice = choose(scene, fidelity)
    stepper = stepper_of(scene, choice.fidelity, _tolerance(scene, rtol))
    count = math.floor(scene.duration * rate * (1.0 + 1e-12)) + 1
    out, events = np.zeros((state.ROWS, count)), np.zeros((_LOG, state.COLUMNS))
    y, n = initial_state(scene)
    advance(stepper, drive_table(scene), y, n, (math.inf, math.inf), (0.0, 1.0 / rate), out, events, step_budget(scene))
    out = out[:, : n[state.SAMPLE]]
    return Trajectory(np.arange(out.shape[1]) / rate, *_series(out), events[: n[state.EVENTS]])


def _with_height(scene: Scene, height: float | None) -> Scene:
    changed = scene if height is None else scene.with_(height=height)
    changed.require_prescribed_ceiling()
    return changed


def _decay(scene: Scene, fidelity: str, rtol: float) -> dict[str, float]:
    """Return what a free decay is measured by; nothing for any other excitation."""
    if not isinstance(scene.excitation, FreeExcitation):
        return {}

    def largest(fidelity: str, rtol: float, height: float | None = None) -> float:
        motion = trajectory(scene, _DECAY_SAMPLES * scene.natural_frequency_hz, fidelity, rtol, height)
        return largest_decrement(motion.beam + scene.static_deflection)

    found = largest(fidelity, rtol)
    return {
        "decrement": found,
        "undamped_decrement": largest("simplified", rtol, 2.0 * scene.grain.radius),
        "decrement_error": abs(largest(fidelity, max(1e-2 * rtol, 1e-12)) / found - 1.0),
    }


def _finite(value: Any) -> Any:
    """Return the same with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _tolerance(scene: Scene, rtol: float | None) -> float:
    return min(_TOLERANCE_SHARE * scene.tolerance, LOOSEST) if rtol is None else rtol


def _series(out: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
    support, beam, rate, acceleration, grain, ceiling = out
    return support, beam, rate, acceleration, grain, ceiling


def advance(
    stepper: Stepper,
    table: Array,
    y: Array,
    n: Counts,
    observe: tuple[float, float],
    sampling: tuple[float, float],
    out: Array,
    events: Array,
    budget: int,
) -> None:
    """Carry a state through a table, or raise NumericalFailure with the outcome, time and state."""
    outcome = stepper(table, y, n, observe, sampling, out, events, budget)
    if outcome != Outcome.DONE:
        raise NumericalFailure(
            f"{outcome.sentence} (at {y[state.TIME]:.6f} s: beam {y[state.BEAM]:.6g} m, "
            f"grain {y[state.GRAIN]:.6g} m above its rest, {state.spent(n)} steps)"
        )


def warm_up(stepper: Stepper) -> None:
    """Compile a stepper, or load it from the cache, so that timings tell the integration alone."""
    y, n = state.at_rest(0.0, 0.0)
    stepper(np.zeros((0, 12)), y, n, (0.0, 0.0), (0.0, 1.0), _NO_SAMPLES, _NO_LOG, 1)


def _integrate(scene: Scene, stepper: Stepper, table: Array) -> tuple[Array, Array, Counts, Array, Array]:
    begin, end = scene.steady_window
    period = 1.0 / (_STROBES * scene.frequency_hz)
    out = np.zeros((state.ROWS, min(100_000, int((end - begin) / period))))
    events = np.zeros((_LOG, state.COLUMNS))
    y, n = initial_state(scene)
    first = y.copy()
    advance(stepper, table, y, n, (begin, end), (begin, period), out, events, step_budget(scene))
    return first, y, n, out, events


_NO_SAMPLES = np.zeros((state.ROWS, 0))
_NO_LOG = np.zeros((0, state.COLUMNS))

__all__ = ["Choice", "Result", "Trajectory", "simulate", "trajectory"]
