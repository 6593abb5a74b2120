# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random systems with and without what the straight model leaves out: friction on the side wall, the tip's slope.

A system is drawn as `studies.random_selection` does, with instantaneous impacts at its resonance; its height is 85 to
100 % of the clearance `direct` selects. Both runs are of `motion`, from the closed damper's steady motion, the ceiling
opened at once.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.protocol import Excitation
from atpid_sim.scene import Scene
from atpid_sim.scene.plausibility import FRICTION_LIMIT, SLOPE_LIMIT, STANDARD_GRAVITY, friction_number
from studies.planar.motion import Planar, Seen, seen, steady
from studies.random_selection import draw, scene_of

#: What is left out in which systems.
KINDS = ("friction", "slope", "both")
#: Ranges: restitution [-], friction coefficient [-], slope over the deflection [rad/m], natural frequency [Hz], side
#: clearance over the radius [-], share of the selected clearance [-], gravity along the motion of a tilted damper [g].
RESTITUTION, FRICTION, SLOPE, NATURAL = (0.05, 0.7), (0.01, 0.5), (0.3, 4.0), (4.0, 30.0)
SIDE, SHARE, TILT = (0.02, 1.0), (0.85, 1.0), (0.0, 0.95)
#: Friction coefficients and slopes drawn for each system.
_EACH = 4
#: Time constants of the closed damper that a run settles, and periods at least and at most.
_CONSTANTS, _LEAST, _MOST = 6.0, 100, 300
#: Moment of inertia over m r^2 with which a ball does not turn [-].
_UNTURNED = 1e9


class System(NamedTuple):
    """A random system."""

    planar: Planar  # at a height near the selected one, without friction and slope
    settle: int  # [periods]
    side_gravity: float  # [m/s^2]
    closed: float  # amplitude of the closed damper [m]

    def friction_ratio(self, friction: float) -> float:
        """Return how many times the limit a friction coefficient is."""
        p = self.planar
        return friction_number(friction, p.gravity, p.omega**2 * self.closed) / FRICTION_LIMIT


@dataclass(frozen=True)
class Compared:
    """One run beside that of the straight model; amplitudes over that of the closed damper."""

    kind: str
    ratio: float  # the larger of friction and slope over its limit [-]
    straight: Seen
    whole: Seen
    sliding: Seen  # with friction alone the same of a ball that does not turn
    closed: float  # amplitude of the closed damper [m]

    @property
    def effect(self) -> float:
        """What is left out makes the amplitude larger by this share of the closed damper's."""
        return (self.whole.amplitude - self.straight.amplitude) / self.closed

    @property
    def unturned(self) -> float:
        """The same, beside a ball that slides and does not turn."""
        return (self.whole.amplitude - self.sliding.amplitude) / self.closed


def planar(scene: Scene, restitution: float, height: float, side_clearance: float = 1.0) -> Planar:
    """Return a scene with the ceiling at a height [m] as a planar system without friction, slope and side gravity.

    restitution: of its instantaneous impacts [-]; side_clearance: over the radius [-].
    """
    beam, radius = scene.beam, scene.grain.radius
    return Planar(
        beam.mass, scene.grain_mass, beam.stiffness, beam.damping, scene.excitation.largest_amplitude,
        2.0 * math.pi * scene.frequency_hz, scene.gravity, 0.0, height - 2.0 * radius, side_clearance * radius, radius,
        restitution, 0.0, 0.0,
    )  # fmt: skip


def systems(count: int, seed: int) -> Iterator[System]:
    """Yield random systems: every other one upright, the others lying or tilted."""
    random = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    for number, one in enumerate(draw(count, seed)):
        along = (1.0, 0.0, 1.0, float(random.uniform(*TILT)))[number % 4]
        system = replace(
            one, law="impact", ratio=1.0, gravity=along * STANDARD_GRAVITY, natural=log(*NATURAL),
            restitution=float(random.uniform(*RESTITUTION)),
        )  # fmt: skip
        scene = scene_of(system)
        best = DirectSelector(scene).select(Excitation(scene.excitation.largest_amplitude)).height
        diameter = 2.0 * scene.grain.radius
        height = diameter + float(random.uniform(*SHARE)) * (best - diameter)
        p = planar(scene, system.restitution, height, log(*SIDE))
        settle = round(min(max(_CONSTANTS / (2.0 * math.pi * system.damping_ratio), _LEAST), _MOST))
        side = math.sqrt(1.0 - along**2) * STANDARD_GRAVITY
        yield System(p, settle, side, abs(steady(p, p.beam + p.ball)))


def compared(system: System, seed: Sequence[int], steps: int) -> list[Compared]:
    """Return what is found in a system, with so many steps a period and numbers drawn by the seed."""
    random = np.random.default_rng(seed)
    straight, found = seen(system.planar, system.settle, steps), []
    for number in range(_EACH):
        # upright: slope; lying or tilted: friction, and in one of four both
        kind = "slope" if not system.side_gravity else "friction" if number < _EACH - 1 else "both"
        friction, slope = (float(np.exp(random.uniform(*np.log(limits)))) for limits in (FRICTION, SLOPE))
        slope = slope if kind != "friction" else 0.0
        one = system.planar._replace(friction=friction, slope=slope, side_gravity=system.side_gravity)
        whole = seen(one, system.settle, steps)
        sliding = seen(one._replace(inertia=_UNTURNED), system.settle, steps) if kind == "friction" else whole
        ratio = max(system.friction_ratio(friction), slope * system.closed / SLOPE_LIMIT)
        found.append(Compared(kind, ratio, straight, whole, sliding, system.closed))
    return found


def changes(coarse: Sequence[Compared], fine: Sequence[Compared]) -> list[float]:
    """Return how far the effects differ between two steps, where all motions are regular."""
    return [
        abs(two.effect - one.effect)
        for one, two in zip(coarse, fine, strict=True)
        if all(run.regular for run in (one.straight, one.whole, two.straight, two.whole))
    ]


#: Bands of the number over its limit, by their upper ends.
BANDS = ((1.0, "within the limit"), (2.0, "up to 2 times"), (5.0, "up to 5 times"), (math.inf, "beyond"))
#: Two points of efficiency.
_POINTS = 0.02


def table(found: Sequence[Compared]) -> str:
    """Return the table, as Markdown."""
    lines = [
        "| left out | over its limit | regular | within 2 points | median, 95 % [points] | 2 points more | sliding "
        "alone, within 2 | irregular | 2 points more |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        least = 0.0
        for most, name in BANDS:
            band = [one for one in found if one.kind == kind and least <= one.ratio < most]
            lines.append(f"| {kind} | {name} | {_row(band, kind)} |")
            least = most
    return "\n".join(lines)


def _row(band: Sequence[Compared], kind: str) -> str:
    regular = np.array([one.effect for one in band if one.straight.regular])
    other = np.array([one.effect for one in band if not one.straight.regular])
    sliding = np.array([one.unturned for one in band if one.straight.regular])
    spread = "{:.2f}, {:.1f}".format(*np.quantile(100.0 * np.abs(regular), (0.5, 0.95))) if len(regular) else "-"
    cells = (
        f"{len(regular)}", _share(np.abs(regular) < _POINTS), spread, _share(regular >= _POINTS),
        _share(np.abs(sliding) < _POINTS) if kind == "friction" else "-", f"{len(other)}", _share(other >= _POINTS),
    )  # fmt: skip
    return " | ".join(cells)


def _share(where: np.ndarray) -> str:
    return f"{100.0 * float(np.mean(where)):.1f} %" if len(where) else "-"
