# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`HeightMap`: best heights over support amplitude and grain mass, with what they hold for, in one NPZ file."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_common.errors import InputError
from atpid_common.files import Document, FileError, read_arrays
from atpid_common.output import writing
from atpid_common.vocabulary import DRIVES
from atpid_sim.maps.curves import MapCurve, unbroken
from atpid_sim.maps.identity import FREQUENCY, Identity, difference, identity_of
from atpid_sim.modal import bare_amplitude
from atpid_sim.results import Drawn, in_unit
from atpid_sim.scene import Scene
from atpid_sim.system import Array

#: Versions of the file and of what it calls the best height (docs/selection.md): for one frequency, and over ratios.
FORMAT, FORMAT_OF_RATIOS = 1, 2

_GRIDS = ("heights", "beam_amplitudes", "efficiencies", "reproducible")
_DIMS = "frequency_ratios mass_fractions amplitudes"
#: Least mass fraction of a row [-]: no grain weighs less, and ratios of rows are numbers.
_LEAST_FRACTION = 1e-12
#: Two mass fractions this close are the same [-]; amplitudes and frequencies are, by this share.
_SAME = 1e-9
#: Size of a map's file at most, unpacked [bytes].
_LARGEST = 200_000_000
#: No frequency is so many times the natural one [-].
_MOST_RATIO = 1e3
#: No support, beam or ceiling is farther away [m].
_FARTHEST = 100.0
#: Best heights of neighbouring frequencies whose clearances differ by this factor are of different wells: the ceiling
#: would stand between them, so the lower is taken.
_SAME_WELL = 1.5
#: By how much the height at the largest amplitude may be below that at the least, and the closed damper's answer differ
#: over the amplitudes, relative [-]: a map in another order differs by much more, one that was computed by 1e-15.
_SAME_HEIGHT, _SAME_GAIN = 0.01, 0.01
#: No clearance is taken for less [m]: a power law needs one.
_TINY = 1e-9

_MAKE = "make one with `atpid map SCENE.yaml --amplitudes A0:A1:N --mass-fractions m1,m2 --out MAP.npz`"


class MapError(InputError):
    """A map that cannot be made, read or used; one line: what was given, what is allowed, what to do."""


class Failure(NamedTuple):
    """A point that could not be computed, and why."""

    mass_fraction: float  # [-]
    amplitude: float  # of the support [m]
    reason: str
    frequency_ratio: float = math.nan  # [-]; NaN: of a map for one frequency


@dataclass(frozen=True)
class MapEntry:
    """The entry of a map for one excitation."""

    height: float  # [m]
    amplitude: float  # half peak-to-peak of the beam there [m]
    efficiency: float  # 1 - amplitude / amplitude of the closed damper [-]


