# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How often the motion of a design comes back after structure and grain are kicked (`atpid_sim.periodic.basin`)."""

from atpid_design.make import Design
from atpid_design.problem import scene_of
from atpid_sim.periodic.basin import Starts, basin

#: A kick [m/s].
KICK = 0.1


def comes_back(made: Design) -> str:
    """Return the share of kicks of `KICK` after which the given structure's motion comes back, where fewest do.

    At each amplitude of the design, at its height. Raises NumericalFailure.
    """
    found = [
        basin(scene_of(made.problem, made.mass_fraction, one.amplitude, one.height, frequency=one.frequency),
              Starts(KICK))
        for one in made.points
    ]  # fmt: skip
    come = [one for one in found if one.starts]
    none = f"no steady motion at {len(found) - len(come)} of {len(found)} amplitudes" if len(come) < len(found) else ""
    if not come:
        return none
    least = min(come, key=lambda one: (one.share, -one.times[2]))
    text = f"{100 * least.share:.1f} % ({100 * least.low:.1f} to {100 * least.high:.1f} %) of kicks of {KICK:g} m/s"
    late = f", 95 % within {least.times[2]:.2g} s" if least.share >= 0.95 else ""
    scale, unit = made.problem.unit
    at = f"at a {made.problem.drive} of {scale * least.drive_amplitude:.3g} {unit}"
    return "; ".join(filter(None, [f"{text} {at}{late}", none]))
