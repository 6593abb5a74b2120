# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The best height, and maps of it: every point by itself, on all cores, kept in a journal until the map is whole.

The best height is the lowest at which the beam's amplitude is least, by whichever path the ceiling approached. The
optimum stands at a cliff: above it the motion is irregular, and what a run shows there depends on the start. So a
height counts with its *worst* amplitude over several approach paths (opened from closed at once, opened slowly,
raised from below, lowered from above), where these disagree with a surcharge (docs/selection.md).

First looks choose the heights that are rated, the most promising first, and runs end as soon as their answer is due; so
what is found is the best within 0.4 %. The search runs at the cheapest fidelity level whose model error is below the
flatness of the optimum, and the height it ends at is rated again at the complete one. Where the two disagree, the
search goes on with the complete one. `studies/thorough_search.py` is the search it is measured by.
"""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np

from atpid_common.files import Document
from atpid_sim.maps.height_map import FORMAT, FORMAT_OF_RATIOS, Failure, HeightMap, MapError
from atpid_sim.maps.height_search import BELOW_RESONANCE, LAST, LAST_BELOW, WIDE, HeightSearch, promising
from atpid_sim.maps.identity import FREQUENCY, Identity, identity_of
from atpid_sim.maps.ratings import ALL_APPROACHES, Approach, Mapper
from atpid_sim.maps.response import LEAST_USE, DamperResponse
from atpid_sim.outcome import NumericalFailure
from atpid_sim.results import Labelled, in_unit
from atpid_sim.scene import Scene, SceneError
from atpid_sim.simulation.batch import Batch, Record, Workers, beside
from atpid_sim.simulation.integration import rtol_of
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.system import Array

#: Wells whose clearances differ by this factor are far apart: between them the ceiling passes heights of
#: irregular motion.
FAR = 1.1


@dataclass(frozen=True, repr=False)
class Best(Labelled):
    """A best height, what it is worth, and how far the levels agreed that it was searched and rated with."""

    height: float  # [m]
    amplitude: float  # worst half peak-to-peak of the beam over the approach paths [m]
    efficiency: float  # 1 - amplitude / amplitude of the closed damper [-]
    reproducible: bool  # all approach paths end in the same motion
    evaluations: int
    searched: str = ""  # fidelity level of the search
    checked: str = ""  # and that at which the height was rated in the end
    #: Largest of the two amplitudes where both are reproducible, relative; 0: none was; above the flatness the search
    #: went on with the latter [-].
    disagreement: float = 0.0

    labels = in_unit("m", "height amplitude")


def best_height(
    damper: DamperResponse,
    amplitude: float,
    hysteresis: float = 0.0,
    limits: tuple[float, float] = (0.0, math.inf),
    approaches: Sequence[Approach] = ALL_APPROACHES,
    mapper: Mapper = map,
) -> Best:
    """Return the best height for a support amplitude [m]. Raises NumericalFailure where a run fails.

    hysteresis: where there are several wells far apart, the lowest is kept unless another is better by more than this
    share; with 0 the deepest is taken. A map follows one well, because it is interpolated between its points.
    limits: lowest and highest height allowed [m]; approaches: paths by which the ceiling may come to a height.
    """
    wide = damper.restitution(amplitude) > WIDE
    search = HeightSearch(damper, amplitude, limits, approaches, mapper, wide=wide)
    below = damper.frequency < BELOW_RESONANCE * damper.natural_frequency
    if wide:
        wells = search.scan_widely()
        height = search.lasting()
    else:
        coarse = search.scan(damper.ballistic_clearance(amplitude), LAST_BELOW if below else LAST)
        wells = [search.nearby(coarse, k) for k in promising([value for _, value in coarse])]
        search.between()
        height = search.best(search.heights)
    if below and not wide:
        height = search.held(search.climbed(height))
    if hysteresis > 0.0:
        height = _far_below(search, wells, height, hysteresis)
    worst = search.ratings.worst(height)
    return Best(
        height=height,
        amplitude=worst,
        efficiency=efficiency(worst, damper.closed_amplitude(amplitude)),
        reproducible=search.ratings.reproducible(height),
        evaluations=search.evaluations,
        searched=search.ratings.quick.fidelity,
        checked=damper.fidelity,
        disagreement=search.ratings.disagreement,
    )


def _far_below(search: HeightSearch, wells: list[list[float]], height: float, hysteresis: float) -> float:
    """Return the best height [m] of the lowest well far below one that is not worse by `hysteresis`, or that itself."""
    limit = search.ratings.worst(height) * (1.0 + hysteresis)
    for well in sorted(wells):
        bottom = min(well, key=search.expected)
        if FAR * (bottom - search.diameter) < height - search.diameter and search.expected(bottom) <= limit:
            lower = search.best(well)
            if FAR * (lower - search.diameter) < height - search.diameter and search.expected(lower) <= limit:
                return lower
    return height


Progress = Callable[[int, int], None]
#: Where a point lies: mass fraction [-], amplitude [m], and in a map over frequencies the frequency ratio [-].
Point = tuple[float, ...]
#: The fields of `Best` at a point; None, with `failure`, where a run fails.
Values = Document
#: Runs finer than this gain nothing: best heights are told apart by 0.2 % of the amplitude.
_FINEST = 1e-5
#: A map is read between its points, so it stays in one well unless another is better by this share.
_HYSTERESIS = 0.15
#: Systems of maps whose responses are kept at most: each takes a few kilobytes.
_MOST_SYSTEMS = 1000


def build_map(
    scene: Scene,
    amplitudes: Sequence[float],
    mass_fractions: Sequence[float],
    out: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    workers: Workers | int | None = None,
    frequency_ratios: Sequence[float] | None = None,
) -> HeightMap:
    """Return the map of a scene's system over support amplitudes [m] and mass fractions [-], both rising.

    frequency_ratios: rising frequencies over the natural one [-], of which each has its own best heights; by default
    the map is for the scene's frequency. Where the damper is of no use the height is that of the closed one.

    It is written to `out`, and a run that was killed goes on where it stopped: points lie in a journal beside that
    file; without `out` it is only returned. `progress(done, total)` is called after each point. A point whose runs fail
    is NaN in the map, with the reason in `failures`. Raises MapError, JournalError, ClusterError, and NumericalFailure
    where every point fails.
    """
    wide, heavy = _rising(amplitudes, "amplitudes", 2), _rising(mass_fractions, "mass fractions", 1)
    ratios = None if frequency_ratios is None else _rising(frequency_ratios, "frequency ratios", 2)
    plan = _Plan(scene, wide, heavy, ratios)
    points = plan.points()
    report = progress or (lambda *_: None)
    record: Record[Point, Values] | None = None
    if out is not None:
        record = Record(beside(Path(out)), plan.purpose, tuple, dict, dict)
    batch = Batch(partial(_computed, plan), points)
    where = workers if isinstance(workers, Workers) else Workers(workers)
    found = batch.run(where, lambda done: report(done, len(points)), record)
    made = _assemble(plan, dict(zip(points, found, strict=True)))
    if out is not None and record is not None:
        made.save(out)
        record.finish()
    return made


@dataclass(frozen=True)
class _Plan:
    """The grid of a map, and what it is made for."""

    scene: Scene
    wide: tuple[float, ...]  # support amplitudes [m]
    heavy: tuple[float, ...]  # mass fractions [-]
    ratios: tuple[float, ...] | None  # frequencies over the natural one [-]; None: that of the scene

    def points(self) -> list[Point]:
        """Return (mass fraction, amplitude) of each point, or (mass fraction, amplitude, frequency ratio)."""
        layers: list[Point] = [()] if self.ratios is None else [(ratio,) for ratio in self.ratios]
        return [(fraction, a, *ratio) for ratio in layers for fraction in self.heavy for a in self.wide]

    @cached_property
    def tolerance(self) -> float:
        """Relative tolerance of the runs."""
        return map_tolerance(self.scene)

    @cached_property
    def identity(self) -> Identity:
        """The system, and the frequency where there is one."""
        identity = identity_of(self.scene)
        if self.ratios is not None:
            del identity[FREQUENCY]
        return identity

    @property
    def purpose(self) -> Document:
        """What the journal of the map is for."""
        version = FORMAT if self.ratios is None else FORMAT_OF_RATIOS
        return {"format": version, "system": self.identity, "tolerance": self.tolerance}

    def scene_at(self, fraction: float, ratio: float | None) -> Scene:
        """Return the scene with a mass fraction [-], at a frequency ratio [-]; raise MapError where that fails."""
        try:
            scene = self.scene.with_(mass_fraction=fraction)
            if ratio is None:
                return scene
            tone = {"amplitude": self.wide[0], "frequency": ratio * scene.natural_frequency_hz}
            return scene.with_(excitation=tone)
        except SceneError as error:
            raise MapError(f"mass fraction {fraction:g}: {error}") from None


def _computed(plan: _Plan, point: Point) -> Values:
    """Return the values of a point."""
    fraction, amplitude, *ratio = point
    return _values_at(_damper(plan, fraction, *ratio or (None,)), amplitude)


@lru_cache(_MOST_SYSTEMS)
def _damper(plan: _Plan, fraction: float, ratio: float | None) -> DamperResponse:
    """Return the response that all amplitudes of a system at a frequency have in common."""
    return DamperResponse(plan.scene_at(fraction, ratio), plan.tolerance)


def _values_at(damper: DamperResponse, amplitude: float) -> Values:
    """Return the values of a point at a support amplitude [m]: of the closed damper where an open one is of no use.

    One amplitude that cannot be simulated, as where the grain is pressed deeper into a wall than its radius, must not
    cost the others.
    """
    closed = Best(damper.diameter, damper.closed_amplitude(amplitude), 0.0, reproducible=True, evaluations=0)
    if damper.rests(amplitude):
        return asdict(closed)
    try:
        best = best_height(damper, amplitude, _HYSTERESIS)
    except NumericalFailure as error:
        lost = {"height": None, "amplitude": None, "efficiency": None, "reproducible": False, "evaluations": 0}
        return {**lost, "failure": str(error)}
    return asdict(closed if best.efficiency < LEAST_USE else best)


def map_tolerance(scene: Scene) -> float:
    """Return the relative tolerance of the runs of a scene's map: that of the scene, but no finer than is of use."""
    return max(rtol_of(scene), _FINEST)


