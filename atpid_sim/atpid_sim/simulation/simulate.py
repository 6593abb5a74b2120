# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`simulate`: one scene from start to end: amplitude, error estimate, energy, reproducibility of each window."""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from atpid_common.errors import InputError
from atpid_common.files import Document
from atpid_common.output import finite
from atpid_sim.engine import columns, drive
from atpid_sim.engine.state import State
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.results import Drawn, Labelled, Rows, in_unit, named_impacts
from atpid_sim.scene import Scene
from atpid_sim.simulation.energy import Ledger
from atpid_sim.simulation.fidelity import Choice, choose, judged_errors, require_shallow
from atpid_sim.simulation.integration import (
    Integration,
    Observation,
    amplitude_without_damper,
    drive_table,
    impact_log,
    is_closed,
    negligible_displacement,
    sample_series,
    undamped_amplitude,
)
from atpid_sim.simulation.quantities import efficiency, largest_decrement, worse_than_without
from atpid_sim.simulation.reproducibility import UNCHECKED, Verdict, cross_check_with_finite, judge
from atpid_sim.simulation.unrepeated import few_samples, measures_of, observation_of
from atpid_sim.system import Array

#: Impacts logged of one run.
_LOG = 20_000
#: Samples a period from which the kind of motion is read.
_STROBES = 64
#: Samples a period from which the peaks of a free decay are read: each is within 1e-5 of the true one.
_DECAY_SAMPLES = 800.0
#: Change from period to period, relative to the amplitude, above which the motion is irregular (rumble).
_IRREGULAR = 0.05
#: Share of a period in contact above which the grain sticks (thesis Eq. 4.5: t_c < gamma T / 2 with gamma = 0.1).
_STICKING = 0.1
#: What motions are called whose drive does not repeat itself.
_NEVER_REPEATING = {"random": "random", "series": "recorded", "tones": "tones", "shock": "shock"}


@dataclass(frozen=True, repr=False)
class Result(Labelled):
    """One run: the beam's amplitude in the steady window, how it was computed, error estimate, reproducibility."""

    amplitude: float  # half peak-to-peak of the beam in the window [m]
    undamped_amplitude: float  # the same with the damper closed [m]
    efficiency: float  # 1 - amplitude / undamped_amplitude [-]
    motion: str  # closed, sticking, mixed, optimal, irregular, no_ceiling; random, tones, recorded, shock: as driven
    impacts: int
    floor_impacts: int
    ceiling_impacts: int
    fidelity: str
    rtol: float
    left_out: str  # what the chosen fidelity leaves out, in words
    error_estimate: float  # relative, of the amplitude: numerical and model error together
    reproducible: bool  # under relative changes of the drive up to `reproducible_for`
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
    bare_amplitude: float = math.nan  # amplitude of the structure as it is without the damper [m]
    reduction: float = math.nan  # 1 - amplitude / bare_amplitude [-]; below 0: the damper makes it worse
    reproducible_for: float = math.nan  # relative change of the drive that repeated runs had at most [-]
    # of a drive that goes on without repeating itself, in the steady window; else NaN
    rms: float = math.nan  # root mean square of the beam about its mean [m]
    rms_error: float = math.nan  # its standard error, of a window of finite length [m]
    undamped_rms: float = math.nan  # the same with the damper closed [m]
    efficiency_rms: float = math.nan  # 1 - rms / undamped_rms [-]
    efficiency_rms_error: float = math.nan
    bare_rms: float = math.nan  # of the structure as it is without the damper [m]
    reduction_rms: float = math.nan  # 1 - rms / bare_rms [-]
    reduction_rms_error: float = math.nan
    independent_samples: float = math.nan  # of the beam's mean square [-]
    support_rms: float = math.nan  # of the drive about its mean [m]
    support_acceleration_rms: float = math.nan  # [m/s^2]
    deflection: float = math.nan  # of a shock: the beam's largest against the support in the steady window [m]
    undamped_deflection: float = math.nan  # the same with the damper closed [m]
    bare_deflection: float = math.nan  # and without the damper [m]
    warnings: tuple[str, ...] = ()  # unusual values of the scene, and a damper that makes it worse

    labels = (
        in_unit("m", "amplitude undamped_amplitude bare_amplitude spread rms rms_error undamped_rms bare_rms")
        | in_unit("m", "support_rms deflection undamped_deflection bare_deflection")
        | {"support_acceleration_rms": ("m/s^2", ""), "resonance": ("Hz", ""), "wall_s": ("s", "")}
    )

    def to_json(self) -> Document:
        """Return plain numbers and text; NaN as None."""
        plain: Document = finite(asdict(self))
        return plain


