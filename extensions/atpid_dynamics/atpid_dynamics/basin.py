# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The share of initial states that come to a promised motion, by what time, with its error.

The promised motion is the one that the scene's own run comes to or, where that comes to none, the one of the lowest
amplitude among those that random starts come to. A start has arrived once it passes a section of that motion inside its
verified neighbourhood (`neighbourhood`). It has not come if it enters that of another motion, or none in
`LIMIT` settling times.

The number of starts is chosen at looks fixed in advance: the first whose Clopper-Pearson interval is narrow enough ends
the sampling. Each look has its own level and their errors add up to 5 %, so the interval covers in at least 95 %,
wherever the sampling ends. All heights take the same random numbers.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from atpid_dynamics.engine.basin_run import NOWHERE
from atpid_dynamics.neighbourhood import Counts, Cycle, Flow, cycle_of, neighbourhoods
from atpid_sim.engine import columns
from atpid_sim.engine.sections import GRAIN, GRAIN_VELOCITY, MODES, MODES_VELOCITY
from atpid_sim.engine.state import State
from atpid_sim.modal import container_mass
from atpid_sim.periodic.return_map import Conditions, ReturnMap
from atpid_sim.periodic.solve import PeriodicMotion, SteadyEnding, SteadyState, periodic_motion, size_of, solve
from atpid_sim.periodic.steady import steady_state
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import choose
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array

#: Settling times, and periods at least, after which a start that has not arrived has not come.
LIMIT, _LEAST_LIMIT = 20.0, 100
#: Relative tolerance of the amplitude for which the fidelity is chosen: shares need no finer one. That of runs of
#: several modes, whose contacts are integrated: the least neighbourhoods are smaller than what looser runs repeat.
_TOLERANCE, _SMOOTH = 1e-3, 1e-7
#: Error of all looks' intervals together, that of the looks before the last, and how many looks there are.
_MISSED, _EARLY, _LOOKS = 0.05, 0.01, 5
#: Starts whose ends show which other motions there are, and how many of the ends are looked at.
_FIRST, _ENDS = 32, 6
#: Starts that look for the lowest motion where the scene's own run comes to none, and periods that they run.
_LOOKING, _RUN = 16, 400
#: Longest period of such motions, and how near, over its size, a run has to come to itself to be solved for one.
_LONGEST, _RECURRED = 8, 0.02


#: Which motion is promised.
_OWN = "the motion that the scene's own run comes to"
_LOWEST = "the motion of the lowest amplitude that random starts come to; the scene's own run comes to none"


@dataclass(frozen=True)
class Starts:
    """Where starts lie: kicks of the promised motion at a random phase or, without one, a box of states.

    A kick of V changes the velocities of beam and grain by V cos(a) and V sin(a); of several modes each takes the share
    that an impulse at the container gives it. In a box of S the displacement and velocity of each mode lie within S of
    its size (`Integration.sizes`) about rest, the grain anywhere between floor and ceiling, with a velocity relative to
    the beam within S of the beam's largest. Phase, a and the box are uniform.
    """

    kick: float | None = None  # [m/s]
    box: float = 1.0  # [-]


@dataclass(frozen=True)
class Basin:
    """The share of starts that come to the promised motion."""

    height: float  # of the ceiling [m]
    drive_amplitude: float  # of the support [m], or of a force [N]
    share: float = math.nan  # [-]; NaN where no motion is promised
    low: float = 0.0  # of its 95 % interval [-]
    high: float = 1.0
    starts: int = 0
    elsewhere: int = 0  # of them came to another motion
    undecided: int = 0  # of them came to none
    times: tuple[float, ...] = (math.inf,) * 3  # by which 50, 90 and 95 % of all starts have arrived [s]; inf: fewer do
    limit: float = math.nan  # when a start that has not arrived has not come [s]
    promised: str = ""  # which motion, or why none
    amplitude: float = math.nan  # of the promised motion [m]
    periods: int = 0
    multipliers: tuple[float, ...] = ()  # their moduli, the largest first
    radius: float = math.nan  # of its verified neighbourhood, over the motion's size [-]
    fidelity: str = ""
    steps: int = 0  # of the engine, for all starts

    def sentence(self, kick: float | None = None, box: float = 1.0) -> str:
        """Return the share of `Starts` in a line of text."""
        if not self.starts:
            return f"no motion to come to: {self.promised}"
        what = f"kicks of {kick:g} m/s come back" if kick else f"starts in a box of {box:g} come"
        by = ", ".join("never" if math.isinf(time) else f"{time:.3g} s" for time in self.times)
        return (
            f"{100 * self.share:.1f} % of {what} ({100 * self.low:.1f} to {100 * self.high:.1f} %, {self.starts} "
            f"starts); 50, 90, 95 % by {by}; largest multiplier {self.multipliers[0]:.3f}, {self.promised}"
        )


