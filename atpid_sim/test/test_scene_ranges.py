# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Numbers a scene refuses because nothing could be computed with them, and the last ones it takes."""

import copy
import math
from pathlib import Path
from typing import Any

import pytest

from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, load_scene, scene_from_mapping
from atpid_sim.simulation.simulate import simulate
from atpid_sim.system import reduced_mass

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml").to_mapping()
ELASTIC = {"young_modulus": 2.1e8, "poisson_ratio": 0.2}


def with_(**blocks: Any) -> Scene:
    """The standard scene for 2 s under a fixed ceiling; a block is changed where it is given in part."""
    mapping = copy.deepcopy(STANDARD) | {"duration": 2.0, "steady_window": [1.0, 2.0], "ceiling": {"height": 0.2}}
    for name, value in blocks.items():
        mapping[name] = mapping[name] | value if name in ("beam", "grain", "ceiling") else value
    return scene_from_mapping(mapping)


@pytest.mark.parametrize(
    ("block", "value", "expected"),
    [
        ("beam", {"mass": 5e-324}, "beam.mass: given 5e-324; allowed: from 1e-06 to 1e+06"),
        ("beam", {"stiffness": 1e308}, "beam.stiffness: given 1e+308; allowed: from 1e-06 to 1e+12"),
        (
            "beam",
            {"damping": 1e8},
            "beam.damping: given 100000000.0; allowed: at most 20000 times critical, 472",
        ),
        ("grain", {"radius": 1e-300}, "grain.radius: given 1e-300; allowed: from 1e-06 to 1e+06"),
        ("grain", {"mass_fraction": 1e-300}, "grain.mass_fraction: given 1e-300; allowed: from 1e-06 to 0.999999"),
        ("gravity", 1e300, "gravity: given 1e+300; allowed: from 0 to 10000"),
        ("duration", 1e-300, "duration: given 1e-300; allowed: from 1e-06 to 1e+09"),
        ("tolerance", 1e-300, "tolerance: given 1e-300; allowed: from 1e-13 to 0.5"),
        ("ceiling", {"height": 1e300}, "ceiling.height: given 1e+300; allowed: from 1e-06 to 1e+06"),
        (
            "excitation",
            {"free": {"deflection": 1e300}},
            "excitation.free.deflection: given 1e+300; allowed: from -1000 to",
        ),
        (
            "excitation",
            {"amplitude": 1e300, "frequency": 1.0},
            "excitation.amplitude: given 1e+300; allowed: 0, or from",
        ),
        (
            "excitation",
            {"amplitude": [[0.0, 0.0], [1e-9, 1.0]], "frequency": 1.0},
            "excitation.amplitude: given 0 m to 1 m in 1e-09 s; allowed: at most 1e+06 m/s: give the ramp more time",
        ),
        (
            "contact",
            {"law": "hertz", **ELASTIC, "young_modulus": 5e-324},
            "contact.young_modulus: given 5e-324; allowed: ",
        ),
        (
            "contact",
            {"law": "lee_herrmann", **ELASTIC, "damping": 1e300},
            "contact.damping: given 1e+300; allowed: from 0",
        ),
        (
            "contact",
            {"law": "linear", "stiffness": 1e5, "restitution": 1e-300},
            "contact.restitution: given 1e-300; allowed: from 1e-12 to 1: no finite damping stops the grain ",
        ),
        (
            "contact",
            {"law": "walton_braun", "stiffness": 1e5, "restitution": 1e-200},
            "contact.restitution: given 1e-200; allowed: from 0.0001 to 1: ",
        ),
        (
            "contact",
            {"law": "walton_braun", "stiffness": 1e5, "unloading_stiffness": 1e14},
            "contact.unloading_stiffness: given 100000000000000.0; allowed: at most 1e+08 times stiffness",
        ),
        ("sensors", {"laser": {"rate": 1e300}}, "sensors.laser.rate: given 1e+300; allowed: from 0.001 to 1e+07"),
    ],
)
def test_what_nothing_can_be_computed_with_is_refused(block: str, value: Any, expected: str) -> None:
    with pytest.raises(SceneError) as caught:
        with_(**{block: value})
    assert str(caught.value).removeprefix("scene: ").startswith(expected)


def test_a_block_holds_what_the_memory_takes() -> None:
    with pytest.raises(SceneError, match=r"recording\.block: given 100\.0; allowed: a whole number .*at most 1000000"):
        with_(sensors={"laser": {"rate": 1e6}}, recording={"block": 100.0})


def test_a_ceiling_does_not_jump() -> None:
    mapping = copy.deepcopy(STANDARD)
    mapping["ceiling"] = {"closed": 0.017, "open": 0.2, "start": 1.0, "end": 1.0 + 1e-10}
    with pytest.raises(SceneError, match=r"ceiling\.end: given 0\.017 m to 0\.2 m in 1e-10 s; allowed: at most 1e\+06"):
        scene_from_mapping(mapping)


@pytest.mark.parametrize("restitution", [1.0, 0.9, 1e-3, 4e-6, 1e-6, 1e-9, 1e-12])
def test_a_linear_contact_has_the_restitution_asked_for(restitution: float) -> None:
    scene = with_(contact={"law": "linear", "stiffness": 1e5, "restitution": restitution})
    found = restitution_of(contact_of(scene), 1.0, reduced_mass(system_of(scene)))
    assert found == pytest.approx(restitution, rel=1e-9)
    assert simulate(scene, "soft", check=False).amplitude > 0.0


@pytest.mark.parametrize("restitution", [1e-300, 0.0, -1.0, 2.0, math.nan])
def test_no_damping_ratio_for_what_is_no_restitution(restitution: float) -> None:
    with pytest.raises(ValueError, match=r"restitution: given .*; allowed: from 1e-12 to 1"):
        damping_ratio_for(restitution)


def test_the_steepest_unloading_is_integrated() -> None:
    scene = with_(contact={"law": "walton_braun", "stiffness": 1e5, "restitution": 1e-4})
    assert simulate(scene, "soft", check=False).energy_residual == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("fidelity", ["soft", "finite", "impact"])
@pytest.mark.parametrize(
    "blocks",
    [
        {"beam": {"damping": 23600.0}}, {"beam": {"damping": 5e-324}}, {"gravity": 5e-324},
        {"beam": {"mass": 1e6}}, {"beam": {"stiffness": 1e-6, "damping": 0.0}},
        {"beam": {"mass": 1e-6, "damping": 0.0}, "duration": 0.01, "steady_window": [0.0, 0.01]},
        {"grain": {"mass_fraction": 1e-6}}, {"grain": {"mass_fraction": 0.999999}}, {"grain": {"radius": 1e-6}},
        {"contact": {"law": "tsuji", **ELASTIC, "young_modulus": 1e18, "damping_ratio": 1e6}},
        {"contact": {"law": "linear", "stiffness": 1e-3, "damping": 1e9}}, {"gravity": 1e4},
    ],
    ids=str,
)  # fmt: skip
def test_the_last_numbers_allowed_end_by_name(blocks: dict[str, Any], fidelity: str) -> None:
    try:
        amplitude = simulate(with_(**blocks), fidelity, check=False).amplitude
    except NumericalFailure as failure:
        if "pressed deeper into a wall than its radius" not in str(failure):
            raise
    else:
        assert math.isfinite(amplitude)