@dataclass(frozen=True, repr=False)
class Trajectory(Drawn):
    """Series (n,) of one run: time [s], displacements [m], velocity, acceleration, ceiling [m]; its impacts (k,)."""

    time: Array
    support: Array
    beam: Array
    beam_velocity: Array
    beam_acceleration: Array
    grain: Array
    ceiling: Array
    impacts: Rows  # with the columns of `results.IMPACT`
    support_unit: str = "m"  # N: of a force that drives instead

    labels = (
        {"time": ("s", "time"), "support": ("support_unit", "time"), "beam_velocity": ("m/s", "time")}
        | {"beam_acceleration": ("m/s^2", "time"), "impacts": ("", "impact")}
        | in_unit("m", "beam grain ceiling", "time")
    )
    drawn = ("beam", "grain")


def simulate(scene: Scene, fidelity: str = "auto", rtol: float | None = None, check: bool = True) -> Result:
    """Run a scene and return its result.

    With `check` the run is repeated with a finer tolerance and a disturbed start, which gives the error estimate and
    shows whether the amplitude is reproducible. Raises NumericalFailure, naming time and state, where the run does not
    end as it should, and SceneError where a controller moves the ceiling.
    """
    scene.require_prescribed_ceiling()
    table = drive_table(scene, scene.steady_window)
    undamped, bare = undamped_amplitude(scene, table), amplitude_without_damper(scene)
    choice = choose(scene, fidelity, undamped=undamped)
    require_shallow(scene, choice, undamped)
    integration = Integration(scene, choice.fidelity, rtol, table=table)
    integration.warm_up()
    begin, end = scene.steady_window
    period = 1.0 / (_STROBES * scene.frequency_hz)
    samples = sample_series(min(100_000, int((end - begin) / period)))
    observation = Observation((begin, end), begin, period, samples, impact_log(_LOG))
    if scene.excitation.kind in _NEVER_REPEATING:
        observation = observation_of(scene)
    begun = time.perf_counter()
    run = integration.run(observation)
    wall = time.perf_counter() - begun
    amplitude, last = run.last.amplitude, run.last
    reduction = efficiency(amplitude, bare)
    measures = measures_of(scene, table, run.samples) if scene.excitation.kind in _NEVER_REPEATING else {}
    worse = worse_than_without(measures.get("reduction_rms", reduction))
    verdict = _verdict(integration, choice, amplitude, last.steps, undamped) if check else UNCHECKED
    return Result(
        amplitude=amplitude,
        undamped_amplitude=undamped,
        efficiency=efficiency(amplitude, undamped),
        motion=_classify(scene, last, run.samples, amplitude),
        impacts=last.floor_impacts + last.ceiling_impacts,
        floor_impacts=last.floor_impacts,
        ceiling_impacts=last.ceiling_impacts,
        fidelity=choice.fidelity,
        rtol=integration.rtol,
        left_out=choice.left_out,
        error_estimate=verdict.error,
        reproducible=verdict.reproducible,
        spread=verdict.spread,
        energy_residual=run.ledger.residual,
        ledger=run.ledger,
        steps=last.steps,
        wall_s=wall,
        result=Outcome.DONE.sentence,
        reproducible_for=verdict.change,
        resonance=scene.natural_frequency_hz,
        bare_amplitude=bare,
        reduction=reduction,
        warnings=(*scene.warnings(), *worse, *few_samples(measures)),
        **measures,
        **_decay(scene, choice.fidelity, integration.rtol),
    )


def _verdict(integration: Integration, choice: Choice, amplitude: float, steps: int, undamped: float) -> Verdict:
    """Return the verdict on a run of so many steps, its error with what the fidelity level leaves out."""
    errors = judged_errors(integration.scene, choice, undamped)
    verdict = judge(integration, amplitude, steps, *errors)
    if choice.fidelity == "impact" and choice.model_error > 0.0 and verdict.reproducible:
        return cross_check_with_finite(integration, amplitude, verdict, choice, undamped)
    return replace(verdict, error=verdict.error + choice.model_error)


def trajectory(
    scene: Scene,
    rate: float | None = None,
    fidelity: str = "auto",
    rtol: float | None = None,
    t_eval: ArrayLike | None = None,
) -> Trajectory:
    """Run a scene and return its motion at i / rate [s] over the whole run, `rate` in Hz, or at instants (n,) [s].

    `fidelity` and `rtol` as in `simulate`. Raises NumericalFailure and SceneError as that does, InputError for instants
    that are not evenly spaced within the run.
    """
    scene.require_prescribed_ceiling()
    integration = Integration(scene, choose(scene, fidelity).fidelity, rtol)
    if rate is None:
        times, period = _even(t_eval, scene.duration)
    else:
        times, period = np.arange(math.floor(scene.duration * rate * (1.0 + 1e-12)) + 1) / rate, 1.0 / rate
    samples = sample_series(len(times))
    seen = Observation(first=float(times[0]), period=period, samples=samples, impacts=impact_log(_LOG))
    run = integration.run(seen, drive_table(scene))
    support, beam, velocity, acceleration, grain, ceiling = run.samples
    impacts, unit = named_impacts(run.impacts), scene.driven_by.unit
    return Trajectory(times[: len(beam)], support, beam, velocity, acceleration, grain, ceiling, impacts, unit)


