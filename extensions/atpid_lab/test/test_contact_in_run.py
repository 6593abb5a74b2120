# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restitution and modulus are recovered from simulated runs of the damper, within their error bars."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from recorded import Capture, refused

from atpid_control.analysis.signals import Signals
from atpid_control.cli import main
from atpid_lab.contact.drop import ContactFit
from atpid_lab.contact.estimate import ContactError, pressed
from atpid_lab.contact.flights import flights_of
from atpid_lab.contact.in_run import fit_run
from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import laser_of
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.system import Array, System, reduced_mass

BAGS = Path(__file__).parents[3] / "bags"
#: Standard deviations of what is stated: height [m], logarithm of the grain's mass.
HEIGHT, MASS = 1e-4, 0.005
#: The effective modulus and the restitution of the recorded bags (docs/contact.md).
MODULUS, RESTITUTION = 2.1e8 / (2.0 * 0.96), 0.14625


def shaken(contact: dict[str, object], height: float, amplitude: float = 0.015, seconds: float = 6.0) -> Scene:
    """Return the thesis's damper with another contact, between walls that stand still."""
    return scene_from_mapping({
        "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
        "grain": {"mass_fraction": 0.1, "radius": 0.0085},
        "contact": contact, "excitation": {"amplitude": amplitude, "frequency": "resonance"},
        "ceiling": {"height": height}, "gravity": 9.81, "duration": seconds, "tolerance": 1e-4,
        "sensors": {"laser": {"rate": 1000.0, "noise": 20.0e-6}},
    }, source="test", folder=BAGS)  # fmt: skip


def motion(scene: Scene) -> Array:
    """Return support, beam and grain of a run of the scene (n, 3) [m]."""
    truth = Plant(scene).advance(round(scene.duration * 1000), 1000.0, Plant(scene).height, 0.0)
    return np.stack([truth.support, truth.beam, truth.grain], axis=1)


def fit_of(read: Array, above: float, system: System) -> ContactFit:
    """Fit what was read of support and beam, with a height above the grain [m]; NaN: it is out of reach."""
    flights = flights_of(Signals(1000.0, read[:, 0], read[:, 1]), system)
    return fit_run(flights, np.full(len(flights.number), above), system, HEIGHT)


def fitted(scene: Scene, rng: np.random.Generator, step: float = 5e-6) -> ContactFit:
    """Return what a run of the scene determines, read in steps [m], height and mass stated with errors."""
    read = step * np.round(laser_of(scene).read(int(rng.integers(1 << 30)), motion(scene)[:, :2]) / step)
    system = system_of(scene)
    system = system._replace(grain_mass=system.grain_mass * math.exp(MASS * rng.standard_normal()))
    return fit_of(read, Plant(scene).height - 2.0 * system.radius + HEIGHT * rng.standard_normal(), system)


def drawn(rng: np.random.Generator, law: str, seconds: float) -> tuple[Scene, float]:
    """Return a scene with a contact, a height and an amplitude by chance, and the contact's effective modulus [Pa]."""
    e, modulus = rng.uniform(0.2, 0.9), 10.0 ** rng.uniform(7.5, 9.0)
    damping = 0.5 * math.sqrt(5.0 * 0.9) * damping_ratio_for(e)
    contact: dict[str, object] = {"law": law, "restitution": e}
    if law == "tsuji":
        contact = {"law": law, "young_modulus": 1.92 * modulus, "poisson_ratio": 0.2, "damping_ratio": damping}
    elif law == "walton_braun":
        contact["stiffness"] = 10.0 ** rng.uniform(5.5, 7.0)
    return shaken(contact, rng.uniform(0.25, 0.6), rng.uniform(0.01, 0.02), seconds), modulus


@pytest.mark.parametrize("law", ["impact", "tsuji", "walton_braun"])
def test_restitution_and_modulus_lie_within_their_error_bars(law: str) -> None:
    """Of 3 draws with 95 % each, two outside are once in 140; an interval of 5 % would be of no use."""
    rng = np.random.default_rng(3)
    inside, modulus_inside, widths = [], [], []
    for _ in range(3):
        scene, modulus = drawn(rng, law, 4.0)
        fit = fitted(scene, rng)
        truth = restitution_of(contact_of(scene), fit.at_speed, reduced_mass(system_of(scene)))
        inside.append(fit.restitution.low <= truth <= fit.restitution.high)
        modulus_inside.append(fit.modulus is None or fit.modulus.low <= modulus <= fit.modulus.high)
        widths.append((fit.restitution.high - fit.restitution.low) / truth)
    assert sum(inside) >= 2
    assert law != "tsuji" or sum(modulus_inside) >= 2
    assert np.median(widths) < 0.02


def test_flights_from_floor_to_floor_need_no_ceiling() -> None:
    scene = shaken({"law": "impact", "restitution": 0.5}, 3.0, amplitude=0.005, seconds=8.0)
    truth = motion(scene)
    assert np.max(truth[:, 2] - truth[:, 1]) < 2.9  # the ceiling is out of reach
    fit = fit_of(laser_of(scene).read(4, truth[:, :2]), math.nan, system_of(scene))
    assert fit.restitution.low <= 0.5 <= fit.restitution.high
    assert fit.restitution.high - fit.restitution.low < 0.01


def test_a_wrong_height_is_found() -> None:
    scene = shaken({"law": "impact", "restitution": 0.6}, 0.3)
    with pytest.raises(ContactError, match=r"height.*wrong.*impacts"):
        fit_of(motion(scene), 0.3 - 0.017 + 0.005, system_of(scene))


@pytest.mark.parametrize(("contact", "height"), [
    ({"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0}, 0.1),  # sticks
    ({"law": "impact", "restitution": 0.15}, 0.017),  # closed
])  # fmt: skip
def test_a_motion_without_clear_flights_is_refused(contact: dict[str, object], height: float) -> None:
    with pytest.raises(ContactError, match=r"impacts?\b"):
        fitted(shaken(contact, height, seconds=2.0), np.random.default_rng(2))


def test_a_recorded_run_through_the_command(tmp_path: Path, capsys: Capture) -> None:
    for bag in ("thesis_4_3_short", "rumble"):
        out = tmp_path / f"{bag}.yaml"
        assert main(["calibrate", "contact", str(BAGS / bag), "--json", "--out", str(out)]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["restitution"]["low"] <= RESTITUTION <= found["restitution"]["high"]
        assert found["modulus"]["low"] <= MODULUS <= found["modulus"]["high"]
        assert found["damping_ratio"] == pytest.approx(1.0, rel=0.02)
        assert "law: tsuji" in out.read_text(encoding="utf-8")


def test_a_moving_ceiling_gives_no_flight(capsys: Capture) -> None:
    command = ["calibrate", "contact", BAGS / "thesis_4_3_short", "--from", "4.6", "--to", "6.0"]
    refused(capsys, command, "ceiling", " 10")


def test_a_push_changes_the_restitution_of_no_elastic_impact() -> None:
    """Elastic: by energy and time reversal; else the push shortens the impact before the damper has done its work."""
    assert pressed(1.0)[0] == pytest.approx(0.0, abs=0.01)
    assert pressed(0.5)[0] > 0.5
