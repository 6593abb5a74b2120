# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restitution and modulus are recovered from drop tests made by code of their own, within their error bars."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from atpid_control.analysis.contact.drop import Impacts, fit_drop, read_impacts
from atpid_control.analysis.contact.estimate import ContactError, mean
from atpid_control.analysis.contact.pulse import pulse, stiffness
from atpid_control.cli import main
from atpid_sim.scene import load_scene
from atpid_sim.system import Array

G, MASS, RADIUS, MODULUS = 9.81, 0.02, 0.0085, 1.2e9
STIFFNESS = 4.0 / 3.0 * MODULUS * math.sqrt(RADIUS)
SCENES = Path(__file__).parents[2] / "scenes"


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
    blur: float = 0.0, damped: float = 0.0,
) -> Impacts:  # fmt: skip
    """Return the impacts of drops with a restitution that scatters, instants and durations with errors."""
    scaled = pulse(e).duration if damped == 0.0 else damped
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


def written(folder: Path, impacts: Impacts) -> Path:
    """Return a table of impacts."""
    file = folder / "drop.csv"
    assert impacts.duration is not None
    rows = np.column_stack([impacts.time, impacts.drop, impacts.duration])
    np.savetxt(file, rows, delimiter=",", header="impact_time,drop,duration", comments="", fmt="%.12g")
    return file


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


@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=12), st.floats(-10.0, 10.0), st.floats(0.1, 10.0))
@settings(max_examples=50, deadline=None)
def test_the_interval_moves_and_scales_with_the_values(values: list[float], shift: float, scale: float) -> None:
    plain, moved = mean(np.array(values)), mean(scale * np.array(values) + shift)
    assert plain.low <= plain.value <= plain.high
    slack = 1e-6 * (1.0 + scale * max(map(abs, values)))
    assert moved.value == pytest.approx(scale * plain.value + shift, abs=slack)
    if np.ptp(values) > 1e-3:
        assert moved.high - moved.low == pytest.approx(scale * (plain.high - plain.low), rel=1e-5, abs=slack)


@pytest.mark.slow
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


@pytest.mark.slow
def test_where_only_the_clock_errs_the_error_bars_are_too_wide_and_not_too_narrow() -> None:
    rng = np.random.default_rng(6)
    fits = [fit_drop(dropped(rng, 0.8, timing=1e-3), G) for _ in range(100)]
    assert np.mean([fit.restitution.low <= 0.8 <= fit.restitution.high for fit in fits]) >= 0.93


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
    assert main(["calibrate", "contact", str(file), "--mass", str(MASS), "--radius", str(RADIUS), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["restitution"]["value"] == pytest.approx(e, rel=0.01)
    assert found["modulus"]["value"] == pytest.approx(MODULUS, rel=0.05)
    assert found["modulus"]["low"] < found["modulus"]["value"] < found["modulus"]["high"]


def test_the_command_writes_a_contact_block_a_scene_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path, dropped(np.random.default_rng(3), 0.6, scatter=0.005, timing=1e-5, count=9, blur=0.01))
    out = tmp_path / "contact.yaml"
    command = ["calibrate", "contact", str(file), "--mass", str(MASS), "--radius", str(RADIUS), "--out", str(out)]
    assert main(command) == 0
    assert "contact time at" in capsys.readouterr().out
    scene = SCENES.joinpath("standard.yaml").read_text(encoding="utf-8")
    kept = [line for line in scene.splitlines() if not line.startswith("contact")]
    made = tmp_path / "scene.yaml"
    made.write_text("\n".join(kept) + "\n" + out.read_text(encoding="utf-8"), encoding="utf-8")
    contact = load_scene(made).contact
    assert contact.law == "tsuji"
    assert contact.hertz_stiffness(RADIUS) == pytest.approx(STIFFNESS, rel=0.05)  # type: ignore[attr-defined]
    # Tsuji's beta of a wall: zeta = 2 beta / sqrt(5), from the closed form of the restitution
    assert contact.damping_ratio == pytest.approx(  # type: ignore[attr-defined]
        0.5 * math.sqrt(5.0) * pulse(0.6).damping_ratio, rel=0.05
    )
    assert main([*command[:3], "--force", "--out", str(out)]) == 0
    assert "law: impact, restitution: 0." in out.read_text(encoding="utf-8")
    assert "# not determined: modulus: needs" in capsys.readouterr().out


@pytest.mark.parametrize(("table", "line"), [
    ("impact_time\n0\n1\n1.6\n", "given 3 impacts in 1 drop(s); needed: at least 3"),
    ("impact_time\n0\n2\n1.6\n1.9\n2\n", "impact 3: given 1.6 s; allowed: times that rise"),
    ("impact_time,duration\n0,1e-4\n1,-1\n1.6,1e-4\n", "impact 2: given a duration of -1 s; allowed: above 0"),
    ("impact_time\n0\nx\n", "allowed: a number with a decimal point"),
    ("time,position\n0,1\n1,2\n2,3\n", "needed: of a drop one of force, acceleration"),
    ("time,force\n" + "".join(f"{k},{k % 5 == 0:d}\n" for k in range(40)), "contacts of at most 1 samples"),
])  # fmt: skip
def test_what_determines_nothing_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, line: str
) -> None:
    file = tmp_path / "odd.csv"
    file.write_text(table, encoding="utf-8")
    assert main(["calibrate", "contact", str(file)]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


def test_times_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "nan.csv"
    file.write_text("impact_time\n0\nnan\n1\n", encoding="utf-8")
    with pytest.raises(ContactError, match="impact 2: given nan s"):
        read_impacts(file)
