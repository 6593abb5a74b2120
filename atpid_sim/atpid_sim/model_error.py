# SPDX-License-Identifier: Apache-2.0
"""What a rung that leaves the contact's depth out costs in amplitude: the depth, as a share of the swing.

Measured against `soft` on random scenes of every law with E from 2e5 to 2e11 Pa, where both are reproducible: 0.5 times
the depth of an impact over the swing is above the error of `impact` in 95 of 100, twice the overlap of a grain that is
shaken without play above that of one mass in 9 of 10 (docs/decisions/0009-fidelity.md). Where the two models settle on
different motions the error has no bound.
"""

from __future__ import annotations

import math

from scipy.optimize import brentq

from atpid_sim.contact import contact_of, dispatch
from atpid_sim.engine.release import resting_overlap
from atpid_sim.run import drive_table, undamped_amplitude
from atpid_sim.scene import HarmonicExcitation, Scene
from atpid_sim.system import reduced_mass, system_of

_IMPACT, _CLOSED = 0.5, 2.0
#: In a decay, a sweep or a measured series the errors of impacts add up instead of settling; a grain heavier than a
#: quarter of all has more of the motion.
_PASSING, _HEAVY = 4.0, 4.0
#: Logarithms of the least and largest depth [m] that is looked for.
_SHALLOW, _DEEP = -60.0, 10.0


def impact_error(scene: Scene) -> float:
    """Return the relative amplitude error to expect of instantaneous impacts, at most 1."""
    swing = _swing(scene)
    if not swing > 0.0:
        return 1.0
    more = max(1.0, _HEAVY * scene.grain.mass_fraction)
    if not isinstance(scene.excitation, HarmonicExcitation):
        more *= _PASSING
    return min(1.0, more * _IMPACT * _depth(scene, _omega(scene) * swing) / swing)


def closed_error(scene: Scene) -> float:
    """Return the relative amplitude error to expect of the closed damper as one mass, at most 1."""
    swing = _swing(scene)
    law, p = contact_of(scene)
    push = scene.grain_mass * (_omega(scene) ** 2 * swing + scene.gravity)
    return min(1.0, _CLOSED * resting_overlap(law, p, push, 1e-3) / swing) if swing > 0.0 else 1.0


def _swing(scene: Scene) -> float:
    """Return the beam's amplitude with the damper closed [m]."""
    return undamped_amplitude(scene, drive_table(scene, scene.steady_window))


def _omega(scene: Scene) -> float:
    return 2.0 * math.pi * scene.frequency_hz


def _depth(scene: Scene, speed: float) -> float:
    """Return the overlap [m] that takes up an impact at `speed` [m/s]."""
    law, p = contact_of(scene)
    kinetic = 0.5 * reduced_mass(system_of(scene)) * speed * speed

    def excess(log_depth: float) -> float:
        depth = math.exp(log_depth)
        return float(dispatch.energy(law, depth, depth, p)) - kinetic

    if not excess(_SHALLOW) < 0.0:
        return 0.0
    return math.inf if excess(_DEEP) < 0.0 else math.exp(brentq(excess, _SHALLOW, _DEEP, xtol=1e-6, rtol=1e-6))
