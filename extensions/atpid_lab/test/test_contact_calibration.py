# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restitution and modulus are recovered from drop tests made by code of their own, within their error bars."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands_run import answered, printed, refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from atpid_lab.contact.drop import Impacts, fit_drop
from atpid_lab.contact.estimate import pulse, stiffness
from atpid_sim.scene import load_scene
from atpid_sim.system import Array

G, MASS, RADIUS, MODULUS = 9.81, 0.02, 0.0085, 1.2e9
STIFFNESS = 4.0 / 3.0 * MODULUS * math.sqrt(RADIUS)
SCENES = Path(__file__).parents[3] / "scenes"
COMMAND, SPHERE = ("calibrate", "contact"), ("--mass", MASS, "--radius", RADIUS)


def integrated(damping_ratio: float) -> tuple[Array, Array, float]:
    """Return times and forces of an impact with Tsuji's law, in units of T, and its restitution, by scipy."""
    g = math.sqrt(5.0) * damping_ratio

    def force(x: float, v: float) -> float:
        return float(abs(x) ** 1.5 + g * v * abs(x) ** 0.25)

    def vanishes(t: float, y: Array) -> float:
        return force(y[0], y[1]) if t > 1e-3 else 1.0

    vanishes.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(lambda t, y: [y[1], -force(y[0], y[1])], (0.0, 50.0), [1e-10, 1.0], events=vanishes, rtol=1e-9,
                    atol=1e-12, max_step=0.005)  # fmt: skip
    return run.t, np.array([force(x, v) for x, v in run.y.T]), -float(run.y[1, -1])


def dropped(
    rng: np.random.Generator, e: float, *, scatter: float = 0.0, timing: float = 0.0, drops: int = 1, count: int = 8,
    blur: float = 0.0,
) -> Impacts:  # fmt: skip
    """Return the impacts of drops with a restitution that scatters, instants and durations with errors."""
    scaled = pulse(e).duration
    times, numbers, durations = [], [], []
    for drop in range(drops):
        now, speed = rng.random(), 3.0 * (1.0 + 0.05 * rng.standard_normal())
        for _ in range(count):
            contact = scaled * (MASS / STIFFNESS) ** 0.4 * speed**-0.2
            times.append(now + timing * rng.standard_normal())
            numbers.append(float(drop))
            durations.append(contact * math.exp(blur * rng.standard_normal()))
            speed *= e * math.exp(scatter * rng.standard_normal())
            now += contact + 2.0 * speed / G
    return Impacts(np.array(times), np.array(numbers), np.array(durations) if blur else None)


def test_the_elastic_impact_is_hertz() -> None:
    """Hertz 1882: 2.9432 times the deepest overlap over the speed."""
    exact = 0.8 * math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9) * 1.25**0.4
    assert pulse(1.0).duration == pytest.approx(exact, rel=1e-6)
    time = exact * (MASS / STIFFNESS) ** 0.4 * 2.0**-0.2
    assert stiffness(MASS, 2.0, time, pulse(1.0).duration) == pytest.approx(STIFFNESS, rel=1e-5)


@pytest.mark.parametrize("e", [0.9, 0.5, 0.1565, math.exp(-2.0), 0.05])
def test_duration_and_width_are_those_of_an_integrated_impact(e: float) -> None:
    one = pulse(e)
    times, forces, rebound = integrated(one.damping_ratio)
    centre = np.trapezoid(forces * times, times) / np.trapezoid(forces, times)
    width = math.sqrt(np.trapezoid(forces * (times - centre) ** 2, times) / np.trapezoid(forces, times))
    assert rebound == pytest.approx(e, rel=1e-4)
    assert one.duration == pytest.approx(float(times[-1]), rel=1e-3)
    assert one.width == pytest.approx(width, rel=1e-3)


@settings(max_examples=20, deadline=None)
@given(e=st.floats(0.2, 0.98), count=st.integers(5, 12))
def test_without_noise_the_restitution_is_exact(e: float, count: int) -> None:
    # the contacts' durations are part of the intervals here, and known
    impacts = dropped(np.random.default_rng(0), e, count=count, blur=1e-12)
    fit = fit_drop(impacts, G, MASS, RADIUS)
    assert fit.modulus is not None
    assert fit.restitution.value == pytest.approx(e, rel=1e-6)
    assert fit.modulus.value == pytest.approx(MODULUS, rel=1e-4)


