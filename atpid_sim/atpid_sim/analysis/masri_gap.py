# SPDX-License-Identifier: Apache-2.0
"""The fixed gap that Masri and Caughey's theory of two impacts a cycle gives for one amplitude of the support.

Without gravity the amplitude of the beam falls with the clearance almost up to the largest at which the symmetric
motion exists, d = 2 X_s sqrt(1 + (a / b)^2) (`two_impacts.longest_clearance`); just below it the motion loses its
stability. The gap taken is the stable one with the least amplitude. It is in proportion to the excitation, so that a
fixed gap is right at one amplitude only (On the stability of the impact damper, J. Appl. Mech. 33, 1966, 586-592).
"""

import math
from dataclasses import dataclass, replace

from atpid_sim.analysis.two_impacts import Symmetric, TwoImpacts, longest_clearance, symmetric_motions
from atpid_sim.system import System

#: Clearances tried, as shares of the longest.
_STEP, _COUNT = 0.005, 80


@dataclass(frozen=True)
class MasriGap:
    """The gap, over the support's amplitude, and what the theory predicts there."""

    clearance: float  # gap less grain diameter, over the support's amplitude [-]
    peak: float  # largest displacement of the beam over the support's amplitude [-]
    multiplier: float  # largest modulus of the return map's multipliers [-]


def masri_gap(system: System, frequency: float, restitution: float) -> MasriGap | None:
    """Return the clearance of the stable symmetric motion with the least peak; None where no motion is stable.

    frequency: of the excitation [Hz]; restitution of grain and walls [-]. Gravity is left out.
    """
    natural = math.sqrt(system.stiffness / system.beam_mass)
    ratio = 2.0 * math.pi * frequency / natural
    damping = system.damping / (2.0 * math.sqrt(system.stiffness * system.beam_mass))
    # the support drives through spring and damper: force over stiffness, for a support amplitude of one
    force = abs(complex(1.0, 2.0 * damping * ratio))
    theory = TwoImpacts(system.grain_mass / system.beam_mass, restitution, 1.0, damping, ratio)
    longest = longest_clearance(theory)
    stable = [
        MasriGap(clearance * force, motion.peak * force, motion.multiplier)
        for clearance in (longest * (1.0 - _STEP * k) for k in range(1, _COUNT))
        for motion in _motions(replace(theory, clearance=clearance))
        if motion.multiplier < 1.0
    ]
    return min(stable, key=lambda gap: gap.peak, default=None)


def _motions(theory: TwoImpacts) -> list[Symmetric]:
    """Return the symmetric motions; none where the grain of one would strike at another time than it was assumed to."""
    try:
        return symmetric_motions(theory)
    except ValueError:
        return []
