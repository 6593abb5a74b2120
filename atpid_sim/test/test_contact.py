# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact laws and materials: closed forms, published numbers, and what no law may do."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from atpid_sim.contact import dispatch as laws
from atpid_sim.contact.laws import IMPACT, LAWS, NAMES
from atpid_sim.contact.linear import damped_restitution, damping_ratio_for
from atpid_sim.contact.materials import MATERIALS, THESIS_MODULUS, mismatch
from atpid_sim.contact.spec import in_series
from atpid_sim.contact_contract import ContactLawContract
from atpid_sim.engine import columns
from atpid_sim.engine.impact_phase import collide
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import Contact, contact_of, restitution_of, system_of
from atpid_sim.root import root
from atpid_sim.scene import Scene, load_scene
from atpid_sim.system import System, reduced_mass

SCENE = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")
SPECS: dict[str, dict[str, object]] = {
    name: {"law": name, **law.Spec.example} for name, law in zip(NAMES, LAWS, strict=True)
}
SOFT = [name for name in SPECS if name != "impact"]


def contact(name: str, **changes: float) -> Contact:
    return contact_of(SCENE.with_(contact=SPECS[name] | changes))


@pytest.mark.parametrize("law", NAMES)
class TestEveryLaw(ContactLawContract):
    @pytest.fixture(autouse=True)
    def _of(self, law: str) -> None:
        self.law = law


def test_parameters_are_those_of_table_3_2() -> None:
    """k_c and c_c as printed for r = 8.5 mm and 10 % of grain; for 5 mm and 5 % likewise (the thesis misprints r)."""
    p = contact_of(SCENE).parameters
    assert p[0] == pytest.approx(1.344e7, rel=5e-4)
    assert p[1] == pytest.approx(1395.3, rel=1e-5)
    small = SCENE.with_(grain={"mass_fraction": 0.05, "radius": 0.005}, ceiling={"height": 0.1})
    assert contact_of(small).parameters[0] == pytest.approx(1.031e7, rel=5e-4)
    assert contact_of(small).parameters[1] == pytest.approx(841.0, rel=5e-4)
    rigid = contact("hertz", wall_young_modulus=1e16).parameters[0]
    assert rigid == pytest.approx(2.0 * contact("hertz").parameters[0], rel=1e-7)


def test_the_thesis_s_law_gives_0_1565_at_the_wall_and_0_1463_in_the_damper() -> None:
    system, law = system_of(SCENE), contact_of(SCENE)
    for speed in (1e-3, 1.0, 10.0):
        assert restitution_of(law, speed, system.grain_mass) == pytest.approx(0.1565, abs=5e-5)
        assert restitution_of(law, speed, reduced_mass(system)) == pytest.approx(0.1463, abs=5e-5)


@pytest.mark.parametrize(("zeta", "expected"), [(0.0, 1.0), (1.0, math.exp(-2.0)), (1e3, 0.0)])
def test_damped_restitution_at_its_ends(zeta: float, expected: float) -> None:
    assert damped_restitution(zeta) == pytest.approx(expected, abs=1e-6)
    assert damped_restitution(1.0 - 2e-9) == pytest.approx(damped_restitution(1.0 + 2e-9), rel=1e-7)


@given(st.floats(min_value=0.001, max_value=1.0))
def test_damping_found_for_a_restitution_gives_it_back(e: float) -> None:
    assert damped_restitution(damping_ratio_for(e)) == pytest.approx(e, rel=1e-9)


def test_a_hysteretic_law_given_by_its_restitution_has_it() -> None:
    law = contact_of(SCENE.with_(contact={"law": "walton_braun", "stiffness": 1e5, "restitution": 0.4}))
    assert restitution_of(law, 1.0, 1.0) == pytest.approx(0.4, rel=1e-12)