@pytest.mark.parametrize(("drops", "count"), [(1, 8), (3, 6)])
def test_the_truth_lies_within_the_error_bars_in_93_to_97_of_100_draws(drops: int, count: int) -> None:
    """400 draws, seed 5, of a restitution that scatters by 1 %, instants to 20 us and durations to 2 %."""
    rng, draws, inside = np.random.default_rng(5), 400, np.zeros(2)
    for _ in range(draws):
        impacts = dropped(rng, 0.8, scatter=0.01, timing=2e-5, drops=drops, count=count, blur=0.02)
        fit = fit_drop(impacts, G, MASS, RADIUS)
        assert fit.modulus is not None
        inside += [fit.restitution.low <= 0.8 <= fit.restitution.high, fit.modulus.low <= MODULUS <= fit.modulus.high]
    assert np.all((inside / draws >= 0.93) & (inside / draws <= 0.97)), inside / draws
    # where only the clock errs the error bars are too wide, and not too narrow
    clock = [fit_drop(dropped(rng, 0.8, timing=1e-3), G).restitution for _ in range(50)]
    assert np.mean([one.low <= 0.8 <= one.high for one in clock]) >= 0.93


def test_a_recorded_force_gives_restitution_and_modulus(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    e, rate, noise = 0.7, 50_000.0, 0.002
    scale = (MASS / STIFFNESS) ** 0.4
    times, forces, _ = integrated(pulse(e).damping_ratio)
    t = np.arange(0.0, 1.6, 1.0 / rate)
    signal, now, speed = np.random.default_rng(7).normal(0.0, noise, t.size), 0.05, 2.5
    for _ in range(6):
        unit = scale * speed**-0.2
        signal += np.interp(t, now + times * unit, speed / unit * forces, left=0.0, right=0.0) / 2.5e4
        speed *= e
        now += times[-1] * unit + 2.0 * speed / G
    file = tmp_path / "force.csv"
    np.savetxt(file, np.column_stack([t, signal]), delimiter=",", header="time,force", comments="", fmt="%.9g")
    found = answered(capsys, *COMMAND, file, *SPHERE)
    assert found["restitution"]["value"] == pytest.approx(e, rel=0.01)
    assert found["modulus"]["value"] == pytest.approx(MODULUS, rel=0.05)
    assert found["modulus"]["low"] < found["modulus"]["value"] < found["modulus"]["high"]


def test_the_command_writes_a_contact_block_a_scene_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    impacts = dropped(np.random.default_rng(3), 0.6, scatter=0.005, timing=1e-5, count=9, blur=0.01)
    assert impacts.duration is not None
    file, out, made = (tmp_path / name for name in ("drop.csv", "contact.yaml", "scene.yaml"))
    rows = np.column_stack([impacts.time, impacts.drop, impacts.duration])
    np.savetxt(file, rows, delimiter=",", header="impact_time,drop,duration", comments="", fmt="%.12g")
    printed(capsys, *COMMAND, file, *SPHERE, "--out", out)
    scene = SCENES.joinpath("standard.yaml").read_text(encoding="utf-8")
    kept = [line for line in scene.splitlines() if not line.startswith("contact")]
    made.write_text("\n".join(kept) + "\n" + out.read_text(encoding="utf-8"), encoding="utf-8")
    contact: Any = load_scene(made).contact
    assert contact.law == "tsuji"
    assert contact.hertz_stiffness(RADIUS) == pytest.approx(STIFFNESS, rel=0.05)
    # Tsuji's beta of a wall: zeta = 2 beta / sqrt(5), from the closed form of the restitution
    assert contact.damping_ratio == pytest.approx(0.5 * math.sqrt(5.0) * pulse(0.6).damping_ratio, rel=0.05)
    assert "modulus" in printed(capsys, *COMMAND, file, "--force", "--out", out)  # is not determined
    block = yaml.safe_load(out.read_text(encoding="utf-8"))["contact"]
    assert block == {"law": "impact", "restitution": pytest.approx(0.6, rel=0.01)}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("impact_time\n0\n1\n1.6\n", ["3 impacts", "1 drop"]),
        ("impact_time\n0\n2\n1.6\n1.9\n2\n", ["impact 3: ", "1.6 s"]),
        ("impact_time\n0\nnan\n1\n", ["impact 2: ", "nan s"]),
        ("impact_time,duration\n0,1e-4\n1,-1\n1.6,1e-4\n", ["impact 2: ", "-1 s"]),
        ("impact_time\n0\nx\n", ["number"]),
        ("time,position\n0,1\n1,2\n2,3\n", ["force", "acceleration"]),
        ("time,force\n" + "".join(f"{k},{k % 5 == 0:d}\n" for k in range(40)), ["1 samples"]),
    ],
)
def test_what_determines_nothing_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, words: list[str]
) -> None:
    (tmp_path / "odd.csv").write_text(table, encoding="utf-8")
    line = refusal(capsys, *COMMAND, tmp_path / "odd.csv")
    assert [word for word in words if word not in line] == []
