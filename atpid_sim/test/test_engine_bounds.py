# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The beam in closed form, where it is hardest too; jerk and snap bounds, safe steps, roots, how kernels are kept."""

import ast
import importlib
import math
import pkgutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numba.core.dispatcher import Dispatcher
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import atpid_sim.contact
import atpid_sim.engine
from atpid_sim.contact import law_kernel
from atpid_sim.engine.arc import arc_from, support_at
from atpid_sim.engine.beam import beam_at, bounded_at, snap_bounded_at
from atpid_sim.engine.modal_arc import modal_arc
from atpid_sim.engine.modal_room import keep, with_room
from atpid_sim.engine.safe_step import safe_step, safe_velocity_step
from atpid_sim.kernel import KERNEL_SOURCES
from atpid_sim.modal import ModeSet, modes_of
from atpid_sim.root import root
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation import quantities
from atpid_sim.simulation.simulate import simulate
from atpid_sim.system import Array, System


def number(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers between the two, those below a billionth taken as zero: the motion has no finer scale."""
    return st.floats(low, high).map(lambda value: value if abs(value) > 1e-9 else 0.0)


def segment_of(a0: float, a1: float, omega: float, phase: float, c2: float = 0.0, c3: float = 0.0) -> Array:
    return np.array([0.0, 1.0, a0, a1, omega, phase, 0.002, -0.01, c2, c3, 0.1, 0.0])


SEGMENTS = st.builds(
    segment_of,
    st.floats(0.0, 0.1),
    st.floats(-0.05, 0.05),
    st.floats(1.0, 200.0),
    st.floats(0.0, 6.0),
    st.floats(-1.0, 1.0),
    st.floats(-5.0, 5.0),
)
BEAMS = st.tuples(st.floats(0.05, 2.0), st.floats(10.0, 2000.0), st.floats(0.0, 120.0))


@given(
    gap=number(0.0, 1.0),
    rate=number(-10.0, 10.0),
    acceleration=number(-500.0, 500.0),
    jerk=number(0.0, 1e5),
    longest=st.floats(1e-4, 1.0),
)
@settings(max_examples=200, deadline=None)
def test_a_safe_step_passes_no_root(gap: float, rate: float, acceleration: float, jerk: float, longest: float) -> None:
    step = safe_step(gap, rate, acceleration, jerk, longest)
    assert 0.0 <= step <= longest
    s = np.linspace(0.0, step, 500)
    worst = gap + s * (rate + s * (0.5 * acceleration - s * jerk / 6.0))
    assert worst.min() >= -1e-9 * (gap + abs(rate) * step + abs(acceleration) * step**2 + jerk * step**3)


@given(margin=st.floats(1e-9, 10.0), acceleration=st.floats(-500.0, 500.0), jerk=st.floats(0.0, 1e5))
@settings(max_examples=200, deadline=None)
def test_a_safe_velocity_step_stays_below_its_limit(margin: float, acceleration: float, jerk: float) -> None:
    step = safe_velocity_step(margin, acceleration, jerk, 1.0)
    s = np.linspace(0.0, step, 200)
    assert (acceleration * s + 0.5 * jerk * s**2).max() <= margin * (1 + 1e-9) + 1e-13 * (abs(acceleration) + jerk)


@pytest.mark.parametrize("damping", [0.0, 0.56, 2.0 * math.sqrt(427.6 * 0.3258), 60.0])
def test_the_closed_form_solves_the_beam(damping: float) -> None:
    segment = segment_of(0.01, 0.02, 34.4, 0.3, 0.2, -0.4)
    arc = arc_from(0.3258, System(0.3258, 0.0, 427.6, damping, 9.81, 0.0), segment, 0.0, 0.02, -0.5)

    def slope(t: float, y: Array) -> list[float]:
        u, w = support_at(segment, t)
        return [y[1], (427.6 * (u - y[0]) + damping * (w - y[1])) / 0.3258 - 9.81]

    reference = solve_ivp(slope, (0.0, 1.0), [0.02, -0.5], method="DOP853", rtol=1e-12, atol=1e-14, dense_output=True)
    for t in np.linspace(0.0, 1.0, 23):
        x, v, *_ = beam_at(arc, t)
        assert [x, v] == pytest.approx(list(reference.sol(t)), rel=1e-9, abs=1e-10)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _along(table: Any, system: Any, states: Any, segment: Any, begin: float, times: Any) -> Any:
    """Displacement and acceleration (times, 2) of several modes, their jerk's bound at `begin`, and the fast part."""
    own, owner = with_room(table, system)
    arc = modal_arc(own.modes, 0, states, segment, begin)
    x, v, a, bound, fast = bounded_at(arc, begin, times[-1])
    found = np.empty((times.size, 2))
    for k in range(times.size):
        found[k, 0], _v, found[k, 1], _u, _w = beam_at(arc, times[k])
    keep(owner)
    return found, (x, v, a, bound), (fast.x, fast.v, fast.a, fast.jerk, fast.size)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_several_modes_stay_within_their_bounds(seed: int) -> None:
    """The jerk's bound, and the motion that is slow with the fast free vibrations anywhere within their size."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    mass = 0.3 * 10.0 ** rng.uniform(-2, 2, count)
    natural = 30.0 * 10.0 ** rng.uniform(0, 2, count)
    natural[0] = 30.0
    stiffness = mass * natural**2
    damping = 2.0 * rng.choice([0.0, 0.02, 0.7, 3.0], count) * mass * natural
    factors = rng.uniform(-1.0, 1.0, count)
    free = ModeSet(mass, stiffness, damping, factors * stiffness, factors * damping, np.eye(count)[0] * 9.81)
    table = modes_of(free, 0.03, 9.81).table
    system = System(mass[0], 0.03, stiffness[0], damping[0], 9.81, 0.0085, table)
    segment = np.zeros(12)
    segment[1], segment[2:6] = 1.0, (0.01, 0.02 * rng.random(), rng.uniform(5.0, 60.0), rng.uniform(0.0, 6.0))
    segment[6:10] = 0.01 * rng.uniform(-1.0, 1.0, 4)
    states = np.column_stack((0.01 * rng.normal(size=count), rng.normal(size=count)))
    times = np.linspace(0.1, 0.3, 4001)
    found, (x, v, a, bound), (fast_x, fast_v, fast_a, fast_jerk, size) = _along(
        table, system, states, segment, 0.1, times
    )
    s = times - times[0]
    assert found[0] == pytest.approx((x, a))
    assert np.abs(np.diff(found[:, 1])).max() <= bound * s[1] * (1.0 + 1e-9)
    slow = x - fast_x + s * (v - fast_v + 0.5 * s * (a - fast_a))
    reach = (bound - fast_jerk) * s**3 / 6.0 + size
    assert (np.abs(found[:, 0] - slow) <= reach * (1.0 + 1e-9) + 1e-12).all()


STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")
MASS, STIFFNESS, GRAVITY = 0.3258, 427.6, 9.81
NATURAL = math.sqrt(STIFFNESS / MASS)
RAMP = [[0.0, 0.0], [0.5, 0.05], [1.0, 0.001]]
#: Anything from nothing to one, by orders of magnitude.
SHARES = st.one_of(st.just(0.0), st.floats(-16.0, 0.0).map(lambda power: 10.0**power))


def tone_row(detuning: float, radians: float, a0: float, a1: float) -> Array:
    """Row of a tone whose amplitude goes from a0 to a1 within so many radians of it."""
    omega = NATURAL * (1.0 + detuning)
    length = radians / omega
    return np.array([0.0, length, a0, (a1 - a0) / length, omega, 0.3, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0])


def beam_exactly(row: Array, damping: float, start: float, x: float, v: float, ahead: float) -> tuple[float, float]:
    """Displacement and velocity `ahead` seconds later: beam, tone and ramp as one autonomous system's exponential."""
    omega = float(row[4])
    a0, a1 = float(row[2] + row[3] * start), float(row[3]) / omega  # a1 and all rates per radian of the tone
    spring, loss = STIFFNESS / (MASS * omega**2), damping / (MASS * omega)
    system = np.zeros((7, 7))  # x, v, sin, cos, t sin, t cos, 1
    system[0, 1] = 1.0
    system[1, :2] = -spring, -loss
    system[1, 2:] = spring * a0 + loss * a1, loss * a0, spring * a1, loss * a1, -GRAVITY / omega**2
    system[2, 3] = system[4, 5] = system[4, 2] = system[5, 3] = 1.0
    system[3, 2] = system[5, 4] = -1.0
    angle = omega * start + row[5]
    first = np.array([x, v / omega, math.sin(angle), math.cos(angle), 0.0, 0.0, 1.0])
    last = expm(system * (omega * ahead)) @ first
    return float(last[0]), float(last[1]) * omega


@given(
    detuning=SHARES,
    damping_ratio=SHARES,
    radians=st.floats(0.0, 3.5).map(lambda power: 10.0**power),
    ends=st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.1)),
    begin=st.floats(0.0, 0.9),
)
@settings(max_examples=150, deadline=None)
def test_the_motion_is_right_at_every_detuning_and_damping(
    detuning: float, damping_ratio: float, radians: float, ends: tuple[float, float], begin: float
) -> None:
    row = tone_row(detuning, radians, *ends)
    damping = 2.0 * damping_ratio * math.sqrt(STIFFNESS * MASS)
    start = begin * row[1]
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, damping, GRAVITY, 0.0), row, start, -0.007, 0.1)
    size = 0.007
    for share in (0.01, 0.1, 0.5, 1.0):
        x, v = beam_exactly(row, damping, start, -0.007, 0.1, share * (row[1] - start))
        size = max(size, abs(x), abs(v) / NATURAL)
        got = beam_at(arc, start + share * (row[1] - start))
        assert abs(got[0] - x) < 1e-9 * size
        assert abs(got[1] - v) < 1e-9 * size * row[4]


