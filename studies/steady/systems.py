# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random systems: every law, weightless to the Earth's weight, nearly plastic to nearly elastic."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.root import root
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.system import reduced_mass

LAWS = ("kuwabara_kono", "walton_braun", "tsuji", "hertz", "linear", "lee_herrmann", "impact")
_GRAVITIES = (0.0, 1.62, 4.9, 9.81)
#: Restitutions, mass fractions, excitation over resonance where it is not at it, and length of the scene [periods].
_RESTITUTIONS, _FRACTIONS, _RATIOS, _LENGTHS = (0.05, 0.9), (0.02, 0.35), (0.7, 1.4), (60.0, 300.0)
#: Mass of the beam [kg], its frequency [Hz] and damping ratio without the grain.
_MASSES, _FREQUENCIES, _DAMPING = (0.05, 50.0), (1.0, 50.0), (0.003, 0.03)
#: Logarithms of further modes' masses over the beam's, and their frequencies over its.
_FURTHER_MASSES, _FURTHER_FREQUENCIES = (-0.7, 3.0), (1.3, 20.0)
#: Share of systems that a force is to drive, the largest that a scene takes [N], and factor of restitutions.
_FORCED, _LARGEST_FORCE, _LESS_LIVELY = 0.7, 1000.0, 0.5
#: Displacement of the closed beam over the grain's radius, and clearance over half a period's travel at that.
_SIZES, _CLEARANCES = (1.0, 30.0), (0.03, 0.5)
#: Modulus of the grain [Pa]; stiffness of a contact over that of the grain's mass at the beam's frequency.
_MODULI, _STIFFNESSES = (1e7, 1e11), (1e3, 1e5)
#: Radius [m] of a grain of so much mass [kg]: all have its density.
_GRAIN = (0.0085, 0.0362)
#: Logarithms of the least and largest damping of a contact.
_DAMPINGS = -12.0, 12.0


def drawn(seed: int, number: int, modal: bool = False) -> Scene:
    """Return system `number` of a seed; modal: with two to five modes, driven at the support or by a force."""
    rng = np.random.default_rng((seed, number))

    def spread(low: float, high: float) -> float:
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))

    law = LAWS[number % len(LAWS)]
    mass, frequency, damping = spread(*_MASSES), spread(*_FREQUENCIES), spread(*_DAMPING)
    fraction, restitution = float(rng.uniform(*_FRACTIONS)), float(rng.uniform(*_RESTITUTIONS))
    grain = mass * fraction / (1.0 - fraction)
    radius = _GRAIN[0] * (grain / _GRAIN[1]) ** (1.0 / 3.0)
    ratio = 1.0 if rng.random() < 0.5 else float(rng.uniform(*_RATIOS))
    size = spread(*_SIZES) * radius
    play = spread(*_CLEARANCES) * math.pi * size
    resonance = frequency * math.sqrt(1.0 - fraction)
    height, length = 2.0 * radius + play, spread(*_LENGTHS) / resonance
    opening = {"closed": 2.0 * radius, "open": height, "start": 20.0 / resonance, "end": 25.0 / resonance}
    parts: dict[str, Any] = {
        "beam": {"mass": mass, "frequency": frequency, "damping_ratio": damping},
        "grain": {"mass_fraction": fraction, "radius": radius},
        "excitation": {
            "amplitude": size * max(2.0 * damping, abs(1.0 - ratio**2)),
            "frequency": ratio * resonance,
        },
        "ceiling": opening if rng.random() < 0.5 else {"height": height},
        "gravity": _GRAVITIES[int(rng.integers(len(_GRAVITIES)))],
        "duration": length,
        "tolerance": 1e-6,
    }
    stiffness, modulus = spread(*_STIFFNESSES) * grain * (2.0 * math.pi * frequency) ** 2, spread(*_MODULI)
    speed = 2.0 * math.pi * frequency * size
    if modal:  # of lively grains nearly all motions are irregular
        restitution *= _LESS_LIVELY
        _add_modes(parts, rng)
    return scene_from_mapping(parts | {"contact": _contact(law, parts, restitution, stiffness, modulus, speed)})


def _add_modes(parts: dict[str, Any], rng: np.random.Generator) -> None:
    """Add one to four further modes, and drive the support or by a force at which the beam alone moves as far."""
    beam = parts["beam"]
    parts["further_modes"] = [
        {
            "mass": beam["mass"] * math.exp(rng.uniform(*_FURTHER_MASSES)),
            "frequency": beam["frequency"] * rng.uniform(*_FURTHER_FREQUENCIES),
            "damping_ratio": math.exp(rng.uniform(*np.log(_DAMPING))), "drive_factor": rng.uniform(-0.4, 0.4),
        }
        for _ in range(rng.integers(1, 5))
    ]  # fmt: skip
    force = parts["excitation"]["amplitude"] * beam["mass"] * (2.0 * math.pi * beam["frequency"]) ** 2
    if rng.random() < _FORCED and force <= _LARGEST_FORCE:
        parts["drive"], parts["excitation"]["amplitude"] = "force", force


def _contact(
    law: str, parts: Mapping[str, Any], restitution: float, stiffness: float, modulus: float, speed: float
) -> dict[str, Any]:
    """Return a contact of a law that has the restitution at a speed [m/s]."""
    if law == "impact":
        return {"law": law, "restitution": restitution}
    if law in ("linear", "walton_braun"):
        return {"law": law, "stiffness": stiffness, "restitution": restitution}
    elastic = {"law": law, "young_modulus": modulus, "poisson_ratio": 0.2}
    if law == "hertz":
        return elastic
    key = "damping_ratio" if law == "tsuji" else "damping"

    def excess(log_damping: float) -> float:
        scene = scene_from_mapping(dict(parts) | {"contact": elastic | {key: math.exp(log_damping)}})
        return restitution_of(contact_of(scene), speed, reduced_mass(system_of(scene))) - restitution

    low, high = _DAMPINGS
    if excess(low) < 0.0:  # of so stiff a grain the least damping already takes more
        return elastic | {key: math.exp(low)}
    return elastic | {key: math.exp(root(excess, low, high, xtol=1e-3) if excess(high) < 0.0 else high)}