def test_restitution_depends_on_speed_as_in_the_thesis() -> None:
    """Section 3.1: it rises with speed for Lee-Herrmann, falls for Kuwabara-Kono, stays for the others."""
    speeds = np.geomspace(1e-3, 10.0, 9)
    mass = reduced_mass(system_of(SCENE))
    curve = {name: np.array([restitution_of(contact(name), speed, mass) for speed in speeds]) for name in SPECS}
    assert (np.diff(curve["lee_herrmann"]) > 0.0).all()
    assert (np.diff(curve["kuwabara_kono"]) < 0.0).all()
    for name in ("impact", "linear", "hertz", "tsuji", "walton_braun"):
        assert np.ptp(curve[name]) < 1e-12
    assert curve["hertz"][0] == 1.0


def test_walton_braun_loads_and_unloads_along_its_lines() -> None:
    law = contact("walton_braun")
    deepest = 1e-4

    def force(x: float, memory: float) -> float:
        return float(laws.force(law.law, x, 0.0, memory, law.parameters))

    dent = (1.0 - 1.0 / 3.0) * deepest
    assert force(deepest, deepest) == pytest.approx(1e5 * deepest)
    assert force(2e-4, deepest) == pytest.approx(1e5 * 2e-4)  # deeper than ever: virgin loading
    assert force(0.5 * (dent + deepest), deepest) == pytest.approx(0.5 * 1e5 * deepest)
    assert force(dent, deepest) == pytest.approx(0.0, abs=1e-9)
    assert force(0.5 * dent, deepest) < 0.0
    assert laws.detachment_velocity(law.law, 0.9 * dent, deepest, law.parameters) == math.inf
    assert laws.detachment_velocity(law.law, 1.1 * dent, deepest, law.parameters) == -math.inf
    # what unloading gives back is e^2 of what loading took
    taken = 0.5 * 1e5 * deepest**2
    assert laws.energy(law.law, deepest, deepest, law.parameters) == pytest.approx(taken / 3.0)


def velocities_after(m1: float, m2: float, v1: float, v2: float, e: float) -> tuple[float, float]:
    """Velocities of a beam and a grain of these masses after the impact on the wall towards which the grain moves."""
    state = State.resting(0.0, 0.0)
    state.y[[columns.BEAM_VELOCITY, columns.GRAIN_VELOCITY]] = v1, v2
    state.n[columns.MODE] = columns.ON_FLOOR if v1 > v2 else columns.ON_CEILING
    row = np.zeros(columns.DRIVE_COLUMNS)
    row[[columns.END, columns.HEIGHT]] = 1.0, 1.0
    system = System(m1, m2, 1.0, 0.0, 0.0, 0.01)
    collide(state.y, state.n, row, 0.0, system, IMPACT, np.array([e, 0.0, 0.0, 0.0, 0.0, 0.0]), 0)
    return state.beam_velocity, state.grain_velocity