NEAR_ROWS = st.builds(
    tone_row, st.one_of(SHARES, st.floats(-0.03, 0.03)), st.floats(1.0, 300.0), *[st.floats(0.0, 0.1)] * 2
)
NEAR = st.tuples(NEAR_ROWS, st.floats(0.0, 0.02)).map(
    lambda both: (both[0], MASS, STIFFNESS, 2.0 * both[1] * math.sqrt(STIFFNESS * MASS))
)
ANY = st.tuples(SEGMENTS, BEAMS).map(lambda both: (both[0], *both[1]))


@given(st.one_of(NEAR, ANY), st.floats(0.0, 0.9), st.floats(0.0, 0.95), st.floats(-0.3, 0.3), st.floats(-8.0, 8.0))
@settings(max_examples=200, deadline=None)
def test_jerk_and_snap_keep_to_their_bounds(
    case: tuple[Array, float, float, float], begin: float, at: float, x: float, v: float
) -> None:
    row, mass, stiffness, damping = case
    start, until = begin * row[1], float(row[1])
    arc = arc_from(mass, System(mass, 0.0, stiffness, damping, GRAVITY, 0.0), row, start, x, v)
    tau = start + at * (until - start)
    _, _, _, jerk_bound, _ = bounded_at(arc, tau, until)
    *_, jerk, snap_bound = snap_bounded_at(arc, tau, until)
    assert abs(jerk) <= jerk_bound * (1.0 + 1e-9)
    times = np.linspace(tau, until, 300)
    jerks = np.array([snap_bounded_at(arc, t, until)[3] for t in times])
    accelerations = np.array([beam_at(arc, t)[2] for t in times])
    rounding = 1e-9 * (1.0 + np.abs(jerks).max() + np.abs(accelerations).max())
    assert np.all(np.abs(jerks) <= jerk_bound + rounding)
    assert np.all(np.abs(np.diff(jerks)) <= snap_bound * np.diff(times) + rounding)
    assert np.all(np.abs(np.diff(accelerations)) <= jerk_bound * np.diff(times) + rounding)


