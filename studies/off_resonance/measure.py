# SPDX-License-Identifier: Apache-2.0
"""Selection off resonance against brute force: random systems, the reduction each method leaves, the best there is."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

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

    def scene(self) -> Scene:
        """Return the standard bench with these values."""
        beam = {"mass": 0.3258, "stiffness": 427.6, "damping_ratio": self.damping_ratio}
        scene = standard_bench(beam=beam).with_(mass_fraction=self.mass_fraction, amplitude=self.amplitude)
        return scene.with_(frequency=self.ratio * scene.natural_frequency_hz)


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
    return [System(k, *(float(f"{value:.4g}") for value in row)) for k, row in enumerate(rows, start=1)]


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
    closed = damper.closed_amplitude(system.amplitude)
    brute = _brute_force(damper, system.amplitude)
    heights = {name: make_selector(name, scene).select(Excitation(system.amplitude)).height for name in methods}
    rated = {name: efficiency(lasting(damper, system.amplitude, height), closed) for name, height in heights.items()}
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
    s, w = damper.system, 2.0 * math.pi * damper.frequency
    grainless = abs(complex(s.stiffness, s.damping * w) / complex(s.stiffness - s.beam_mass * w * w, s.damping * w))
    unit = math.pi * max(amplitude * grainless, damper.closed_amplitude(amplitude))
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
    heads = ["f / f_0", "A [m]", "φ", "damping ratio", "closed [m]", "brute force", *(f"`{name}`" for name in methods)]
    yield "| " + " | ".join(heads) + " |"
    yield "|" + "---|" * len(heads)
    for one in done:
        s = one.system
        cells = [
            f"{s.ratio:g}",
            f"{s.amplitude:g}",
            f"{s.mass_fraction:g}",
            f"{s.damping_ratio:g}",
            f"{one.closed:.4f}",
        ]
        cells += [_cell(one.brute, one.heights["brute force"])]
        cells += [_cell(one.reductions[name], one.heights[name]) for name in methods]
        yield "| " + " | ".join(cells) + " |"


def _cell(reduction: float, height: float) -> str:
    return f"{100.0 * reduction:.1f} % at {height:.4f}"
