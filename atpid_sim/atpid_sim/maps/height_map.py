# SPDX-License-Identifier: Apache-2.0
"""`HeightMap`: best heights over support amplitude and grain mass, with what they hold for, in one NPZ file."""

from __future__ import annotations

import json
import math
import os
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from atpid_sim.maps.errors import MapError
from atpid_sim.maps.identity import Identity, difference, identity_of
from atpid_sim.scene import Scene

Array = NDArray[np.float64]

#: Version of the file and of what it calls the best height (docs/selection.md).
FORMAT = 1

_GRIDS = ("heights", "beam_amplitudes", "efficiencies", "reproducible")

#: Two mass fractions this close are the same [-].
_SAME_FRACTION = 1e-9

#: No clearance is taken for less [m]: a power law needs one.
_TINY = 1e-9

_MAKE = "make one with `python -m atpid_sim map SCENE.yaml --amplitudes A0:A1:N --mass-fractions m1,m2 --out MAP.npz`"


@dataclass(frozen=True)
class MapEntry:
    """What a map says of one excitation."""

    height: float  # [m]
    amplitude: float  # half peak-to-peak of the beam there [m]
    efficiency: float  # 1 - amplitude / amplitude of the closed damper [-]


@dataclass(frozen=True)
class HeightMap:
    """Best heights; grids are (mass fractions, amplitudes)."""

    amplitudes: Array  # (n,) of the support, rising [m]
    mass_fractions: Array  # (m,) grain over total mass, rising [-]
    heights: Array  # (m, n) [m]
    beam_amplitudes: Array  # (m, n) half peak-to-peak of the beam at the best height [m]
    efficiencies: Array  # (m, n) [-]
    reproducible: NDArray[np.bool_]  # (m, n) every way to the height ends in the same motion
    identity: Identity  # the system it holds for
    tolerance: float  # relative tolerance of the runs
    source: str = "the map"  # its name in messages

    def lookup(self, amplitude: float, mass_fraction: float) -> MapEntry:
        """Return height, beam amplitude and efficiency at a support amplitude [m] and a mass fraction [-].

        Monotone cubic in the amplitude; between mass fractions a power law of the clearance, which is nearly inverse
        to the grain's mass: nothing lies outside its neighbours. Raises MapError where the map does not reach.
        """
        share, row = self._between(mass_fraction)
        lowest, highest = float(self.amplitudes[0]), float(self.amplitudes[-1])
        if not lowest <= amplitude <= highest:
            raise MapError(
                f"{self.source}: amplitude {amplitude:g} m is outside its {lowest:g} to {highest:g} m; {_MAKE}"
            )
        below, above = self._curves[row], self._curves[min(row + 1, len(self._curves) - 1)]
        left, right = below(amplitude), above(amplitude)
        diameter = 2.0 * float(self.identity["grain.radius"])
        clearances = np.maximum([left[0] - diameter, right[0] - diameter], _TINY)
        height = diameter + float(clearances[0] ** (1.0 - share) * clearances[1] ** share)
        swing, efficiency = (1.0 - share) * left[1:] + share * right[1:]
        return MapEntry(height, float(swing), float(efficiency))

    def check(self, scene: Scene) -> None:
        """Raise MapError, naming the first difference, where the map was made for another system than the scene's."""
        found = difference(self.identity, identity_of(scene))
        if found:
            raise MapError(f"{self.source}: made for {found}; {_MAKE}")
        self._between(scene.grain.mass_fraction)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the file at once or not at all: a crash leaves the old one."""
        target = Path(path)
        part = target.with_name(target.name + ".part")
        about = {"format": FORMAT, "system": self.identity, "tolerance": self.tolerance}
        grids = {name: getattr(self, name) for name in ("amplitudes", "mass_fractions", *_GRIDS)}
        try:
            with part.open("wb") as file:
                np.savez(file, about=np.array(json.dumps(about, sort_keys=True)), **grids)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, target)
        except OSError as error:
            raise MapError(f"{target}: cannot be written: {error.strerror or error}; choose another --out") from None

    @staticmethod
    def load(path: str | os.PathLike[str]) -> HeightMap:
        """Read a map; raise MapError where the file is missing, no map, damaged or of another format."""
        name = str(path)
        try:
            with Path(name).open("rb") as file, np.load(file, allow_pickle=False) as stored:
                about: dict[str, Any] = json.loads(str(stored["about"]))
                if about.get("format") != FORMAT:
                    raise MapError(
                        f"{name}: has map format {about.get('format')}, this program reads {FORMAT}; {_MAKE}"
                    )
                grids = {key: stored[key] for key in ("amplitudes", "mass_fractions", *_GRIDS)}
            made = HeightMap(
                **grids, identity=about["system"], tolerance=float(about["tolerance"]), source=Path(name).name
            )
        except FileNotFoundError:
            raise MapError(f"{name}: no such file; {_MAKE}") from None
        except MapError:
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
            raise MapError(f"{name}: is not a height map ({' '.join(str(error).split())[:80]}); {_MAKE}") from None
        made.validate()
        return made

    def validate(self) -> None:
        """Raise MapError where shapes, order or numbers cannot be right."""
        shape = (len(self.mass_fractions), len(self.amplitudes))
        sound = (
            self.amplitudes.ndim == self.mass_fractions.ndim == 1
            and shape[0] >= 1
            and shape[1] >= 2
            and all(getattr(self, name).shape == shape for name in _GRIDS)
            and all(np.isfinite(getattr(self, name)).all() for name in ("amplitudes", "mass_fractions", *_GRIDS))
            and bool(np.all(np.diff(self.amplitudes) > 0.0) and np.all(np.diff(self.mass_fractions) > 0.0))
        )
        if not sound:
            raise MapError(f"{self.source}: holds no whole grid of finite heights over rising amplitudes; {_MAKE}")

    @cached_property
    def _curves(self) -> list[PchipInterpolator]:
        stacked = np.stack([self.heights, self.beam_amplitudes, self.efficiencies], axis=2)
        return [PchipInterpolator(self.amplitudes, row) for row in stacked]

    def _between(self, fraction: float) -> tuple[float, int]:
        """Share of the way from the row below to the next, in the logarithm, and the row below."""
        rows = self.mass_fractions
        lowest, highest = float(rows[0]), float(rows[-1])
        if not (lowest - _SAME_FRACTION <= fraction <= highest + _SAME_FRACTION) or math.isnan(fraction):
            have = f"{lowest:g}" if lowest == highest else f"{lowest:g} to {highest:g}"
            raise MapError(f"{self.source}: mass fraction {fraction:g} is outside its {have}; {_MAKE}")
        row = int(np.clip(np.searchsorted(rows, fraction, side="right") - 1, 0, max(len(rows) - 2, 0)))
        if len(rows) == 1:
            return 0.0, 0
        share = math.log(fraction / rows[row]) / math.log(rows[row + 1] / rows[row])
        return float(np.clip(share, 0.0, 1.0)), row
