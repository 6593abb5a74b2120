# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Grain and walls by the names of their materials."""

import math
from pathlib import Path
from typing import Any

import pytest
from scipy.integrate import solve_ivp

from atpid_sim.contact.materials import MATERIALS, THESIS_MODULUS, mismatch
from atpid_sim.contact.spec import in_series
from atpid_sim.kernel_inputs import system_of
from atpid_sim.root import root
from atpid_sim.scene import Scene, SceneError, load_scene

SCENES = Path(__file__).parents[2] / "scenes"
#: Of a grain of 6 mm radius, of 7 g: of steel.
BALL: dict[str, Any] = {
    "beam": {"mass": 0.12, "frequency": 8.0, "damping_ratio": 0.01},
    "grain": {"mass_fraction": 0.056, "radius": 0.006},
}


def contact_of(made: Scene) -> Any:
    """Return the block of a law, with its own keys."""
    return made.contact


def scene(**contact: Any) -> Scene:
    return load_scene(SCENES / "standard.yaml").with_(contact={"law": "tsuji", "damping_ratio": 1.0} | contact)


@pytest.mark.parametrize("name", MATERIALS)
def test_a_name_stands_for_its_numbers(name: str) -> None:
    one = MATERIALS[name]
    named, given = scene(material=name), scene(young_modulus=one.young_modulus, poisson_ratio=one.poisson_ratio)
    assert named.to_mapping() == given.to_mapping()
    walls = contact_of(scene(material="steel", wall_material=name))
    assert (walls.wall_young_modulus, walls.wall_poisson_ratio) == (one.young_modulus, one.poisson_ratio)
    # the softer of both sets the stiffness: equal solids have half the compliance of each
    system = 1.0 / ((1.0 - one.poisson_ratio**2) / one.young_modulus)
    assert contact_of(named).hertz_stiffness(0.01) == pytest.approx(4.0 / 3.0 * 0.5 * system * 0.1)


def test_a_number_counts_more_than_a_name() -> None:
    contact = contact_of(scene(material="pom", young_modulus=1e9))
    assert (contact.young_modulus, contact.poisson_ratio) == (1e9, MATERIALS["pom"].poisson_ratio)


@pytest.mark.parametrize(("contact", "line"), [
    ({"material": "steeel"}, "contact.material: given 'steeel'; allowed: steel, .* did you mean steel"),
    ({"material": "steel", "wall_material": 3}, "contact.wall_material: given 3; allowed: steel"),
    ({"wall_material": "pom"}, "contact.young_modulus: missing"),
])  # fmt: skip
def test_what_is_no_material_is_refused_in_one_line(contact: dict[str, Any], line: str) -> None:
    with pytest.raises(SceneError, match=line):
        scene(**contact)


def test_a_modulus_of_another_material_than_the_density_is_named() -> None:
    soft = scene(young_modulus=THESIS_MODULUS, poisson_ratio=0.2).with_(**BALL)
    assert [line for line in soft.warnings() if "the thesis's contact, not that of steel" in line]
    assert not [line for line in scene(material="steel").with_(**BALL).warnings() if "not that of" in line]
    assert "not that of steel (2.07e+11 Pa)" in mismatch(7850.0, 1e9)
    # the thesis's own grain has no material's density
    assert not [line for line in load_scene(SCENES / "standard.yaml").warnings() if "not that of" in line]


@pytest.mark.parametrize("name", MATERIALS)
def test_every_material_fits_itself(name: str) -> None:
    one = MATERIALS[name]
    assert mismatch(one.density, one.young_modulus) == ""
    assert one.source.startswith(("C, ", "A, "))


def elastic(stiffness: float, mass: float, speed: float) -> tuple[float, float]:
    """Return largest force [N] and duration [s] of an elastic impact (Hertz 1882)."""
    overlap = (1.25 * mass * speed**2 / stiffness) ** 0.4
    return float(stiffness * overlap**1.5), float(2.9432752 * overlap / speed)


def test_a_wall_that_gives_way_has_the_force_of_the_integrated_pair() -> None:
    """A mass on a Hertz contact and a spring in series: scipy's integration of the true pair."""
    k, spring, mass, speed = 1e8, 2e6, 0.02, 1.5
    alone, _ = elastic(k, mass, speed)
    assert in_series(k, 1e15, mass, speed) == pytest.approx(k, rel=1e-4)
    largest, duration = elastic(in_series(k, spring, mass, speed), mass, speed)
    assert largest < alone

    def force(way: float) -> float:
        return root(lambda f: (f / k) ** (2.0 / 3.0) + f / spring - way, 0.0, 1e6) if way > 0.0 else 0.0

    run = solve_ivp(lambda t, y: [y[1], -force(y[0]) / mass], (0.0, duration), [0.0, speed], rtol=1e-8,
                    atol=1e-12, max_step=duration / 400)  # fmt: skip
    assert max(map(force, run.y[0])) == pytest.approx(largest, rel=1e-4)
    # a spring alone has half a period, and the contact that stands for it lasts 17 % longer
    largest, duration = elastic(in_series(1e15, 1e3, mass, speed), mass, speed)
    assert largest == pytest.approx(speed * math.sqrt(mass * 1e3), rel=1e-4)
    assert duration == pytest.approx(1.171 * math.pi * math.sqrt(mass / 1e3), rel=1e-3)


def test_a_scene_takes_a_wall_that_gives_way() -> None:
    plain, given = scene(material="steel"), scene(material="steel", wall_stiffness=1e6, wall_speed=2.0)
    assert given.contact.parameters(system_of(given))[0] < plain.contact.parameters(system_of(plain))[0]
    with pytest.raises(SceneError, match="contact: given wall_stiffness alone; allowed: wall_stiffness and wall_speed"):
        scene(material="steel", wall_stiffness=1e6)
