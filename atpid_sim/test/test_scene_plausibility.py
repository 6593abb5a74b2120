# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Values that are possible but unusual: named with their usual range, never refused."""

from pathlib import Path
from typing import Any

import pytest

from atpid_sim.scene import Scene, load_scene

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml")
#: Fractions of grain for which the thesis kept the radius: denser than any metal.
DENSE = {"stepped_4_8_phi_0_2": "31660", "stepped_4_8_phi_0_3": "54280"}


@pytest.mark.parametrize("name", [path.stem for path in sorted(SCENES.glob("*.yaml"))])
def test_the_shipped_scenes_are_usual_but_for_the_heavy_grains(name: str) -> None:
    warnings = load_scene(SCENES / f"{name}.yaml").warnings()
    assert len(warnings) == (name in DENSE)
    assert all(line.startswith(f"grain, density: {DENSE[name]} kg/m^3 is unusual") for line in warnings)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"amplitude": 10.0}, "excitation, amplitude: 10 m is unusual (usual: 1e-06 to 0.2 m); lengths are in metres"),
        ({"amplitude": [[0.0, 0.0], [1.0, 0.3]]}, "excitation, amplitude: 0.3 m"),
        (
            {"ceiling": {"closed": 0.017, "open": 200.0, "start": 6.0, "end": 7.0}},
            "ceiling, largest height: 200 m is unusual (usual: at most 3 m); lengths are in metres",
        ),
        ({"mass_fraction": 0.24}, "grain, density: 39990 kg/m^3"),
        ({"grain": {"mass_fraction": 0.1, "radius": 0.0001}}, "grain.radius: 0.0001 m"),
        ({"beam": {"mass": 325.8, "stiffness": 427.6, "damping": 0.56}}, "beam, static deflection: 8.305 m"),
        ({"beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 28.0}}, "beam.damping, as a damping ratio: 1.125 is"),
        ({"beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.0}}, "beam.damping, as a damping ratio: 0 is"),
        ({"beam": {"mass": 0.3258, "stiffness": 4.276e8, "damping": 560.0}}, "beam, resonance with the damper closed"),
        ({"gravity": 981.0}, "gravity: 981 m/s^2"),
        ({"frequency": 5470.0}, "excitation.frequency over the resonance: 1000"),
        ({"steady_window": [15.9, 16.0]}, "steady_window, in periods: 0.547 is unusual (usual: at least 2)"),
        ({"sensors": {"laser": {"rate": 40.0}}}, "sensors.laser.rate, samples a period: 7.313"),
        ({"sensors": {"laser": {"noise": 0.02}}}, "sensors.laser.noise over the amplitude: 2 is"),
        ({"excitation": {"free": {"deflection": -20.0}}}, "excitation.free.deflection: 20 m"),
        (
            # 0.3 x 9.80665 over omega^2 X = 262.7 m/s^2
            {"container": {"side_friction": 0.3}, "gravity": 0.0},
            "container.side_friction, deceleration over the closed damper's acceleration: 0.0112 is unusual (usual: at",
        ),
        (
            # a beam of 0.4 m: 1.5 / 0.4 x 0.2224 m
            {"container": {"slope": 3.75}},
            "container.slope, rotation at the closed damper's amplitude: 0.834 rad is unusual (usual: at most 0.03 rad",
        ),
    ],
)
def test_an_unusual_value_is_named(changes: dict[str, Any], line: str) -> None:
    warnings = STANDARD.with_(**changes).warnings()
    assert [warning for warning in warnings if warning.startswith(line)], warnings
    assert all("\n" not in warning for warning in warnings)


def test_friction_counts_with_what_of_gravity_is_not_along_the_motion() -> None:
    rubs = {"side_friction": 0.3}
    assert STANDARD.with_(container=rubs).warnings() == []
    assert len(STANDARD.with_(container=rubs, gravity=5.0).warnings()) == 1
    # at three times the amplitude a third of the acceleration; at the least amplitude of a profile it is largest
    assert STANDARD.with_(container=rubs, gravity=0.0, amplitude=0.03).warnings() == []
    assert len(STANDARD.with_(container=rubs, gravity=0.0, amplitude=[[0.0, 0.01], [1.0, 0.03]]).warnings()) == 1


def test_a_ceiling_that_a_controller_moves_too_fast(tmp_path: Path) -> None:
    ceiling = {"closed": 0.017, "range": [0.017, 17.0], "speed": 300.0, "controller": "direct"}
    warnings = STANDARD.with_(ceiling=ceiling).warnings()
    assert [warning.split(":")[0] for warning in warnings] == ["ceiling, largest height", "ceiling.speed"]


def test_no_excitation_no_gravity_are_usual() -> None:
    still: Scene = STANDARD.with_(amplitude=0.0, gravity=0.0)
    assert still.warnings() == []