def _even(t_eval: ArrayLike | None, duration: float) -> tuple[Array, float]:
    """Return instants (n,) and their distance [s]; raise InputError where they are not evenly spaced within a run."""
    times = np.asarray(t_eval, dtype=float)
    if times.ndim == 1 and times.size > 1 and 0.0 <= times[0] < times[-1] <= duration:
        period = float(times[-1] - times[0]) / (times.size - 1)
        if np.abs(np.diff(times) - period).max() <= 1e-6 * period:
            return times, period
    given = np.array2string(times, threshold=4, edgeitems=2)
    allowed = f"two or more evenly spaced from 0 to {duration:g} s, such as numpy.linspace(0, {duration:g}, 1001)"
    raise InputError(f"t_eval: given {given}; allowed: {allowed}")


def _decay(scene: Scene, fidelity: str, rtol: float) -> dict[str, float]:
    """Return what a free decay is measured by; nothing for any other excitation."""
    if not scene.excitation.is_free:
        return {}

    def largest(scene: Scene, fidelity: str, rtol: float) -> float:
        motion = trajectory(scene, _DECAY_SAMPLES * scene.natural_frequency_hz, fidelity, rtol)
        return largest_decrement(motion.beam + scene.static_deflection)

    found = largest(scene, fidelity, rtol)
    return {
        "decrement": found,
        "undamped_decrement": largest(scene.with_(height=2.0 * scene.grain.radius), "simplified", rtol),
        "decrement_error": abs(largest(scene, fidelity, max(1e-2 * rtol, 1e-12)) / found - 1.0),
    }


def _classify(scene: Scene, state: State, samples: Array, amplitude: float) -> str:
    """Return closed, no_ceiling, irregular, optimal, sticking or mixed; or the kind of a drive that never repeats.

    Optimal: every period one impact on the floor and one on the ceiling, and no sticking (criteria 4.3 and 4.5). A free
    decay is never called irregular: its amplitude changes from period to period whatever the grain does.
    """
    if is_closed(scene):
        return "closed"
    if scene.excitation.kind in _NEVER_REPEATING:
        return _NEVER_REPEATING[scene.excitation.kind]
    window = scene.steady_window[1] - scene.steady_window[0]
    periods = window * scene.frequency_hz
    driven = not scene.excitation.is_free
    if driven and amplitude > negligible_displacement(scene) and _period_variation(samples, amplitude) > _IRREGULAR:
        return "irregular"
    floor, ceiling = int(state.n[columns.WINDOW_FLOOR]), int(state.n[columns.WINDOW_CEILING])
    touching = float(state.y[columns.CONTACT_TIME]) / window
    if ceiling == 0:
        return "no_ceiling" if floor > 0 else "sticking"
    if abs(floor - periods) <= 1.0 and abs(ceiling - periods) <= 1.0 and touching < _STICKING:
        return "optimal"
    return "sticking" if touching > 2.0 * _STICKING else "mixed"


def _period_variation(samples: Array, amplitude: float) -> float:
    """Return the root mean square change between successive periods (or pairs), relative to the amplitude."""
    beam = samples[columns.S_BEAM]
    if len(beam) < 4 * _STROBES:
        return 0.0
    changes = [np.sqrt(np.mean((beam[lag:] - beam[:-lag]) ** 2)) for lag in (_STROBES, 2 * _STROBES)]
    return float(min(changes) / amplitude)


def verdicts(scene: Scene, windows: Sequence[tuple[float, float]], fidelity: str = "auto") -> list[Verdict | None]:
    """Return the verdict on the amplitude in each window (begin, end) [s]; None for one that has no amplitude.

    The windows rise and do not overlap. The run goes on from window to window; each part, from the end of the window
    before, is repeated on its own, disturbed at its begin. Raises NumericalFailure where the run does not reach the end
    of the last window.
    """
    table = drive_table(scene, tuple(t for window in windows for t in window))
    choice = choose(scene, fidelity)
    level, errors = choice.fidelity, judged_errors(scene, choice)
    found: list[Verdict | None] = []
    state, done = Integration(scene, level, table=table).initial_state(), 0.0
    for begin, end in windows:
        whole, rows = scene.with_(duration=end, steady_window=[begin, end]), drive.between(table, done, end)
        part = Integration(whole, level, table=rows, start=state)
        state = part.initial_state()
        outcome = part.advance(state, part.table, Observation((begin, end)), part.step_limit)
        if outcome != Outcome.DONE:
            raise NumericalFailure(f"{outcome.sentence} (between {done:g} and {end:g} s)")
        found.append(judge(part, state.amplitude, state.steps, *errors) if state.amplitude > 0.0 else None)
        done = end
    return found