def basin(
    scene: Scene, starts: Starts, error: float = 0.02, count: int | None = None, seed: int = 1, fidelity: str = "auto"
) -> Basin:
    """Return the share of starts that come to the promised motion, under the scene's last excitation and ceiling.

    error: half-width of the 95 % interval for which the number of starts is chosen; count: so many in its place.
    fidelity: as in `simulate`, for an amplitude to a thousandth. Raises as `steady_state`.
    """
    scene = scene.with_(tolerance=max(scene.tolerance, _TOLERANCE))
    level = choose(scene, fidelity, stays_closed=False).fidelity
    search = steady_state(scene, level)
    conditions = Conditions(scene.excitation.amplitude_points[-1][1], scene.frequency_hz, scene.ceiling.heights[-1][1])
    integration, source = Integration(scene, level, None if scene.modes is None else _SMOOTH), _OWN
    drawn = np.random.default_rng(seed).random((count or _looks(error)[-1], len(integration.sections.places) + 2))
    own: SteadyState | PeriodicMotion | None = search.state
    if own is not None and scene.modes is not None:  # found to within what the level leaves out: not near enough
        own = solve(ReturnMap(integration, conditions, own.phase, own.periods), own.section).motion or own
    cycle = None if own is None else cycle_of(integration, conditions, own)
    if cycle is None and search.ending != SteadyEnding.CHANGING:
        cycle, source = _lowest(Flow(integration, conditions, 0.0), drawn[:_LOOKING]), _LOWEST
    trial = None if cycle is None else _Trial(integration, conditions, cycle, starts)
    if trial is None or not trial.own:
        why = search.ending.value if trial is None else "the neighbourhood of the motion could not be verified"
        return Basin(conditions.height, conditions.amplitude, promised=why, fidelity=level)
    return trial.result(source, *sampled(lambda size: trial.run(drawn[:size]), error, count))


def sampled(came: Callable[[int], int], error: float, count: int | None = None) -> tuple[float, float]:
    """Return the 95 % interval of a share [-] of half-width `error` at most, or that of `count` starts.

    came: runs so many starts in all, and returns how many of them have come.
    """
    from scipy.stats import binomtest  # here, as below: it loads slowly, and a sweep needs none of it

    sizes, misses = _looks(error), [_EARLY / (_LOOKS - 1)] * (_LOOKS - 1) + [_MISSED - _EARLY]
    low, high = 0.0, 1.0
    for size, missed in zip(sizes, misses, strict=True) if count is None else [(count, _MISSED)]:
        low, high = binomtest(came(size), size).proportion_ci(1.0 - missed)
        if high - low <= 2.0 * error:
            break
    return low, high


def _looks(error: float) -> list[int]:
    """Return the numbers of starts at which the interval is looked at; the last suffices."""
    from scipy.stats import norm

    last = (0.5 * norm.isf(0.5 * (_MISSED - _EARLY)) / error) ** 2 + 1.0 / error
    return [math.ceil(last / 2**k) for k in reversed(range(_LOOKS))]


