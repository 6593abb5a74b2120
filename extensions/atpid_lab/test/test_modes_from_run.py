# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Modes fitted from recorded runs of random structures, simulated by scipy alone: within their stated intervals."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from hypothesis import settings
from recorded import Capture, refused
from scipy.signal import StateSpace, lsim

from atpid_control.analysis.signals import Signals
from atpid_control.cli import main
from atpid_lab.modes.from_run import fit_modes, structure_of
from atpid_lab.modes.structure import ModesError
from atpid_sim.system import Array

NOISE = {"m": 2e-5, "N": 0.01}  # of laser and load cell
#: Length of a run [s] that is enough for a force; a support's shows less, and a sweep passes each mode but once.
SECONDS = 12.0
#: Random structures, not chosen: the first ones.
SEEDS = range(6 if settings.get_current_profile_name() == "long" else 3)


class Drawn(NamedTuple):
    """A random structure: frequencies [Hz], damping ratios, masses [kg], parts of the drive (k,)."""

    frequency: Array
    ratio: Array
    mass: Array
    factor: Array


def drawn(random: np.random.Generator, force: bool) -> Drawn:
    count = int(random.integers(1, 5))
    frequency = np.cumprod(np.append(random.uniform(3.0, 8.0), random.uniform(1.5, 4.0, count - 1)))
    mass = random.uniform(0.2, 0.5) * np.append(1.0, random.uniform(2.0, 10.0, count - 1))
    factor = np.ones(count)
    if not force:
        factor = random.normal(0.0, 0.2, count)
        factor[0] = random.uniform(1.0, 1.2)
        factor[-1] = 1.0 - factor[:-1].sum()
    return Drawn(frequency, random.uniform(0.005, 0.03, count), mass, factor)


def recorded(
    random: np.random.Generator, structure: Drawn, kind: str, unit: str, grain: float = 0.0, seconds: float = SECONDS
) -> Signals:
    """Return a run of the structure with a grain [kg] held: random, a sweep, or free."""
    pace = 2.0 * np.pi * structure.frequency
    stiffness, damping = (np.diag(structure.mass * part) for part in (pace**2, 2.0 * structure.ratio * pace))
    inverse, count = np.linalg.inv(np.diag(structure.mass) + grain), len(pace)
    matrix = np.block([[np.zeros((count, count)), np.eye(count)], [-inverse @ stiffness, -inverse @ damping]])
    rate = 1000.0 if structure.frequency[-1] < 120.0 else 4000.0
    t = np.arange(0.0, seconds, 1.0 / rate)
    start, size = np.zeros(2 * count), {"N": 3.0, "m": 0.004}[unit]
    if kind == "free":
        drive = np.zeros(len(t))
        start[:count] = random.normal(0.0, 0.02, count) * np.append(1.0, np.full(count - 1, 0.3))
    elif kind == "sweep":
        drive = size * np.sin(2.0 * np.pi * np.cumsum(np.geomspace(1.0, 1.3 * structure.frequency[-1], len(t))) / rate)
    else:
        f = np.fft.rfftfreq(2 * len(t), 1.0 / rate)
        lines = random.standard_normal((len(f), 2)) @ np.array([1.0, 1.0j])
        inside = (f > 1.0) & (f < 1.5 * structure.frequency[-1])
        drive = np.fft.irfft(np.where(inside, lines / np.maximum(f, 1.0) ** (0.5 * (unit == "m")), 0.0))[: len(t)]
        drive *= size / drive.std()
    # without the drive's derivative: velocities less what the moving support's damper gives
    by_damper = inverse @ damping @ structure.factor * (unit == "m")
    by_spring = inverse @ (stiffness @ structure.factor if unit == "m" else structure.factor)
    enters = np.append(by_damper, by_spring - inverse @ damping @ by_damper)[:, None]
    out = np.append(np.ones(count), np.zeros(count))[None]
    beam = lsim(StateSpace(matrix, enters, out, np.zeros((1, 1))), drive, t, X0=start)[1]
    given, answer = (one + NOISE[of] * random.standard_normal(len(t)) for one, of in ((drive, unit), (beam, "m")))
    return Signals(rate, given, answer, (unit, "m"))


