# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motion a scene comes to, by running it for long: nothing here is of `atpid_sim.periodic`.

The scene is run at the complete fidelity and a fine tolerance, and looked at once a period, until that repeats itself
after one to eight periods. The run is repeated with the drive disturbed by a millionth either way: where these end
elsewhere, which motion follows is left to chance. Multipliers are central differences of further runs.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import SUPPORT, Integration, Observation, drive_table, sample_series
from atpid_sim.system import Array

#: The judge's tolerances, of its runs and of the runs whose differences give multipliers.
_RTOL, _FINE = 1e-9, 1e-11
#: Periods of a block, blocks at most, and strobes over which a motion has to repeat itself.
_BLOCK, _BLOCKS, _WATCHED = 100, 16, 60
#: Longest period looked for, and distance of strobes over the motion's size up to which they are the same.
_LONGEST, _SAME = 8, 5e-8
#: The same at the end of all blocks: as near as kinked laws repeat themselves.
_ROUGH = 2e-5
#: The same for a part of the period found, once the motion has gone on for another block.
_TURNING = 3.0
#: Disturbances of the drive, and relative change of the amplitude from which on the motion is another one.
_DISTURBED, OTHER = (-1e-6, 1e-6), 1e-4
#: Half-widths of differences over the motion's size, and samples a period in which their section is chosen.
_WIDTHS, _SAMPLES = (1e-4, 1e-5, 1e-6), 256
#: How a long run may end.
PERIODIC, IRREGULAR, CHANCE = "periodic", "irregular", "chance"


class Judgement(NamedTuple):
    """What a long run comes to."""

    ending: str  # periodic, irregular, chance, or why a run did not reach its end
    periods: int = 0  # after which it repeats itself
    amplitude: float = math.nan  # half peak-to-peak of the beam [m]
    multiplier: float = math.nan  # largest modulus
    unsure: float = math.nan  # what two widths of differences give differently
    touching: float = math.nan  # share of the time in contact
    waited: int = 0  # periods


class _Long:
    """A scene run on and on, its last excitation and ceiling staying what they are."""

    def __init__(self, scene: Scene, disturbance: float = 0.0) -> None:
        self.period = 1.0 / scene.frequency_hz
        end = scene.duration + (_BLOCK * (_BLOCKS + 1) + 2 * _LONGEST + 2) * self.period
        longer = scene.with_(duration=end, steady_window=[end - 2.0 * self.period, end])
        self.run = Integration(longer, "impact" if scene.contact.law == "impact" else "soft", _RTOL)
        self.table = drive_table(longer)
        self.table[:, SUPPORT] *= 1.0 + disturbance
        self.state = self.run.initial_state()
        whole = math.ceil(scene.duration / self.period - 1e-9) * self.period
        self.strobed(whole, self.period)

    def strobed(self, duration: float, spacing: float, rtol: float = _RTOL) -> Array:
        """Go on for a duration [s]; return displacement and velocity of the beam and that of the grain (n, 3)."""
        begin, end = self.state.time, self.state.time + duration
        series = sample_series(int(duration / spacing + 1e-6))
        self.state.restart_observation()
        self.state.restart_steps()
        self.state.y[columns.CONTACT_TIME] = 0.0
        run = self.run if rtol == _RTOL else self.run.at_level(self.run.fidelity, rtol)
        seen = Observation((begin, end), begin, spacing, series)
        outcome = run.advance(self.state, drive.between(self.table, begin, end), seen, run.step_limit)
        if outcome != Outcome.DONE:
            raise NumericalFailure(outcome.sentence)
        return series[[columns.S_BEAM, columns.S_VELOCITY, columns.S_GRAIN]].T

    def settled(self) -> tuple[int, int]:
        """Go on until the strobes repeat themselves; return after how many periods (0: never), and those waited."""
        for block in range(_BLOCKS):
            strobes = self._scaled()
            for periods in range(1, _LONGEST + 1):
                if _moved(strobes, periods) <= _SAME:
                    return self._least(periods), _BLOCK * (block + 1)
        moved = [_moved(strobes, periods) for periods in range(1, _LONGEST + 1)]
        if min(moved) > _ROUGH:
            return 0, _BLOCK * _BLOCKS
        return 1 + next(k for k, far in enumerate(moved) if far <= _TURNING * min(moved)), _BLOCK * _BLOCKS

    def _scaled(self) -> Array:
        """Go on for a block; return the strobes over the motion's size (n, 3)."""
        strobes = self.strobed(_BLOCK * self.period, self.period)
        pace = 2.0 * math.pi / self.period
        scaled: Array = strobes / (max(self.state.amplitude, 1e-12) * np.array([1.0, pace, 1.0]))
        return scaled

    def _least(self, periods: int) -> int:
        """Go on for a block: a motion that turns about its end comes near it first after several periods."""
        strobes = self._scaled()
        return next(p for p in range(1, periods + 1) if p == periods or _moved(strobes, p) <= _TURNING * _SAME)


