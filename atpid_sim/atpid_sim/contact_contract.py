# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests that every contact law must pass.

Subclass `ContactLawContract` in a test file, with the law's name; pytest then runs them on the law with the keys of its
`Spec.example`.
"""

import math

import numpy as np
import pytest
from numba import njit

from atpid_sim.contact import dispatch as laws
from atpid_sim.contact.laws import HYSTERETIC, IMPACT, LAWS, NAMES
from atpid_sim.kernel_inputs import Contact, contact_of, restitution_of, system_of
from atpid_sim.scene import standard_bench
from atpid_sim.system import Array, reduced_mass

#: Draws of each test with random numbers, and their seed.
_DRAWS, _SEED = 100, 20


@njit  # type: ignore[untyped-decorator]
def _whole_contact(law: int, p: Array, mass: float, speed: float, h: float) -> tuple[float, float]:
    """Return restitution and impulse over m v of one whole contact, by small fixed steps in t = (i h)^4.

    That makes the fractional powers at first touch smooth.
    """
    x, v, deepest, impulse = 0.0, speed, 0.0, 0.0
    for i in range(20_000_000):
        step = ((i + 1.0) ** 4 - float(i) ** 4) * h**4 if i < 2000 else 4.0 * 2000.0**3 * h**4
        force = max(0.0, laws.force(law, x, v, deepest, p))
        half_v = v - 0.5 * step * force / mass
        half_x = x + 0.5 * step * v
        force = max(0.0, laws.force(law, half_x, half_v, max(deepest, half_x), p))
        v -= step * force / mass
        x += step * half_v
        deepest = max(deepest, x)
        impulse += step * force
        if v < 0.0 and (force == 0.0 or x <= 0.0):
            break
    return -v / speed, impulse / (mass * speed)


class ContactLawContract:
    """What a law promises: force, energy, detachment and restitution belong to each other, and no energy is made."""

    law: str

    def contact(self, **changes: object) -> Contact:
        """Return the law with the keys of its example, and `changes`."""
        example = LAWS[NAMES.index(self.law)].Spec.example
        return contact_of(standard_bench(contact={"law": self.law, **example, **changes}))

    @property
    def soft(self) -> bool:
        """Whether the law has a force."""
        return NAMES.index(self.law) != IMPACT

    @pytest.mark.parametrize("speed", [0.01, 1.0, 5.0])
    def test_restitution_is_what_the_force_gives(self, speed: float) -> None:
        """`restitution` and the impulse are those of the force, integrated over a whole contact."""
        if not self.soft:
            return
        contact, mass = self.contact(), reduced_mass(system_of(standard_bench()))
        stiffness = float(laws.force(contact.law, 1e-4, 0.0, 1e-4, contact.parameters)) / 1e-4
        duration = math.sqrt(mass / stiffness) * min(1.0, (speed * math.sqrt(mass / stiffness) / 1e-4) ** -0.2)
        step = (2e-4 * duration) ** 0.25 / 2000**0.75
        found, impulse = _whole_contact(contact.law, contact.parameters, mass, speed, step)
        expected = restitution_of(contact, speed, mass)
        assert found == pytest.approx(expected, abs=3e-4)
        assert impulse == pytest.approx(1.0 + expected, abs=3e-4)

    def test_the_force_vanishes_at_the_detachment_velocity(self) -> None:
        """It is positive above, and nowhere else; an infinite one: on neither side, or on both."""
        contact, draws = self.contact(), np.random.default_rng(_SEED)
        for _ in range(_DRAWS if self.soft else 0):
            overlap, rate = 10.0 ** draws.uniform(-7.0, -3.0), draws.uniform(-5.0, 5.0)
            memory = max(draws.uniform(0.0, 2e-3), overlap)
            release = float(laws.detachment_velocity(contact.law, overlap, memory, contact.parameters))
            force = float(laws.force(contact.law, overlap, rate, memory, contact.parameters))
            if math.isinf(release):
                assert force >= 0.0 if release < 0.0 else force <= 0.0
                continue
            size = abs(float(laws.force(contact.law, overlap, 0.0, memory, contact.parameters)))
            at_release = float(laws.force(contact.law, overlap, release, memory, contact.parameters))
            assert at_release == pytest.approx(0.0, abs=1e-9 * size)
            assert (force > 0.0) == (rate > release) or force == pytest.approx(0.0, abs=1e-9 * size)

    def test_the_static_force_is_the_slope_of_the_energy(self) -> None:
        """Of the energy that the contact returns in unloading."""
        contact, draws = self.contact(), np.random.default_rng(_SEED)
        for overlap in 10.0 ** draws.uniform(-9.0, -3.0, _DRAWS if self.soft else 0):
            step = 1e-4 * overlap
            memory = overlap + step if HYSTERETIC[contact.law] else 0.0
            above, below = (
                float(laws.energy(contact.law, overlap + shift, memory, contact.parameters)) for shift in (step, -step)
            )
            force = float(laws.force(contact.law, overlap, 0.0, memory, contact.parameters))
            assert (above - below) / (2.0 * step) == pytest.approx(force, rel=1e-4)

    def test_no_contact_creates_energy(self) -> None:
        """The restitution is from 0 to 1 at any speed and mass."""
        contact, draws = self.contact(), np.random.default_rng(_SEED)
        for _ in range(_DRAWS):
            speed, mass = 10.0 ** draws.uniform(-3.0, 1.0), 10.0 ** draws.uniform(-3.0, 1.0)
            assert 0.0 <= restitution_of(contact, speed, mass) <= 1.0
