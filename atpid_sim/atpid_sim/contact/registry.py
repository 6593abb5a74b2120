# SPDX-License-Identifier: Apache-2.0
"""From a scene's contact block to the number and the parameters of its law."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from atpid_sim.contact import dispatch, hertz, impact, kuwabara_kono, lee_herrmann, linear, tsuji, walton_braun
from atpid_sim.contact.ids import BY_NAME
from atpid_sim.scene import Scene
from atpid_sim.scene.contact import LEAST_LINEAR, ElasticContact
from atpid_sim.system import reduced_mass, system_of

#: Each law a scene can name, and what it is.
LAWS: dict[str, str] = {
    "impact": impact.DESCRIPTION,
    "linear": linear.DESCRIPTION,
    "hertz": hertz.DESCRIPTION,
    "lee_herrmann": lee_herrmann.DESCRIPTION,
    "kuwabara_kono": kuwabara_kono.DESCRIPTION,
    "tsuji": tsuji.DESCRIPTION,
    "walton_braun": walton_braun.DESCRIPTION,
}


class Contact(NamedTuple):
    """A law by its number (`ids.py`) and its parameters (6,) as that law's file lists them; numba kernels take it."""

    law: int
    parameters: NDArray[np.float64]


def contact_of(scene: Scene) -> Contact:
    """Return the contact a scene describes."""
    law = scene.contact.law
    parameters = np.zeros(6)
    given = _PARAMETERS[law](scene)
    parameters[: len(given)] = given
    return Contact(BY_NAME[law], parameters)


def restitution_of(contact: Contact, speed: float, mass: float) -> float:
    """Return the restitution [-] of an impact at `speed` [m/s] with the reduced `mass` [kg]."""
    return float(dispatch.restitution(contact.law, float(speed), float(mass), contact.parameters))


def hertz_stiffness(spec: ElasticContact, radius: float) -> float:
    """Return k_c [N/m^1.5] of a sphere of `radius` [m] on a flat wall (equations 3.14 and 3.27)."""
    wall_modulus = spec.wall_young_modulus or spec.young_modulus
    wall_ratio = spec.poisson_ratio if spec.wall_poisson_ratio is None else spec.wall_poisson_ratio
    compliance = (1.0 - wall_ratio**2) / wall_modulus + (1.0 - spec.poisson_ratio**2) / spec.young_modulus
    return 4.0 / 3.0 / compliance * math.sqrt(radius)


def _impact(scene: Scene) -> tuple[float, ...]:
    return (_spec(scene).restitution,)


def _linear(scene: Scene) -> tuple[float, ...]:
    spec = _spec(scene)
    if spec.damping is not None:
        return spec.stiffness, spec.damping
    mass = reduced_mass(system_of(scene))
    return spec.stiffness, 2.0 * damping_ratio_for(spec.restitution) * math.sqrt(spec.stiffness * mass)


def damping_ratio_for(restitution: float) -> float:
    """Return the damping ratio [-] of a linear contact with this restitution [-], from 1e-12 to 1.

    Raises ValueError for any other.
    """
    if not LEAST_LINEAR <= restitution <= 1.0:
        raise ValueError(f"restitution: given {restitution:g}; allowed: from {LEAST_LINEAR:g} to 1; law impact takes 0")
    if restitution == 1.0:
        return 0.0

    def excess(log_zeta: float) -> float:
        return math.log(linear.damped_restitution(math.exp(log_zeta))) - math.log(restitution)

    # far beyond critical damping the restitution is 1 / (2 zeta)^2
    heaviest = max(5.5, 0.1 - 0.5 * math.log(4.0 * restitution))
    return math.exp(brentq(excess, -40.0, heaviest, xtol=1e-14))


def _hertz(scene: Scene) -> tuple[float, ...]:
    return (hertz_stiffness(_spec(scene), scene.grain.radius),)


def _damped_hertz(scene: Scene) -> tuple[float, ...]:
    return hertz_stiffness(_spec(scene), scene.grain.radius), _spec(scene).damping


def _tsuji(scene: Scene) -> tuple[float, ...]:
    k = hertz_stiffness(_spec(scene), scene.grain.radius)
    return k, 2.0 * _spec(scene).damping_ratio * math.sqrt(k * scene.grain_mass)


def _walton_braun(scene: Scene) -> tuple[float, ...]:
    spec = _spec(scene)
    unloading = spec.unloading_stiffness or spec.stiffness / spec.restitution**2
    return spec.stiffness, unloading


def _spec(scene: Scene) -> Any:
    return scene.contact


_PARAMETERS: dict[str, Callable[[Scene], tuple[float, ...]]] = {
    "impact": _impact,
    "linear": _linear,
    "hertz": _hertz,
    "lee_herrmann": _damped_hertz,
    "kuwabara_kono": _damped_hertz,
    "tsuji": _tsuji,
    "walton_braun": _walton_braun,
}
