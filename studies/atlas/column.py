# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One column of the atlas: the heights swept upward and downward, the best height, its stability and the cliff."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.maps import DamperResponse, map_tolerance
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic import SearchEnding
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import Observation, impact_log, sample_series
from studies.atlas.plan import Place
from studies.atlas.stability import SAME, TRAVEL, WATCH, Stability, stability_of
from studies.theory.impacts import motion_type
from studies.thorough_search import thorough_best

#: Types of `studies.theory.impacts` by their number in the atlas.
TYPES = ("sticking", "mixed", "optimal", "irregular", "no_ceiling")
#: Number of a cell whose run failed.
FAILED = -1
#: Impacts logged at one height.
_LOG = 4000
#: Period-to-period variation up to which a motion is regular [-].
_REGULAR = 0.02
#: Settling at each height, as a share of the damper's settling time: the motion begins near its end.
_SETTLE = 0.8
#: A best height stays in the lower of two wells far apart unless the other is better by this share, as in a map.
_WELL = 0.15


class Cell(NamedTuple):
    """What a sweep shows at one height."""

    type: int  # place in TYPES, or FAILED
    amplitude: float  # half peak-to-peak of the beam [m]
    regular: bool  # it repeats each period or each second one


@dataclass(frozen=True)
class BestHeight:
    """The best height of a column (docs/selection.md); NaN, with `failure`, where it could not be computed."""

    height: float = math.nan  # [m]
    amplitude: float = math.nan  # [m]
    reproducible: bool = False
    evaluations: int = 0
    failure: str = ""


@dataclass(frozen=True)
class Column:
    """A column of heights (n,)."""

    heights: list[float]  # rising [m]
    closed: float  # amplitude of the closed damper [m]
    up: list[Cell]
    down: list[Cell]
    best: BestHeight
    stability: Stability

    @property
    def simulations(self) -> int:
        """Runs this column took, without those of return maps."""
        return len(self.up) + len(self.down) + self.best.evaluations + 1 + self.stability.returns

    @property
    def hysteresis(self) -> list[bool]:
        """Heights at which the motion depends on the direction of the sweep, and is regular in at least one (n,)."""
        return [_differ(up, down) for up, down in zip(self.up, self.down, strict=True)]

    @staticmethod
    def from_mapping(plain: Mapping[str, Any]) -> "Column":
        """Return the column that `dataclasses.asdict` has made a mapping of, read from JSON."""
        values = dict(plain)
        values["up"], values["down"] = ([Cell(*cell) for cell in values[way]] for way in ("up", "down"))
        return Column(**values | {"best": BestHeight(**values["best"]), "stability": Stability(**values["stability"])})


def column_at(scene: Scene, place: Place, shares: Sequence[float]) -> Column:
    """Return the column at a place; shares (n,): clearances over the ballistic clearance at resonance.

    Takes beam, grain radius, contact, gravity and tolerance from the scene.
    """
    resonant = scene.with_(
        mass_fraction=place.mass_fraction, excitation={"amplitude": place.amplitude, "frequency": "resonance"}
    )
    at_resonance = DamperResponse(resonant, map_tolerance(scene))
    unit = at_resonance.ballistic_clearance(place.amplitude)
    heights = [at_resonance.diameter + share * unit for share in shares]
    if place.frequency_ratio == 1.0:
        return column_of(resonant, place.amplitude, heights)
    frequency = place.frequency_ratio * at_resonance.frequency
    return column_of(resonant.with_(frequency=frequency), place.amplitude, heights)


def column_of(scene: Scene, amplitude: float, heights: Sequence[float]) -> Column:
    """Return the column of a scene's system and frequency over rising heights (n,) [m]; amplitude: of the support."""
    damper = DamperResponse(scene, map_tolerance(scene))
    state = damper.closed_state(amplitude)
    up = sweep(damper, amplitude, state, damper.diameter, heights)
    down = sweep(damper, amplitude, state, heights[-1], heights[::-1])[::-1]
    best = _best(damper, amplitude)
    stability = (
        Stability(SearchEnding.NO_SECTION.name) if best.failure else stability_of(scene, damper, amplitude, best.height)
    )
    return Column(list(heights), damper.closed_amplitude(amplitude), up, down, best, stability)


def sweep(
    damper: DamperResponse,
    amplitude: float,
    state: State,
    present: float,
    heights: Sequence[float],
    travel: int = TRAVEL,
) -> list[Cell]:
    """Return what is seen while the ceiling goes from height to height [m], starting at `present` [m].

    amplitude: of the support [m]. state: at phase zero of the support, changed in place: each height begins where the
    one before has ended. travel: periods from height to height. After a run that fails the sweep goes on from the
    closed damper.
    """
    cells = []
    for height in heights:
        path = (0.0, present), (travel * damper.period, height)
        try:
            cells.append(_watched(damper, amplitude, state, path))
            present = height
        except NumericalFailure:
            cells.append(Cell(FAILED, math.nan, False))
            fresh = damper.closed_state(amplitude)
            state.y[:], state.n[:] = fresh.y, fresh.n
            present = damper.diameter
    return cells


def _watched(damper: DamperResponse, amplitude: float, state: State, path: tuple[tuple[float, float], ...]) -> Cell:
    """Return what is seen after the ceiling has followed a path ((t [s], h [m]), ...) and the motion has settled."""
    period = damper.period
    begin = (math.ceil(path[-1][0] / period - 1e-9) + math.ceil(_SETTLE * damper.settling())) * period
    end = begin + WATCH * period
    strobe, log = sample_series(WATCH), impact_log(_LOG)
    state.y[columns.TIME] = 0.0
    damper.advance(amplitude, state, path, Observation((begin, end), begin, period, strobe, log))
    kind = motion_type(log[: state.n[columns.IMPACTS]], begin, end, period)
    beam = strobe[columns.S_BEAM]
    variation = max(float(np.ptp(beam[parity::2])) for parity in (0, 1))
    return Cell(TYPES.index(kind), state.amplitude, variation <= _REGULAR * state.amplitude)


def _differ(one: Cell, other: Cell) -> bool:
    if FAILED in (one.type, other.type) or not (one.regular or other.regular):
        return False
    return abs(one.amplitude - other.amplitude) > SAME * max(one.amplitude, other.amplitude)


def _best(damper: DamperResponse, amplitude: float) -> BestHeight:
    try:
        found = thorough_best(damper, amplitude, _WELL)
    except NumericalFailure as error:
        return BestHeight(failure=str(error))
    return BestHeight(found.height, found.amplitude, found.reproducible, found.evaluations)