class _Trial:
    """The starts of one promised motion, as far as they are run."""

    def __init__(self, integration: Integration, conditions: Conditions, cycle: Cycle, starts: Starts) -> None:
        self.flow, self.cycle, self.starts = Flow(integration, conditions, cycle.phase), cycle, starts
        self.places, self.radius = neighbourhoods(self.flow, cycle)
        self.own, self.flow.steps = len(self.places), 0
        self.shares = np.ones(self.own)  # of the period at which the places lie; the promised motion's are the last
        self.limit = math.ceil(max(LIMIT * cycle.settling_periods, _LEAST_LIMIT))
        self.when = np.empty(0)  # periods until each start has arrived, infinite where it has not
        self.elsewhere = 0

    def run(self, drawn: Array) -> int:
        """Run those starts of random numbers (k, n + 2) in [0, 1) that are not run yet; return how many arrived."""
        first = len(self.when) == 0
        y, n = self._states(drawn[:_FIRST] if first else drawn[len(self.when) :])
        where, when = self.flow.follow(y, n, self.limit, self.places, self.shares)
        others = len(self.places) - self.own
        self.elsewhere += int(((where >= 0) & (where < others)).sum())
        self.when = np.concatenate([self.when, np.where(where >= others, when, math.inf)])
        if first:
            self._learn_others(y[where == NOWHERE], n[where == NOWHERE])
            return self.run(drawn)
        return int(np.isfinite(self.when).sum())

    def _learn_others(self, y: Array, n: Counts) -> None:
        """Add the neighbourhoods of other motions, to which states at the section have come: runs end sooner there."""
        for state in map(State, y[:_ENDS], n[:_ENDS]):
            found = None if self._known(state) else _cycle_at(self.flow, state)
            if found is None:
                continue
            share = (found.phase - self.flow.phase) % 1.0 or 1.0
            passing = found.state.copy()
            passing.y[columns.TIME] = share * self.flow.period
            if self._known(passing):  # a motion that is known, from a state that had not come so near
                continue
            others, _ = neighbourhoods(self.flow.at(found.phase), found)
            shares = np.concatenate([np.full(len(others), share), self.shares])
            order = np.argsort(shares, kind="stable")
            self.places, self.shares = np.concatenate([others, self.places])[order], shares[order]

    def _known(self, state: State) -> bool:
        """Return whether a state soon lies in a neighbourhood that is known."""
        y, n = state.y[None].copy(), state.n[None].copy()
        return bool(self.flow.follow(y, n, _LONGEST, self.places, self.shares)[0][0] != NOWHERE)

    def _states(self, drawn: Array) -> tuple[Array, Counts]:
        if self.starts.kick is None:
            size = size_of(self.flow.integration, self.cycle.amplitude, self.flow.conditions)
            return _boxed(self.flow, self.starts.box * size, drawn)
        flow, system = self.flow, self.flow.integration.system
        y, n = np.empty((len(drawn), len(self.cycle.state.y))), np.empty((len(drawn), columns.COUNTERS), dtype=np.int64)
        times, state, row = drawn[:, 0] * self.cycle.periods * flow.period, self.cycle.state.copy(), flow.rows([1.0])
        for k in np.argsort(times):
            row[0, columns.END] = times[k]
            flow.integration.advance_whole(state, row)
            y[k], n[k] = state.y, state.n
        y[:, columns.TIME] %= flow.period
        angle = 2.0 * math.pi * drawn[:, 1]
        beam, grain = self.starts.kick * np.cos(angle), self.starts.kick * np.sin(angle)
        mass, shares = _container(flow)
        if flow.clearance <= 1e-4 * system.radius:  # held: one mass
            beam = grain = (mass * beam + system.grain_mass * grain) / (mass + system.grain_mass)
        elif flow.integration.fidelity == "impact":
            n[:, columns.MODE] = columns.FREE  # a grain at rest on a wall departs, or strikes it at once
        states = y[:, flow.places]
        states[:, MODES_VELOCITY] += beam[:, None] * shares
        states[:, GRAIN_VELOCITY] += grain
        flow.integration.sections.enter(y, states)
        return y, n

    def result(self, source: str, low: float, high: float) -> Basin:
        """Return the result with an interval of the share [-]."""
        flow, cycle, count, when = self.flow, self.cycle, len(self.when), np.sort(self.when)
        came = int(np.isfinite(when).sum())
        return Basin(
            flow.conditions.height, flow.conditions.amplitude, came / count, low, high, count, self.elsewhere,
            count - came - self.elsewhere,
            tuple(float(when[math.ceil(part * count) - 1]) * flow.period for part in (0.5, 0.9, 0.95)),
            self.limit * flow.period, source, cycle.amplitude, cycle.periods,
            tuple(np.abs(cycle.multipliers).tolist()), self.radius, flow.integration.fidelity, flow.steps,
        )  # fmt: skip