def _moved(strobes: Array, periods: int) -> float:
    """Return how far the last strobes (n, 3) are from those so many periods before."""
    return float(np.abs(strobes[periods:] - strobes[:-periods])[-_WATCHED:].max())


def judge(scene: Scene) -> Judgement:
    """Return what the long run of a scene comes to."""
    try:
        run = _Long(scene)
        periods, waited = run.settled()
        if periods == 0:
            return Judgement(IRREGULAR, 0, run.state.amplitude, waited=waited)
        amplitude = run.state.amplitude
        touching = float(run.state.y[columns.CONTACT_TIME]) / (_BLOCK * run.period)
        for part in _DISTURBED:
            other = _Long(scene, part)
            if not other.settled()[0] or abs(other.state.amplitude / amplitude - 1.0) > OTHER:
                return Judgement(CHANCE, periods, amplitude, touching=touching, waited=waited)
        multiplier, unsure = _largest_multiplier(run, periods)
        return Judgement(PERIODIC, periods, amplitude, multiplier, unsure, touching, waited)
    except NumericalFailure as failure:
        return Judgement(str(failure))


def _largest_multiplier(run: _Long, periods: int) -> tuple[float, float]:
    """Return the largest modulus of the multipliers of a settled motion, and what two widths give differently.

    The section is where the grain is farthest from both walls. Where it never flies only beam and grain together are
    displaced: they move as one.
    """
    spacing = run.period / _SAMPLES
    amplitude = run.state.amplitude
    origin = run.state.copy()
    series = run.strobed(periods * run.period, spacing)
    gap = series[:, 2] - series[:, 0]
    clearance = float(run.table[-1, columns.HEIGHT]) - 2.0 * run.run.system.radius
    room = np.minimum(gap, clearance - gap)
    place = int(np.argmax(room))
    run.state = origin
    if place:
        run.strobed(place * spacing, run.period)
    flies = run.state.mode == columns.FREE and room[place] > 0.0
    pace = 2.0 * math.pi / run.period
    grain = [columns.GRAIN, columns.GRAIN_VELOCITY]
    own = [[columns.BEAM], [columns.BEAM_VELOCITY]]
    if run.run.system.modes is not None:  # each moves the container
        begins = range(columns.STATE_SIZE, len(origin.y), columns.MODE_COLUMNS)
        own = [[begin + k, own[k][0]] for begin in begins for k in (columns.Q, columns.Q_RATE)]
    places = [*own, *([one] for one in grain)] if flies else [[*one, grain[k % 2]] for k, one in enumerate(own)]
    scale = np.tile((1.0, pace), len(places) // 2)
    least = min(1.0, 0.1 * float(room[place]) / (amplitude * max(_WIDTHS))) if flies else 1.0
    found = [_radius(run, periods, places, scale * amplitude, least * width) for width in _WIDTHS]
    pairs = sorted((abs(a - b), b) for a, b in pairwise(found))
    return pairs[0][1], pairs[0][0]


def _radius(run: _Long, periods: int, places: Sequence[list[int]], scale: Array, width: float) -> float:
    """Return the spectral radius of the derivative of the map over so many periods, by central differences."""
    origin = run.state
    slope = np.empty((len(places), len(places)))
    for column, (where, size) in enumerate(zip(places, scale.tolist(), strict=True)):
        ends = []
        for sign in (1.0, -1.0):
            run.state = origin.copy()
            run.state.y[where] += sign * width * size
            run.strobed(periods * run.period, run.period, _FINE)
            ends.append(np.array([run.state.y[each[0]] for each in places]))
        slope[:, column] = (ends[0] - ends[1]) / (2.0 * width * size)
    run.state = origin
    return float(np.abs(np.linalg.eigvals(slope)).max())