def _assemble(plan: _Plan, known: dict[Point, Values]) -> HeightMap:
    points = plan.points()
    failed = [(point, known[point]["failure"]) for point in points if "failure" in known[point]]
    failures = tuple(Failure(fraction, amplitude, why, *ratio) for (fraction, amplitude, *ratio), why in failed)
    if len(failures) == len(points):
        raise NumericalFailure(f"none of the {len(points)} points of the map can be computed: {failures[0].reason}")
    layers = () if plan.ratios is None else (len(plan.ratios),)

    def grid(name: str) -> Array:
        made = np.array([known[point][name] for point in points], dtype=float)  # None becomes NaN
        return made.reshape(*layers, len(plan.heavy), len(plan.wide))

    return HeightMap(
        amplitudes=np.array(plan.wide),
        mass_fractions=np.array(plan.heavy),
        heights=grid("height"),
        beam_amplitudes=grid("amplitude"),
        efficiencies=grid("efficiency"),
        reproducible=grid("reproducible").astype(bool),
        identity=plan.identity,
        tolerance=plan.tolerance,
        failures=failures,
        frequency_ratios=None if plan.ratios is None else np.array(plan.ratios),
    )


def _rising(values: Sequence[float], name: str, least: int) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) < least or not np.isfinite(numbers).all() or numbers[0] <= 0.0 or (np.diff(numbers) <= 0.0).any():
        given = ", ".join(f"{value:g}" for value in numbers[:4]) + (", ..." if len(numbers) > 4 else "")
        raise MapError(f"{name}: given {given}; allowed are at least {least} rising numbers above 0")
    return numbers