def _container(flow: Flow) -> tuple[float, Array]:
    """Return what an impulse at the container meets [kg], and each mode's share (modes,) of the velocity it gives."""
    modes = flow.integration.scene.modes
    if modes is None:
        return flow.integration.system.beam_mass, np.ones(1)
    mass = container_mass(modes.free)
    return mass, mass / modes.free.mass


def _boxed(flow: Flow, size: Array, drawn: Array) -> tuple[Array, Counts]:
    """Return states in a box of half-widths `size` (n,), of random numbers (k, n + 2) in [0, 1)."""
    system, modes = flow.integration.system, flow.integration.resting_modes
    rest = -(system.beam_mass + system.grain_mass) * system.gravity / system.stiffness
    start = flow.integration.sections.flying(np.zeros(len(size)))
    y, n = np.tile(start.y, (len(drawn), 1)), np.tile(start.n, (len(drawn), 1))
    y[:, columns.TIME] = drawn[:, 0] * flow.period
    states, aside = np.empty((len(drawn), len(size))), 2.0 * drawn - 1.0
    moved = np.column_stack((aside[:, 1:3], aside[:, 6:])) * size[:-2]  # the first mode's, then the others'
    states[:, MODES] = moved[:, ::2] + (rest if modes is None else modes[:, 0])
    states[:, MODES_VELOCITY] = moved[:, 1::2]
    states[:, GRAIN] = states[:, MODES].sum(axis=1) + drawn[:, 3] * max(flow.clearance, 0.0)
    states[:, GRAIN_VELOCITY] = states[:, MODES_VELOCITY].sum(axis=1) + aside[:, 4] * size[GRAIN_VELOCITY]
    flow.integration.sections.enter(y, states)
    return y, n


def _lowest(flow: Flow, drawn: Array) -> Cycle | None:
    """Return the stable motion of the lowest amplitude that starts in a box come to; None where they come to none."""
    scene = flow.integration.scene
    closed = scene.linear_amplitude(flow.conditions.amplitude, flow.conditions.frequency, grain=True)
    y, n = _boxed(flow, size_of(flow.integration, closed, flow.conditions), drawn)
    flow.follow(y, n, _RUN, flow.none, np.empty(0))
    found = [cycle for state in map(State, y, n) if (cycle := _cycle_at(flow, state)) is not None]
    lowest = sorted(found, key=lambda cycle: cycle.amplitude)
    return next((cycle for cycle in lowest if len(neighbourhoods(flow.at(cycle.phase), cycle)[0])), None)


def _cycle_at(flow: Flow, state: State) -> Cycle | None:
    """Return the stable motion that a state, at the phase where the flow begins, has come near to; None without one."""
    y, n, scale = state.y[None].copy(), state.n[None].copy(), flow.integration.sizes(flow.conditions.frequency)
    y[0, columns.TIME] = 0.0
    size = np.abs(state.y[flow.places] / scale).max()
    for periods in range(1, _LONGEST + 1):
        flow.follow(y, n, 1, flow.none, np.empty(0))
        if np.abs((y[0, flow.places] - state.y[flow.places]) / scale).max() > _RECURRED * size:
            continue
        found = periodic_motion(flow.integration, flow.conditions, state, flow.phase, periods).motion
        if found is not None and found.stability_margin > 0.0:
            return cycle_of(flow.integration, flow.conditions, found)
    return None