@dataclass(frozen=True, repr=False)
class HeightMap(Drawn):
    """Best heights; grids are (mass fractions, amplitudes), NaN where a point could not be computed.

    A map over frequencies has grids (frequency ratios, mass fractions, amplitudes).
    """

    amplitudes: Array  # (n,) of the support, rising [m], of a force [N]
    mass_fractions: Array  # (m,) grain over total mass, rising [-]
    heights: Array  # (m, n) [m]
    beam_amplitudes: Array  # (m, n) half peak-to-peak of the beam at the best height [m]
    efficiencies: Array  # (m, n) [-]
    reproducible: NDArray[np.bool_]  # (m, n) every approach path ends in the same motion
    identity: Identity  # the system it holds for
    tolerance: float  # relative tolerance of the runs
    source: str = "the map"  # its name in messages
    failures: tuple[Failure, ...] = ()  # points that could not be computed
    frequency_ratios: Array | None = None  # (k,) frequency over the natural one, rising [-]; None: for one frequency

    labels = (
        {name: ("unit" if name == "amplitudes" else "1", name) for name in _DIMS.split()}
        | in_unit("m", "heights beam_amplitudes", _DIMS)
        | in_unit("1", "efficiencies reductions reproducible", _DIMS)
    )
    drawn = ("heights",)

    @property
    def unit(self) -> str:
        """Unit of the amplitudes."""
        return DRIVES[self.identity.get("drive", "support")].unit

    @property
    def lost(self) -> str:
        """How many points could not be computed, and why the first could not, in one line; empty: none."""
        if not self.failures:
            return ""
        first = self.failures[0]
        where = f"{first.amplitude:g} {self.unit}, mass fraction {first.mass_fraction:g}"
        if self.frequency_ratios is not None:
            where += f", frequency ratio {first.frequency_ratio:g}"
        count = f"{len(self.failures)} of {self.heights.size} points could not be computed"
        return f"{count}, the first: {where}: {first.reason}"

    @property
    def reductions(self) -> Array:
        """1 - amplitude / amplitude of the structure without the damper [-], in the shape of the grids."""
        if {"further_modes.0.mass", "drive"} & self.identity.keys():
            return np.full(self.beam_amplitudes.shape, math.nan)  # one mode is not the structure
        mass, stiffness, damping = (self.identity[f"beam.{key}"] for key in ("mass", "stiffness", "damping"))
        natural = np.sqrt(stiffness * (1.0 - self.mass_fractions) / mass) / (2.0 * math.pi)
        given = self.identity.get(FREQUENCY, "resonance")
        frequencies = natural if given == "resonance" else np.full_like(natural, given)
        if self.frequency_ratios is not None:
            frequencies = np.multiply.outer(self.frequency_ratios, natural)
        bare = [bare_amplitude(mass, stiffness, damping, 1.0, frequency) for frequency in frequencies.ravel()]
        return np.asarray(1.0 - self.beam_amplitudes / (np.reshape(bare, (*frequencies.shape, 1)) * self.amplitudes))

    def lookup(self, amplitude: float, mass_fraction: float, frequency_ratio: float = 1.0) -> MapEntry:
        """Return height, beam amplitude and efficiency at a support amplitude [m] and a mass fraction [-].

        Monotone cubic in the amplitude; between mass fractions a power law of the clearance, which is nearly inverse
        to the grain's mass, and another one between frequencies over the natural one [-], where the map has several:
        nothing lies outside its neighbours. Raises MapError where the map does not reach, and where a point beside the
        amplitude could not be computed.
        """
        if self.frequency_ratios is not None:
            return self._between_frequencies(amplitude, mass_fraction, frequency_ratio)
        share, row = self._between(mass_fraction)
        amplitude = _on_grid(amplitude, self.amplitudes)
        lowest, highest = float(self.amplitudes[0]), float(self.amplitudes[-1])
        if not lowest <= amplitude <= highest:
            raise MapError(
                f"{self.source}: amplitude {amplitude:g} {self.unit} is outside its {lowest:g} to {highest:g} "
                f"{self.unit}; {_MAKE}"
            )
        # on a row of the map the other one does not matter: it may lack the point
        left, right = self._at(row + (share == 1.0), amplitude), self._at(row + (share > 0.0), amplitude)
        clearances = np.maximum([left[0] - self._diameter, right[0] - self._diameter], _TINY)
        height = self._diameter + float(clearances[0] ** (1.0 - share) * clearances[1] ** share)
        response, efficiency = (1.0 - share) * left[1:] + share * right[1:]
        return MapEntry(height, float(response), float(efficiency))

    def _between_frequencies(self, amplitude: float, mass_fraction: float, ratio: float) -> MapEntry:
        """Return the entry at a frequency ratio [-]: of neighbours in different wells the lower height."""
        assert self.frequency_ratios is not None
        ratios = self.frequency_ratios
        ratio = _on_grid(ratio, ratios)
        if not ratios[0] <= ratio <= ratios[-1]:
            reach = f"{ratios[0]:g} to {ratios[-1]:g} of the natural frequency"
            raise MapError(
                f"{self.source}: frequency at {ratio:.4g} of the natural one is outside its {reach}; {_MAKE}"
            )
        at = int(np.clip(np.searchsorted(ratios, ratio, side="right") - 1, 0, max(len(ratios) - 2, 0)))
        low = self._layers[at].lookup(amplitude, mass_fraction)
        if ratio == ratios[at]:
            return low
        high = self._layers[at + 1].lookup(amplitude, mass_fraction)
        share = float((ratio - ratios[at]) / (ratios[at + 1] - ratios[at]))
        least, most = sorted(max(entry.height - self._diameter, _TINY) for entry in (low, high))
        if most > _SAME_WELL * least and 0.0 < share < 1.0:
            height = self._diameter + least if least > _TINY else self._diameter
            worse = max(low.amplitude, high.amplitude)
            return MapEntry(height, worse, min(low.efficiency, high.efficiency))
        clearance = (low.height - self._diameter) ** (1.0 - share) * (high.height - self._diameter) ** share
        return MapEntry(
            self._diameter + max(clearance, 0.0),
            (1.0 - share) * low.amplitude + share * high.amplitude,
            (1.0 - share) * low.efficiency + share * high.efficiency,
        )

    @cached_property
    def _layers(self) -> list[HeightMap]:
        """The maps of the single frequencies."""
        assert self.frequency_ratios is not None
        layers = []
        for k, ratio in enumerate(self.frequency_ratios):
            failures = tuple(one for one in self.failures if one.frequency_ratio == ratio)
            grids = {name: getattr(self, name)[k] for name in _GRIDS}
            layers.append(replace(self, **grids, failures=failures, frequency_ratios=None))
        return layers

    @property
    def _diameter(self) -> float:
        return 2.0 * float(self.identity["grain.radius"])

    def covers(
        self, lowest: float, highest: float, mass_fraction: float, ratios: tuple[float, float] = (1.0, 1.0)
    ) -> bool:
        """Return whether every support amplitude from `lowest` to `highest` [m] can be looked up.

        ratios: lowest and highest frequency over the natural one [-]; a map for one frequency has that one alone.
        """
        if self.frequency_ratios is None and ratios[0] < ratios[1]:
            return False
        inside = [a for a in map(float, self.amplitudes) if lowest < a < highest]
        try:
            for amplitude in (lowest, *inside, highest):
                for ratio in dict.fromkeys(ratios):
                    self.lookup(amplitude, mass_fraction, ratio)
        except MapError:
            return False
        return True

    def check(self, scene: Scene) -> None:
        """Raise MapError, naming the first difference, where the map was made for another system than the scene's."""
        wanted = identity_of(scene)
        if self.frequency_ratios is not None:
            del wanted[FREQUENCY]
        found = difference(self.identity, wanted)
        if found:
            raise MapError(f"{self.source}: made for {found}; {_MAKE}")
        self.check_mass_fraction(scene.grain.mass_fraction)

    def check_mass_fraction(self, fraction: float) -> None:
        """Raise MapError where the map does not reach a mass fraction [-]."""
        self._between(fraction)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the file at once or not at all: a crash leaves the old one. Raises OutputError."""
        target = Path(path)
        part = target.with_name(target.name + ".part")
        several = self.frequency_ratios is not None
        about: Document = {"format": FORMAT_OF_RATIOS if several else FORMAT, "system": self.identity}
        about["tolerance"] = self.tolerance
        if self.failures:
            about["failures"] = [list(failure if several else failure[:3]) for failure in self.failures]
        grids = {name: getattr(self, name) for name in _stored(several)}
        with writing(target):
            with part.open("wb") as file:
                np.savez(file, about=np.array(json.dumps(about, sort_keys=True)), **grids)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, target)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> HeightMap:
        """Read a map; raise MapError where the file is missing, no map, damaged or of another format."""
        name = str(path)
        try:
            stored = read_arrays(Path(name), _LARGEST)
            about: Document = json.loads(str(stored["about"]))
            several = about.get("format") == FORMAT_OF_RATIOS
            if about.get("format") not in (FORMAT, FORMAT_OF_RATIOS):
                readable = f"{FORMAT} and {FORMAT_OF_RATIOS}"
                raise MapError(f"{name}: has map format {about.get('format')}, this program reads {readable}; {_MAKE}")
            made = HeightMap(
                **{key: _numbers(stored, key) for key in _stored(several)},  # type: ignore[arg-type]
                identity=_identity(about["system"]),
                tolerance=float(about["tolerance"]),
                source=Path(name).name,
                failures=tuple(_failure(given, several) for given in about.get("failures", ())),
            )
        except FileError as error:
            raise MapError(f"{error}; {_MAKE}") from None
        except MapError:
            raise
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise MapError(f"{name}: is not a height map ({' '.join(str(error).split())[:80]}); {_MAKE}") from None
        made.validate()
        return made

    def validate(self) -> None:
        """Raise MapError where shapes, order or numbers cannot be right."""
        shape: tuple[int, ...] = (self.mass_fractions.size, self.amplitudes.size)
        least = shape[0] >= 1 and shape[1] >= 2
        if self.frequency_ratios is not None:
            shape = (self.frequency_ratios.size, *shape)
            ratios = self.frequency_ratios
            least = least and ratios.ndim == 1 and shape[0] >= 2 and bool(np.isfinite(ratios).all())
            least = least and bool((np.diff(ratios) > 0.0).all() and ratios[0] > 0.0 and ratios[-1] <= _MOST_RATIO)
        sound = (
            self.amplitudes.ndim == self.mass_fractions.ndim == 1
            and least
            and all(getattr(self, name).shape == shape for name in _GRIDS)
            and all(np.isfinite(getattr(self, name)).all() for name in ("amplitudes", "mass_fractions"))
            and self._has_all_but_its_failures()
            and self._has_possible_values()
            and bool(np.all(np.diff(self.amplitudes) > 0.0) and np.all(np.diff(self.mass_fractions) > 0.0))
        )
        if not sound:
            raise MapError(f"{self.source}: holds no whole grid of finite heights over rising amplitudes; {_MAKE}")
        if not self._is_of_one_beam():
            wrong = "its heights fall over the amplitudes, or its efficiencies are not those of its beam amplitudes"
            raise MapError(f"{self.source}: {wrong}; {_MAKE}")

    def _has_possible_values(self) -> bool:
        """Return whether every number can be: a map in millimetres, or scaled, must not move a ceiling."""
        diameter = self._diameter
        grids = self.heights, self.beam_amplitudes, self.efficiencies
        heights, beams, shares = (grid[np.isfinite(grid)] for grid in grids)
        return bool(
            self.tolerance > 0.0
            and ((self.amplitudes > 0.0) & (self.amplitudes <= _FARTHEST)).all()
            and ((self.mass_fractions >= _LEAST_FRACTION) & (self.mass_fractions < 1.0)).all()
            and ((heights >= diameter * (1.0 - 1e-9)) & (heights <= _FARTHEST)).all()
            and ((beams >= 0.0) & (beams <= _FARTHEST)).all()
            and (shares <= 1.0).all()
        )

    def _is_of_one_beam(self) -> bool:
        """Return whether each row's heights rise on the whole, and its closed damper is linear in the amplitude."""
        with np.errstate(divide="ignore", invalid="ignore"):
            closed = self.beam_amplitudes / ((1.0 - self.efficiencies) * self.amplitudes)
        width = self.amplitudes.size
        for heights, gains in zip(self.heights.reshape(-1, width), closed.reshape(-1, width), strict=True):
            known, linear = heights[np.isfinite(heights)], gains[np.isfinite(gains)]
            if known.size and known[-1] < known[0] * (1.0 - _SAME_HEIGHT):
                return False
            if linear.size and np.ptp(linear) > _SAME_GAIN * linear.max():
                return False
        return True

    def _has_all_but_its_failures(self) -> bool:
        missing = np.zeros(self.heights.shape, dtype=bool)
        for failure in self.failures:
            row = int(np.argmin(np.abs(self.mass_fractions - failure.mass_fraction)))
            place: tuple[int, ...] = (row, int(np.argmin(np.abs(self.amplitudes - failure.amplitude))))
            if self.frequency_ratios is not None:
                place = (int(np.argmin(np.abs(self.frequency_ratios - failure.frequency_ratio))), *place)
            missing[place] = True
        grids = (self.heights, self.beam_amplitudes, self.efficiencies)
        # `reproducible` has no NaN: it is false where there is no height
        return not missing.all() and all(np.array_equal(~np.isfinite(grid), missing) for grid in grids)

    @cached_property
    def _curves(self) -> list[list[MapCurve]]:
        """For each mass fraction the curves over amplitudes without a gap."""
        stacked = np.stack([self.heights, self.beam_amplitudes, self.efficiencies], axis=2)
        return [unbroken(self.amplitudes, row) for row in stacked]

    def _at(self, row: int, amplitude: float) -> Array:
        """Return height, beam amplitude [m] and efficiency (3,) at an amplitude [m] inside the map."""
        for curve in self._curves[row]:
            if curve.first <= amplitude <= curve.last:
                return np.asarray(curve.values(amplitude))
        fraction = float(self.mass_fractions[row])
        near = min(self.failures, key=lambda one: (abs(one.mass_fraction - fraction), abs(one.amplitude - amplitude)))
        raise MapError(
            f"{self.source}: no height at amplitude {amplitude:g} {self.unit}: its point at {near.amplitude:g} "
            f"{self.unit}, mass fraction {fraction:g}, could not be computed ({near.reason})"
        )

    def _between(self, fraction: float) -> tuple[float, int]:
        """Fraction of the interval from the row below to the next, in the logarithm, and the row below."""
        rows = self.mass_fractions
        lowest, highest = float(rows[0]), float(rows[-1])
        if not (lowest - _SAME <= fraction <= highest + _SAME) or math.isnan(fraction):
            have = f"{lowest:g}" if lowest == highest else f"{lowest:g} to {highest:g}"
            raise MapError(f"{self.source}: mass fraction {fraction:g} is outside its {have}; {_MAKE}")
        row = int(np.clip(np.searchsorted(rows, fraction, side="right") - 1, 0, max(len(rows) - 2, 0)))
        if len(rows) == 1:
            return 0.0, 0
        share = math.log(fraction / rows[row]) / math.log(rows[row + 1] / rows[row])
        return float(np.clip(share, 0.0, 1.0)), row