def test_the_jerk_is_the_rate_of_the_acceleration_at_resonance() -> None:
    row = tone_row(1e-9, 60.0, 0.01, 0.05)
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, 1e-3, GRAVITY, 0.0), row, 0.2, 0.02, -0.5)
    h = 1e-5
    assert arc.resonant
    for tau in (0.3, 0.9, 1.5):
        slope = (beam_at(arc, tau + h)[2] - beam_at(arc, tau - h)[2]) / (2.0 * h)
        assert snap_bounded_at(arc, tau, float(row[1]))[3] == pytest.approx(slope, rel=1e-6)


def test_an_undamped_beam_at_resonance_grows_linearly_to_the_last_digits() -> None:
    row = tone_row(0.0, 3000.0, 0.01, 0.01)
    row[5] = 0.0
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, 0.0, 0.0, 0.0), row, 0.0, 0.0, 0.0)
    for t in (0.1, 1.9, 40.0, 80.0):
        expected = 0.005 * (math.sin(NATURAL * t) - NATURAL * t * math.cos(NATURAL * t))
        assert beam_at(arc, t)[0] == pytest.approx(expected, abs=1e-11 * NATURAL * t)


@pytest.mark.parametrize("damping", [30.0, 1e4, 1e8])
def test_a_strongly_damped_beam_returns_to_rest(damping: float) -> None:
    still = np.array([0.0, 1e3, *[0.0] * 10])
    arc = arc_from(MASS, System(MASS, 0.0, STIFFNESS, damping, 0.0, 0.0), still, 0.0, 0.1, 0.0)
    decay = 0.5 * damping / MASS
    quick = decay + math.sqrt(decay**2 - NATURAL**2)
    slow = NATURAL**2 / quick
    for t in (1.0, 10.0, 100.0):
        x, v, a, *_ = beam_at(arc, t)
        assert x == pytest.approx(0.1 * quick / (quick - slow) * math.exp(-slow * t), rel=1e-12)
        assert v == pytest.approx(-slow * x, rel=1e-12)
        assert a == pytest.approx(slow**2 * x, abs=1e-12 * STIFFNESS * x / MASS)


