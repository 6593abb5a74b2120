# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selection off resonance against brute force: random systems, the reduction each method leaves, the best there is."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from atpid_control.selection.protocol import Excitation
from atpid_control.selection.registry import make_selector
from atpid_sim.maps import FROM_CLOSED, DamperResponse, Timing
from atpid_sim.maps.approaches import Approach
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.system import Array

#: Ranges of the random systems: evenly, or in the logarithm, drawn.
RATIOS = (0.7, 1.4)  # excitation over the natural frequency [-]
_AMPLITUDES = (0.005, 0.04)  # of the support [m]
_FRACTIONS = (0.05, 0.3)  # grain over total mass [-]
_DAMPING = (0.01, 0.04)  # of the beam without grain [-]
#: Mass [kg] and stiffness [N/m] of the beam.
_MASS, _STIFFNESS = 0.3258, 427.6
#: Clearances that brute force tries, over half a period's travel of the faster of grainless beam and closed damper:
#: 2.3 % apart, and around the best few 0.4 %.
_LEAST, _MOST, _COUNT, _CLOSER, _NEAR = 0.004, 1.5, 260, 3, 5
#: After a first run at each height those within this factor of the least are run by all approaches.
_PROMISING = 1.15
#: Where the approaches differ by more than a hundredth the height pays this surcharge, as in a selection.
_AGREE, _SURCHARGE = 0.01, 1.05
_RTOL = 1e-5
#: How many of the best rated heights of brute force are run as long as those of the methods in the end: so many times
#: as long as a rating, since below resonance a transient at the edge of a cliff lasts.
_CHOSEN, _LASTING = 6, 4.0


@dataclass(frozen=True)
class System:
    """One random system and its excitation."""

    number: int
    ratio: float  # frequency over the natural one [-]
    amplitude: float  # of the support [m]
    mass_fraction: float  # [-]
    damping_ratio: float  # of the beam without grain [-]
    further: tuple[tuple[float, float, float, float], ...] = ()  # mass, frequency, damping ratio, share of the drive
    drive: str = "support"  # then `amplitude` is over the beam's stiffness, such as that of a support

    def scene(self) -> Scene:
        """Return the standard bench with these values."""
        beam = {"mass": _MASS, "stiffness": _STIFFNESS, "damping_ratio": self.damping_ratio}
        changes: dict[str, Any] = {"beam": beam}
        if self.further:
            keys = ("mass", "frequency", "damping_ratio", "drive_factor")
            modes = [dict(zip(keys, one, strict=True)) for one in self.further]
            changes |= {"further_modes": modes, "drive": self.drive}
        scene = standard_bench(**changes).with_(mass_fraction=self.mass_fraction, amplitude=self.drive_amplitude)
        return scene.with_(frequency=self.ratio * scene.natural_frequency_hz)

    @property
    def drive_amplitude(self) -> float:
        """Amplitude of the support [m] or the force [N]."""
        return self.amplitude * (_STIFFNESS if self.drive == "force" else 1.0)


@dataclass(frozen=True)
class Outcome:
    """The reductions of the closed beam's amplitude [-] at one system, and the heights [m]."""

    system: System
    reductions: dict[str, float]  # by method, rated as brute force is
    heights: dict[str, float]  # of brute force as well
    brute: float  # the largest at any height; 0 where the closed damper is best
    closed: float  # amplitude of the closed damper [m]

    def short(self, method: str) -> float:
        """By how much the reduction of a method is less than the largest [-]."""
        return self.brute - self.reductions[method]


def systems(count: int, seed: int) -> list[System]:
    """Return random systems, the same for the same seed; their frequencies cover the range evenly."""
    rng = np.random.default_rng(seed)
    ratios = RATIOS[0] + (RATIOS[1] - RATIOS[0]) * (np.arange(count) + rng.uniform(size=count)) / count
    drawn = [
        np.exp(rng.uniform(math.log(low), math.log(high), count)) for low, high in (_AMPLITUDES, _FRACTIONS, _DAMPING)
    ]
    rows = zip(ratios, *drawn, strict=True)
    rounded = ([float(f"{value:.4g}") for value in row] for row in rows)
    return [
        System(k, ratio, amplitude, share, damping) for k, (ratio, amplitude, share, damping) in enumerate(rounded, 1)
    ]