def _on_grid(value: float, grid: Array) -> float:
    """Return the point of `grid` (n,) that `value` is but for rounding, else `value`."""
    near = float(grid[np.argmin(np.abs(grid - value))])
    return near if abs(value - near) <= _SAME * near else value


def _stored(several: bool) -> tuple[str, ...]:
    """Return the names of a file's arrays; several: over frequency ratios."""
    return ("amplitudes", "mass_fractions", *_GRIDS, *(["frequency_ratios"] if several else []))


def _failure(given: list[float | str], several: bool) -> Failure:
    """Return a point that could not be computed, as it is in a file; raise ValueError or TypeError for another."""
    fraction, amplitude, reason, *ratio = given
    if len(ratio) != several:
        raise ValueError(f"{len(given)} values of a failure")
    return Failure(float(fraction), float(amplitude), str(reason), *map(float, ratio))


def _numbers(stored: dict[str, NDArray[np.generic]], key: str) -> NDArray[np.generic]:
    """Return an array of real numbers, or of truth values for `reproducible`; raise ValueError for another."""
    array = stored[key]
    if key == "reproducible":
        if array.dtype.kind != "b":
            raise ValueError(f"{key} is of type {array.dtype}")
        return array
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{key} is of type {array.dtype}")
    return array.astype(np.float64)


def _identity(given: object) -> Identity:
    """Return the system a map holds for; raise ValueError where it has no grain radius, or values of another type."""
    if not isinstance(given, dict) or not all(isinstance(value, str | int | float) for value in given.values()):
        raise ValueError("system is no table of numbers and words")
    if not 0.0 < float(given["grain.radius"]) <= _FARTHEST:
        raise ValueError(f"grain.radius is {given['grain.radius']}")
    return given