def beam_of(damping: float) -> dict[str, float]:
    return {"mass": MASS, "stiffness": STIFFNESS, "damping": damping}


def ramped(damping: float, frequency: Any, height: float, duration: float) -> Scene:
    driven = {"amplitude": RAMP, "frequency": frequency}
    shown: dict[str, Any] = {"duration": duration, "steady_window": [0.75 * duration, duration]}
    return STANDARD.with_(beam=beam_of(damping), excitation=driven, ceiling={"height": height}, **shown)


@pytest.mark.parametrize("damping", [0.0, 1e-12, 1e-7])
def test_every_fidelity_integrates_an_undamped_beam_at_resonance(damping: float) -> None:
    scene = ramped(damping, NATURAL / (2.0 * math.pi), 0.5, 2.0)
    soft = simulate(scene, "soft", 1e-8, check=False)
    assert soft.amplitude == pytest.approx(0.0785433765, rel=1e-5)  # LSODA, undamped
    assert abs(soft.energy_residual) < 1e-6
    assert simulate(scene, "impact", check=False).amplitude == pytest.approx(soft.amplitude, rel=0.03)
    closed = simulate(ramped(damping, "resonance", 0.017, 4.0), "simplified", check=False)
    assert closed.amplitude == pytest.approx(0.4848831217, rel=1e-6)
    assert abs(closed.energy_residual) < 1e-9


@pytest.mark.parametrize("damping", [0.0, 0.56, 24.0, 1e3, 4e5])
@pytest.mark.parametrize("height", [0.017, 0.2, 5.0])
def test_the_ledger_of_one_mass_closes(damping: float, height: float) -> None:
    scene = STANDARD.with_(beam=beam_of(damping), ceiling={"height": height}, duration=4.0, steady_window=[3.0, 4.0])
    assert abs(simulate(scene, "simplified", check=False).energy_residual) < 1e-8