@given(st.floats(0.01, 10.0), st.floats(0.01, 10.0), st.floats(-5, 5), st.floats(-5, 5), st.floats(0, 1))
def test_an_impact_keeps_momentum_and_never_gains_energy(m1: float, m2: float, v1: float, v2: float, e: float) -> None:
    w1, w2 = velocities_after(m1, m2, v1, v2, e)
    scale = (m1 + m2) * (abs(v1) + abs(v2)) + 1e-9
    assert m1 * w1 + m2 * w2 == pytest.approx(m1 * v1 + m2 * v2, abs=1e-12 * scale)
    assert w1 - w2 == pytest.approx(-e * (v1 - v2), abs=1e-12 * scale)
    before, after = m1 * v1**2 + m2 * v2**2, m1 * w1**2 + m2 * w2**2
    assert after <= before * (1.0 + 1e-12) + 1e-300
    if e == 1.0:  # the thesis's equations 3.3 and 3.4
        assert w1 == pytest.approx(((m1 - m2) * v1 + 2.0 * m2 * v2) / (m1 + m2), abs=1e-9)
        assert after == pytest.approx(before, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", SOFT)
@settings(max_examples=30, deadline=None)
@given(
    st.floats(-3.0, 1.0),
    st.floats(-4.0, 4.0),
    st.just(0.0) | st.floats(1e-12, 5.0),  # what a scene takes as tsuji's damping ratio
    st.floats(0.001, 0.9),
)
def test_no_contact_creates_energy(name: str, log_speed: float, log_e: float, beta: float, fraction: float) -> None:
    spec = dict(SPECS[name])
    for key in ("young_modulus", "stiffness", "unloading_stiffness"):
        if key in spec:
            spec[key] = float(spec[key]) * 10.0**log_e  # type: ignore[arg-type]
    if "damping_ratio" in spec:
        spec["damping_ratio"] = beta
    scene = SCENE.with_(contact=spec, mass_fraction=fraction)
    e = restitution_of(contact_of(scene), 10.0**log_speed, reduced_mass(system_of(scene)))
    assert 0.0 <= e <= 1.0


#: Of a grain of 6 mm radius, of 7 g: of steel.
BALL: dict[str, Any] = {
    "beam": {"mass": 0.12, "frequency": 8.0, "damping_ratio": 0.01},
    "grain": {"mass_fraction": 0.056, "radius": 0.006},
}


def block_of(made: Scene) -> Any:
    """Return the block of a law, with its own keys."""
    return made.contact


def scene(**contact: Any) -> Scene:
    return SCENE.with_(contact={"law": "tsuji", "damping_ratio": 1.0} | contact)


@pytest.mark.parametrize("name", MATERIALS)
def test_a_name_stands_for_its_numbers(name: str) -> None:
    one = MATERIALS[name]
    named, given = scene(material=name), scene(young_modulus=one.young_modulus, poisson_ratio=one.poisson_ratio)
    assert named.to_mapping() == given.to_mapping()
    walls = block_of(scene(material="steel", wall_material=name))
    assert (walls.wall_young_modulus, walls.wall_poisson_ratio) == (one.young_modulus, one.poisson_ratio)
    # the softer of both sets the stiffness: equal solids have half the compliance of each
    system = 1.0 / ((1.0 - one.poisson_ratio**2) / one.young_modulus)
    assert block_of(named).hertz_stiffness(0.01) == pytest.approx(4.0 / 3.0 * 0.5 * system * 0.1)


def test_a_modulus_of_another_material_than_the_density_is_named() -> None:
    soft = scene(young_modulus=THESIS_MODULUS, poisson_ratio=0.2).with_(**BALL)
    assert [line for line in soft.warnings() if "steel" in line]
    assert {"steel", "(2.07e+11"} <= set(mismatch(7850.0, 1e9).split())
    # the thesis's own grain has no material's density
    for fitting in (scene(material="steel").with_(**BALL), SCENE):
        assert not [line for line in fitting.warnings() if "steel" in line]


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

    step = duration / 400
    run = solve_ivp(
        lambda t, y: [y[1], -force(y[0]) / mass], (0.0, duration), [0.0, speed], rtol=1e-8, atol=1e-12, max_step=step
    )
    assert max(map(force, run.y[0])) == pytest.approx(largest, rel=1e-4)
    # a spring alone has half a period, and the contact that stands for it lasts 17 % longer
    largest, duration = elastic(in_series(1e15, 1e3, mass, speed), mass, speed)
    assert largest == pytest.approx(speed * math.sqrt(mass * 1e3), rel=1e-4)
    assert duration == pytest.approx(1.171 * math.pi * math.sqrt(mass / 1e3), rel=1e-3)


def test_a_scene_takes_a_wall_that_gives_way() -> None:
    plain, given = scene(material="steel"), scene(material="steel", wall_stiffness=1e6, wall_speed=2.0)
    assert given.contact.parameters(system_of(given))[0] < plain.contact.parameters(system_of(plain))[0]
