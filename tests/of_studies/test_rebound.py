# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restitution of Lee-Herrmann and Kuwabara-Kono: the integral against known results, the series against it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.special import beta

from atpid_sim.contact import rebound_series
from atpid_sim.contact.linear import damped_restitution
from atpid_sim.contact.rebound_series import KUWABARA_KONO, LEE_HERRMANN, series_rebound
from studies.cli import main
from studies.rebound_fit import SERIES, STRONG, log_rebound, reference, strong_rebound

LAWS = pytest.mark.parametrize(("a", "series"), [(0.0, LEE_HERRMANN), (0.5, KUWABARA_KONO)])


def integral(g: float, a: float) -> float:
    return math.exp(log_rebound(g, a))


@pytest.mark.parametrize("g", [1e-9, 1e-6, 1e-3, 0.1, 1.0, 2.0, 5.0, 30.0, 100.0, 1000.0])
def test_the_integral_meets_tsuji_s_closed_form(g: float) -> None:
    closed = math.log(damped_restitution(g / math.sqrt(5.0)))
    assert log_rebound(g, 0.25) == pytest.approx(closed, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("g", [1e-5, 1e-4, 1e-3, 1e-2])
def test_kuwabara_kono_meets_the_published_series(g: float) -> None:
    """1 - 1.153449 g + 0.798267 g^2 + 0.266666 g^2.5 (Schwager and Poeschel, Phys. Rev. E 78 (2008) 051304)."""
    published = 1.0 - 1.153449 * g + 0.798267 * g**2 + 0.266666 * g**2.5
    assert integral(g, 0.5) == pytest.approx(published, abs=0.7 * g**3 + 5e-7 * g)


@pytest.mark.parametrize("power", [0.0, 0.5])
@pytest.mark.parametrize("g", [0.05, 0.5, 2.0])
def test_the_integral_meets_an_integration_in_time(g: float, power: float) -> None:
    def rate(s: float, y: list[float]) -> list[float]:
        x, stretch = max(y[0], 0.0), 4.0 * s**3
        return [y[1] * stretch, -(x**1.5 + g * y[1] * x**power) * stretch]

    def held(s: float, y: list[float]) -> float:
        return 1.0 if s < 0.3 else max(y[0], 0.0) ** (1.5 - power) + g * y[1]

    held.terminal = True  # type: ignore[attr-defined]
    solved = solve_ivp(rate, (0.0, 8.0), [0.0, 1.0], method="DOP853", rtol=1e-11, atol=1e-13, events=held)
    assert integral(g, power) == pytest.approx(-solved.y_events[0][0][1], rel=1e-8)


@pytest.mark.parametrize("a", [0.0, 0.25, 0.5])
@pytest.mark.parametrize(("d", "error"), [(STRONG, 1e-9), (10.0 * STRONG, 1e-7)])
def test_strong_damping_s_expansion_meets_the_integral(a: float, d: float, error: float) -> None:
    g = d ** (-(1.0 + a) / 2.5)
    assert strong_rebound(g, a) == pytest.approx(integral(g, a), rel=error)


@pytest.mark.parametrize("g", [1e3, 1e5, 1e7])
def test_strong_damping_s_expansion_meets_tsuji_s_closed_form(g: float) -> None:
    assert strong_rebound(g, 0.25) == pytest.approx(damped_restitution(g / math.sqrt(5.0)), rel=1e-9)


@LAWS
@settings(deadline=None)
@given(log_g=st.floats(-14.0, 14.0))
def test_the_series_meets_the_integral(a: float, series: np.ndarray, log_g: float) -> None:
    g = 10.0**log_g
    assert series_rebound(g, a, series) == pytest.approx(math.exp(reference(g, a)), rel=1e-8)


@LAWS
def test_the_series_meets_both_ends(a: float, series: np.ndarray) -> None:
    """The loss along the undamped path, and the creep of a grain that damping alone has stopped."""
    power, q = 2.5 / (1.0 + a), 0.4 * (1.0 + a)
    weak = 0.8 * 1.25**q * beta(q, 1.5) / power
    strong = (1.0 + a) ** ((a - 1.5) / 2.5)
    assert np.polynomial.chebyshev.chebval([-1.0, 1.0], series) == pytest.approx([weak, strong], rel=1e-8)


@LAWS
def test_more_damping_never_gives_more_rebound(a: float, series: np.ndarray) -> None:
    curve = np.array([series_rebound(g, a, series) for g in np.geomspace(1e-30, 1e60, 20_000)])
    assert (np.diff(curve) <= 0.0).all()
    assert (curve > 0.0).all()
    between = (curve < 1.0 - 1e-12) & (curve > 1e-80)
    assert (np.diff(curve[between]) < 0.0).all()


@LAWS
def test_no_damping_and_endless_damping(a: float, series: np.ndarray) -> None:
    assert [series_rebound(g, a, series) for g in (0.0, 5e-324, 1e-30)] == [1.0, 1.0, 1.0]
    assert series_rebound(math.inf, a, series) == 0.0
    assert math.isnan(series_rebound(math.nan, a, series))


def test_the_coefficients_are_those_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    made: dict[str, np.ndarray] = {}
    assert main(["rebound"]) == 0
    exec(capsys.readouterr().out, {"np": np}, made)
    assert list(made) == [name for name, _, _ in SERIES]
    for name, coefficients in made.items():
        assert coefficients == pytest.approx(getattr(rebound_series, name), abs=1e-11)