@pytest.mark.parametrize("damping", [0.56, 24.0, 4e5])
def test_a_slow_drive_and_a_strong_damper_cost_nothing(damping: float) -> None:
    slow = {"amplitude": 0.01, "frequency": 0.01}
    scene = STANDARD.with_(beam=beam_of(damping), excitation=slow, ceiling={"height": 0.017})
    scene = scene.with_(duration=2e6, steady_window=[2e6 - 200.0, 2e6])
    result = simulate(scene, "simplified", check=False)
    assert result.steps < 10_000  # in 20 000 periods of the drive and ten million of the beam
    assert result.amplitude == pytest.approx(0.01, rel=1e-5)
    assert abs(result.energy_residual) < 1e-6


XTOLS = [1e-3, 1e-6, 2e-12]
FUNCTIONS: list[Callable[[float, float], float]] = [
    lambda x, a: math.exp(x) - math.exp(a),
    lambda x, a: (x - a) ** 3 + 0.1 * (x - a),
    lambda x, a: math.copysign(abs(x - a) ** 0.3, x - a),
    lambda x, a: 1.0 if x > a else -1.0,
]


@given(st.sampled_from(FUNCTIONS), st.floats(-3, 3), st.floats(-60, -4), st.floats(4, 12), st.sampled_from(XTOLS))
def test_a_root_is_that_of_scipy_to_the_last_digit(
    function: Callable[[float, float], float], at: float, low: float, high: float, xtol: float
) -> None:
    ours = root(lambda x: function(x, at), low, high, xtol)
    assert ours == brentq(lambda x: function(x, at), low, high, xtol=xtol)
    with pytest.raises(ValueError, match="sign"):
        root(lambda x: x * x + 1.0, -1.0, 1.0)


RATE = 1000.0
TIMES = np.arange(4000) / RATE


def decay(ratio: float, frequency: float = 5.0) -> np.ndarray:
    """Return a decaying cosine whose successive peaks have this ratio."""
    return np.asarray(0.1 * ratio ** (-frequency * TIMES) * np.cos(2.0 * np.pi * frequency * TIMES))


def test_a_decay_has_one_decrement_and_a_tone_its_amplitude() -> None:
    # all but the first: the release is no turning point of a decaying cosine
    assert quantities.decrements(decay(1.31))[1:] == pytest.approx(1.31, rel=2e-4)
    tone = 0.3 + 0.02 * np.sin(2.0 * np.pi * 5.47 * TIMES)
    assert quantities.amplitude_spectrum(tone, RATE)[1].max() == pytest.approx(0.02, rel=0.01)


ROOT = Path(str(atpid_sim.engine.__file__)).parents[2]


def kernels_of(module: ModuleType) -> set[Dispatcher]:
    named = (value.compiled if isinstance(value, law_kernel.kernel) else value for value in vars(module).values())
    return {kernel for kernel in named if isinstance(kernel, Dispatcher)}


def sources_imported_by(module: ModuleType) -> Iterator[Path]:
    """Files of the project from which a module takes names."""
    for node in ast.walk(ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("atpid_"):
            place = ROOT.joinpath(*node.module.split("."))
            taken = [place / f"{alias.name}.py" for alias in node.names] if place.is_dir() else [place]
            yield from (path.with_suffix(".py") for path in taken)


@pytest.mark.parametrize("package", [atpid_sim.engine, atpid_sim.contact], ids=lambda p: p.__name__)
def test_kernels_name_their_error_model_let_threads_run_and_are_cached_with_what_they_import(
    package: ModuleType,
) -> None:
    kernels, imported = set(), set()
    for found in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{found.name}")
        kernels |= kernels_of(module)
        if any(kernel.__module__ == module.__name__ for kernel in kernels_of(module)):
            imported |= set(filter(Path.exists, sources_imported_by(module)))
    assert len(kernels) > 5
    options = [one.targetoptions for one in kernels]
    assert all(one.get("error_model") == "numpy" and one.get("nogil") for one in options)
    assert len(imported) > 3
    assert imported <= KERNEL_SOURCES