def modal_systems(count: int, seed: int) -> list[System]:
    """Return random systems of two and three modes, each second pair under a force, at most 8 % off resonance."""
    rng = np.random.default_rng(seed)
    found = []
    for one in systems(count, seed):
        ratio = 1.0 + (one.ratio - 1.0) / 5.0
        modes = [
            (_MASS * 10.0 ** rng.uniform(-0.2, 1.2), 5.5 * rng.uniform(1.5, 15.0), 10.0 ** rng.uniform(-2.3, -1.3),
             rng.uniform(-0.5, 0.5))
            for _ in range(1 + one.number % 2)
        ]  # fmt: skip
        further = tuple((m, f, d, s) for m, f, d, s in np.array([[float(f"{v:.4g}") for v in row] for row in modes]))
        drive = ("support", "force")[one.number // 2 % 2]
        found.append(replace(one, ratio=float(f"{ratio:.4g}"), further=further, drive=drive))
    return found


def compared(
    chosen: Sequence[System], methods: Sequence[str], progress: Callable[[int], None] = lambda _: None
) -> list[Outcome]:
    """Return the outcome of each system, in order; `progress` takes the number done. Raises NumericalFailure."""
    done: dict[int, Outcome] = {}
    for system, outcome in on_all_cores(lambda system: compare(system, methods), chosen):
        done[system.number] = outcome
        progress(len(done))
    return [done[system.number] for system in chosen]


def compare(system: System, methods: Sequence[str]) -> Outcome:
    """Return what methods and brute force make of one system, all of them with the ceiling opened from closed."""
    scene = system.scene()
    damper = DamperResponse(scene, _RTOL)
    amplitude = system.drive_amplitude
    closed = damper.closed_amplitude(amplitude)
    brute = _brute_force(damper, amplitude)
    heights = {name: make_selector(name, scene).select(Excitation(amplitude)).height for name in methods}
    rated = {name: efficiency(lasting(damper, amplitude, height), closed) for name, height in heights.items()}
    best = efficiency(brute[0], closed)
    rated = {name: value if heights[name] > damper.diameter else 0.0 for name, value in rated.items()}
    height = brute[1] if best > 0.0 else damper.diameter
    return Outcome(system, rated, heights | {"brute force": height}, max(best, 0.0), closed)


def lasting(damper: DamperResponse, amplitude: float, height: float) -> float:
    """Return the beam's largest amplitude [m] over the approaches to a height, once transients are long over."""
    return max(_run(damper, amplitude, height, approach, _LASTING) for approach in FROM_CLOSED)


def rating(damper: DamperResponse, amplitude: float, height: float) -> float:
    """Return the beam's largest amplitude [m] over the approaches to a height, dearer where these disagree."""
    found = [_run(damper, amplitude, height, approach) for approach in FROM_CLOSED]
    return max(found) * (1.0 if max(found) - min(found) <= _AGREE * max(found) else _SURCHARGE)


def _brute_force(damper: DamperResponse, amplitude: float) -> tuple[float, float]:
    """Return the least amplitude [m] that lasts at the best rated of all heights tried, and that height [m]."""
    if damper.rests(amplitude):
        return damper.closed_amplitude(amplitude), damper.diameter
    unit = math.pi * max(damper.bare_amplitude(amplitude), damper.closed_amplitude(amplitude))
    wide = np.geomspace(_LEAST, _MOST, _COUNT) * unit
    rated = _rated(damper, amplitude, wide)
    step = wide[1] / wide[0]
    best = sorted(rated)[:_CLOSER]
    close = [
        (height - damper.diameter) * step ** (k / (_NEAR + 1)) for _, height in best for k in range(-_NEAR, _NEAR + 1)
    ]
    rated = sorted([*rated, *_rated(damper, amplitude, np.array(close))])
    return min((lasting(damper, amplitude, height), height) for _, height in rated[:_CHOSEN])


def _rated(damper: DamperResponse, amplitude: float, clearances: Array) -> list[tuple[float, float]]:
    """Return (rating [m], height [m]) of the heights whose first run is among the best."""
    heights = [damper.diameter + float(clearance) for clearance in clearances]
    first = [_run(damper, amplitude, height, FROM_CLOSED[-1]) for height in heights]
    kept = [height for height, value in zip(heights, first, strict=True) if value <= _PROMISING * min(first)]
    return [(rating(damper, amplitude, height), height) for height in kept]


def _run(damper: DamperResponse, amplitude: float, height: float, approach: Approach, longer: float = 1.0) -> float:
    """Return the beam's amplitude [m] after an approach; longer: how many times as long as a rating it runs."""
    timing = Timing(longer * damper.settling(), longer * 16.0)
    path = approach(damper, height, 0.5 * damper.settling() * damper.period)
    return damper.follow(amplitude, path, timing).amplitude


def table_lines(done: Sequence[Outcome], methods: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the Markdown table of the outcomes, in percent and metres."""
    modal = any(one.system.further for one in done)
    heads = ["f / f_0", "A [m, N]" if modal else "A [m]", "φ", "damping ratio", "closed [m]", "brute force",
             *(f"`{name}`" for name in methods), *(["further modes: kg, Hz"] if modal else [])]  # fmt: skip
    yield "| " + " | ".join(heads) + " |"
    yield "|" + "---|" * len(heads)
    for one in done:
        s = one.system
        cells = [
            f"{s.ratio:g}",
            f"{s.amplitude:g}" if not modal else f"{s.drive_amplitude:.4g} {'N' if s.drive == 'force' else 'm'}",
            f"{s.mass_fraction:g}",
            f"{s.damping_ratio:g}",
            f"{one.closed:.4f}",
        ]
        cells += [_cell(one.brute, one.heights["brute force"])]
        cells += [_cell(one.reductions[name], one.heights[name]) for name in methods]
        if modal:
            cells.append("; ".join(f"{mass:.3g}, {frequency:.3g}" for mass, frequency, *_ in s.further))
        yield "| " + " | ".join(cells) + " |"


def _cell(reduction: float, height: float) -> str:
    return f"{100.0 * reduction:.1f} % at {height:.4f}"