def of_held(structure: Drawn, grain: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and damping ratios with a grain [kg] held, of the coupled equations."""
    pace, count = 2.0 * np.pi * structure.frequency, len(structure.mass)
    mass = np.diag(structure.mass) + grain
    lower = [-np.linalg.solve(mass, np.diag(structure.mass * part)) for part in (pace**2, 2.0 * structure.ratio * pace)]
    poles = np.linalg.eigvals(np.block([[np.zeros((count, count)), np.eye(count)], lower]))
    poles = poles[poles.imag > 0.0]
    poles = poles[np.argsort(np.abs(poles))]
    return np.abs(poles) / (2.0 * np.pi), -poles.real / np.abs(poles)


@pytest.mark.parametrize(
    ("kind", "unit", "seconds"),
    [("random", "N", SECONDS), ("sweep", "N", 30.0), ("random", "m", 20.0), ("free", "m", SECONDS)],
)
def test_random_structures_are_within_the_stated_intervals(kind: str, unit: str, seconds: float) -> None:
    inside, errors, refused = [], [], 0
    for seed in SEEDS:
        random = np.random.default_rng(seed)
        structure = drawn(random, unit == "N")
        try:
            run = recorded(random, structure, kind, unit, seconds=seconds)
            fit = fit_modes(run, len(structure.mass), unit == "N")
        except ModesError:  # the record does not determine a weak one
            refused += 1
            continue
        if kind == "free":
            assert np.isnan(fit.drive).all()
            found, bars = np.stack([fit.frequency, fit.ratio]), fit.deviations()[:2]
            true = np.stack(of_held(structure, 0.0))
        else:
            made, spread = structure_of(fit, None if unit == "N" else structure.mass, 0.0, unit == "N")
            rows = [(m.frequency, m.damping_ratio, m.mass if unit == "N" else m.base) for m in made.modes]
            found, bars = np.array(rows).T, spread.T[[0, 1, 2 if unit == "N" else 3]]
            true = np.stack([structure.frequency, structure.ratio, structure.mass if unit == "N" else structure.factor])
        inside.append(np.abs(found - true) <= 1.96 * bars)
        errors.append(np.abs(found / true - 1.0).max())
    # 95 % bars, whose values in one record are correlated
    assert np.concatenate([one.ravel() for one in inside]).mean() >= 0.85
    assert refused <= 1
    assert np.median(errors) < 0.01
    assert max(errors) < 0.1


def test_a_mode_that_the_record_does_not_determine_is_named() -> None:
    """Of four modes of a moving support one is lost in the noise; what is fitted in its place is refused."""
    random = np.random.default_rng(2)
    structure = drawn(random, False)
    with pytest.raises(ModesError, match=r"4; .* 49\.\d+ Hz; .*fewer"):
        fit_modes(recorded(random, structure, "random", "m", seconds=20.0), 4, force=False)
    structure = Drawn(np.array([5.0]), np.array([0.02]), np.array([0.3]), np.ones(1))
    with pytest.raises(ModesError, match="fewer"):
        fit_modes(recorded(np.random.default_rng(3), structure, "random", "N"), 3, force=True)


def test_the_grain_that_the_closed_damper_held_is_taken_away() -> None:
    random = np.random.default_rng(5)
    structure = drawn(random, True)
    fit = fit_modes(recorded(random, structure, "random", "N", grain=0.03), len(structure.mass), force=True)
    assert fit.frequency == pytest.approx(of_held(structure, 0.03)[0], rel=1e-3)
    modes = structure_of(fit, None, 0.03, True)[0].modes
    assert [mode.frequency for mode in modes] == pytest.approx(structure.frequency, rel=1e-3)
    assert [mode.mass for mode in modes] == pytest.approx(structure.mass, rel=0.02)
    with pytest.raises(ModesError, match=r"--grain-mass: .*\b5 kg; .*below"):
        structure_of(fit, None, 5.0, True)


def test_the_command_and_a_moving_support_which_shows_no_masses(tmp_path: Path, capsys: Capture) -> None:
    random, out = np.random.default_rng(1), tmp_path / "beam.yaml"
    for force, name in ((True, "drive_force"), (False, "support_displacement")):
        structure = drawn(random, force)
        signals = recorded(random, structure, "random", "N" if force else "m", seconds=10.0)
        table = np.column_stack([signals.time, signals.excitation, signals.response])
        header = f"time,{name},beam_displacement"
        np.savetxt(tmp_path / f"{name}.csv", table, fmt="%.9g", delimiter=",", header=header, comments="")
        given = ["modes", "fit", str(tmp_path / f"{name}.csv"), "--modes", str(len(structure.mass))]
        masses = [] if force else ["--masses", *map(str, structure.mass)]
        assert main([*given, *masses, "--out", str(out)]) == 0
        blocks = yaml.safe_load(out.read_text())
        modes = [blocks["beam"], *blocks["further_modes"]]
        assert blocks.get("drive") == ("force" if force else None)
        assert [mode["mass"] for mode in modes] == pytest.approx(structure.mass, rel=0.02)
        assert [mode["drive_factor"] for mode in modes[1:]] == pytest.approx(structure.factor[1:], rel=0.02)
        out.unlink()
    refused(capsys, [*given, "--masses", "1.0"], f"--masses: given 1; allowed: {len(structure.mass)}")
    refused(capsys, [*given, "--out", out], "--scene, --out: ", "masses")
    assert main([*given, "--json"]) == 0
    modes = json.loads(capsys.readouterr().out)["modes"]
    assert [mode["drive_factor"] for mode in modes] == pytest.approx(structure.factor, rel=0.02)
