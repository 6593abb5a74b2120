# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The engine beside references, and at its edges: endless hops and impacts, budgets, long runs, extreme systems."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from extreme_systems import keep_every_guarantee
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import beta

from atpid_sim.contact.rebound_series import KUWABARA_KONO, LEE_HERRMANN, series_rebound
from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import contact_of
from atpid_sim.outcome import Outcome
from atpid_sim.scene import Scene, load_scene, standard_bench
from atpid_sim.simulation.energy import Ledger
from atpid_sim.simulation.integration import Integration, Observation
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.simulation.simulate import simulate, trajectory
from atpid_sim.system import Array
from studies.baselines import run_baseline
from studies.sweep.measure import standard_task
from studies.theory.closed_forms import hertz_impact
from studies.theory.two_impacts import TwoImpacts, symmetric_motions

SCENES = Path(__file__).parents[2] / "scenes"
SHORT = standard_bench(
    duration=1.6, steady_window=[1.2, 1.6], ceiling={"closed": 0.017, "open": 0.1, "start": 0.6, "end": 0.7}
)
SOLID = {"young_modulus": 2.1e8, "poisson_ratio": 0.2}
CONTACTS: list[dict[str, Any]] = [
    {"law": "linear", "stiffness": 1e5, "damping": 20.0},
    {"law": "lee_herrmann", **SOLID, "damping": 50.0},
    {"law": "kuwabara_kono", **SOLID, "damping": 2e3},
    {"law": "tsuji", **SOLID, "damping_ratio": 0.3},
]


@pytest.mark.parametrize("contact", CONTACTS, ids=lambda contact: contact["law"])
def test_the_engine_and_a_baseline_agree_on_every_law(contact: dict[str, Any]) -> None:
    """Two programs with nothing in common but the right-hand side's formulas."""
    scene = SHORT.with_(contact=contact)
    baseline = run_baseline(scene, "cash_karp", 1e-10).amplitude
    assert simulate(scene, "soft", rtol=1e-8, check=False).amplitude == pytest.approx(baseline, rel=1e-6)


def test_a_free_decay_and_a_steady_motion_of_the_closed_damper_are_the_textbook_s() -> None:
    closed = standard_bench(ceiling={"height": 0.017})
    mass, stiffness, damping = closed.total_mass, closed.beam.stiffness, closed.beam.damping
    decay, omega = 0.5 * damping / mass, 2.0 * math.pi * closed.frequency_hz
    damped = math.sqrt(stiffness / mass - decay**2)
    motion = trajectory(closed.with_(excitation={"free": {"deflection": 0.2}}), 200.0, "simplified")
    turned = damped * motion.time
    expected = 0.2 * np.exp(-decay * motion.time) * (np.cos(turned) + decay / damped * np.sin(turned))
    assert motion.beam + closed.static_deflection == pytest.approx(expected, abs=1e-9)
    spring = complex(stiffness, omega * damping)
    steady = 0.01 * abs(spring / (spring - mass * omega**2))
    assert steady == pytest.approx(0.2224, abs=5e-5)  # figure 3.11: 0.23 m, with the static deflection
    late = closed.with_(duration=60.0, steady_window=[58.0, 60.0])
    assert simulate(late, "simplified", check=False).amplitude == pytest.approx(steady, rel=1e-9)


def test_amplitudes_of_the_closed_damper_in_section_4_3() -> None:
    """The thesis reads 0.3, 0.85 and 0.65 m off figure 4.5; the second includes the transient's overshoot."""
    motion = trajectory(load_scene(SCENES / "thesis_4_3.yaml").with_(height=0.017), 500.0, "simplified")
    for first, last, expected, error in ((4.0, 6.0, 0.33, 0.01), (12.0, 13.0, 0.88, 0.02), (18.0, 20.0, 0.67, 0.01)):
        window = motion.beam[(motion.time >= first) & (motion.time <= last)]
        assert 0.5 * np.ptp(window) == pytest.approx(expected, abs=error)


def test_closed_forms_of_impacts_are_the_published_ones() -> None:
    # the support moves with amplitude 1, so the force is larger than 1 by the damper's share
    force = math.hypot(1.0, 0.02)
    (motion,) = symmetric_motions(TwoImpacts(0.1, 0.5, 20.0 / force))
    assert force * motion.peak == pytest.approx(3.42057194227, abs=5e-12)
    assert motion.multiplier < 1.0
    (narrow,) = symmetric_motions(TwoImpacts(0.1, 0.5, 10.0))
    assert narrow.multiplier > 1.0
    mass, stiffness = 2699.0 * 4.0 / 3.0 * math.pi * 0.1**3, 4.0 / 3.0 * 7e10 / (1.0 - 0.3**2) * math.sqrt(0.1)
    found = hertz_impact(stiffness, mass, 0.2)
    assert found.force == pytest.approx(11369.9, abs=0.05)
    assert 1e6 * found.overlap == pytest.approx(49.717, abs=5e-4)
    assert 1e6 * found.duration == pytest.approx(731.66, abs=5e-3)


def scipy_amplitude(scene: Scene) -> float:
    """Half peak-to-peak of the container by scipy, with Tsuji's force (Eqs 3.12 and 3.24) and without any event [m]."""
    modes = [scene.beam, *scene.further_modes]
    mass, stiffness, damping = (
        np.array([getattr(mode, name) for mode in modes]) for name in ("mass", "stiffness", "damping")
    )
    direct, rate = np.array([1.0, *(mode.drive_factor for mode in scene.further_modes)]), np.zeros(len(modes))
    if scene.drive == "support":
        direct[0] -= direct[1:].sum()
        direct, rate = direct * stiffness, direct * damping
    n, omega, size = len(modes), 2.0 * math.pi * scene.frequency_hz, scene.excitation.amplitude_points[0][1]
    grain, clearance = scene.grain_mass, scene.ceiling.heights[0][1] - 2.0 * scene.grain.radius
    elastic, damped = contact_of(scene).parameters[:2]
    weight = np.append(scene.beam.mass + grain, np.full(n - 1, grain)) * scene.gravity

    def push(overlap: float, closing: float) -> float:
        return max(0.0, elastic * overlap**1.5 + damped * closing * overlap**0.25) if overlap > 0.0 else 0.0

    def derivative(t: float, z: Array) -> Array:
        q, speed, x, v = z[:n], z[n : 2 * n], z[:n].sum(), z[n : 2 * n].sum()
        contact = push(x - z[-2], v - z[-1]) - push(z[-2] - x - clearance, z[-1] - v)
        driven = size * (direct * math.sin(omega * t) + rate * omega * math.cos(omega * t))
        force = driven - stiffness * q - damping * speed - contact
        force[0] -= scene.beam.mass * scene.gravity
        return np.concatenate((speed, force / mass, [z[-1], contact / grain - scene.gravity]))

    q = -weight / stiffness
    start, times = np.concatenate((q, 0.0 * q, [q.sum(), 0.0])), np.arange(*scene.steady_window, 1.0 / 4000.0)
    ran = solve_ivp(derivative, (0.0, times[-1]), start, "DOP853", times, rtol=1e-8, atol=1e-10, max_step=1e-3)
    return half_peak_to_peak(ran.y[:n].sum(axis=0))


@pytest.mark.parametrize("drive", [("support", 0.02), ("force", 4.0)], ids=lambda drive: drive[0])
def test_a_structure_of_several_modes_is_that_of_scipy(drive: tuple[str, float]) -> None:
    further = [
        {"mass": 1.2, "frequency": 17.0, "damping_ratio": 0.01, "drive_factor": -0.3},
        {"mass": 0.4, "frequency": 41.0, "damping_ratio": 0.03, "drive_factor": 0.2},
    ]
    scene = standard_bench(
        further_modes=further, drive=drive[0], excitation={"amplitude": drive[1], "frequency": 5.1},
        ceiling={"height": 0.12}, contact=CONTACTS[3], tolerance=1e-7, duration=0.8, steady_window=[0.4, 0.8],
    )  # fmt: skip
    integration = Integration(scene, "soft")
    last = integration.initial_state()
    integration.advance(last, integration.table, Observation(scene.steady_window))
    assert last.floor_impacts + last.ceiling_impacts > 5
    assert last.amplitude == pytest.approx(scipy_amplitude(scene), rel=2e-3)


def integrated_rebound(g: float, a: float) -> float:
    """Restitution by scipy: X'' + g X' X^a + X^1.5 = 0 from X = 0, X' = 1 until the force vanishes."""

    def force(_: float, z: Array) -> float:
        overlap = max(0.0, float(z[0]))
        return float(g * z[1] * overlap**a + overlap**1.5)

    force.terminal, force.direction = True, -1  # type: ignore[attr-defined]
    ran = solve_ivp(
        lambda t, z: [z[1], -force(t, z)], (0.0, 1e4), [1e-14, 1.0], "DOP853", rtol=1e-10, atol=1e-13, events=force
    )
    return float(-ran.y[1, -1])


SERIES_OF_LAWS = pytest.mark.parametrize(("a", "series"), [(0.0, LEE_HERRMANN), (0.5, KUWABARA_KONO)])


@pytest.mark.parametrize("g", [1e-5, 1e-4, 1e-3, 1e-2])
def test_kuwabara_kono_meets_the_published_series(g: float) -> None:
    """1 - 1.153449 g + 0.798267 g^2 + 0.266666 g^2.5 (Schwager and Poeschel, Phys. Rev. E 78 (2008) 051304)."""
    published = 1.0 - 1.153449 * g + 0.798267 * g**2 + 0.266666 * g**2.5
    assert series_rebound(g, 0.5, KUWABARA_KONO) == pytest.approx(published, abs=0.7 * g**3 + 5e-7 * g + 1e-8)


@SERIES_OF_LAWS
@settings(deadline=None)
@given(log_g=st.floats(-3.0, 0.5))
def test_the_series_meets_the_integral(a: float, series: np.ndarray, log_g: float) -> None:
    assert series_rebound(10.0**log_g, a, series) == pytest.approx(integrated_rebound(10.0**log_g, a), rel=1e-6)


@SERIES_OF_LAWS
def test_the_series_meets_both_ends(a: float, series: np.ndarray) -> None:
    """The loss along the undamped path, and the creep of a grain that damping alone has stopped."""
    power, q = 2.5 / (1.0 + a), 0.4 * (1.0 + a)
    weak = 0.8 * 1.25**q * beta(q, 1.5) / power
    strong = (1.0 + a) ** ((a - 1.5) / 2.5)
    assert np.polynomial.chebyshev.chebval([-1.0, 1.0], series) == pytest.approx([weak, strong], rel=1e-8)


@SERIES_OF_LAWS
def test_more_damping_never_gives_more_rebound(a: float, series: np.ndarray) -> None:
    assert [series_rebound(g, a, series) for g in (0.0, 5e-324, 1e-30)] == [1.0, 1.0, 1.0]
    assert series_rebound(math.inf, a, series) == 0.0
    assert math.isnan(series_rebound(math.nan, a, series))
    curve = np.array([series_rebound(g, a, series) for g in np.geomspace(1e-30, 1e60, 20_000)])
    assert (np.diff(curve) <= 0.0).all()
    assert (curve > 0.0).all()
    between = (curve < 1.0 - 1e-12) & (curve > 1e-80)
    assert (np.diff(curve[between]) < 0.0).all()


Counters = NDArray[np.int64]
#: Changes the state vector and the counters of a run before it begins.
Prepare = Callable[[Array, Counters], None]
ELASTIC: dict[str, Any] = {"law": "hertz", "young_modulus": 1.6e12, "poisson_ratio": 0.2}
UNDAMPED = {"mass": 0.3258, "stiffness": 427.6, "damping": 0.0}
TSUJI: dict[str, Any] = {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0}


def scene_of(contact: dict[str, Any], **changes: Any) -> Scene:
    grain, slow = {"mass_fraction": 0.01, "radius": 0.0085}, {"amplitude": 0.01, "frequency": 0.5}
    base = {"grain": grain, "excitation": slow, "ceiling": {"height": 0.2}, "duration": 20.0, "tolerance": 1e-4}
    return standard_bench(**(base | {"contact": contact} | changes))


def ran(
    scene: Scene, fidelity: str, rtol: float = 1e-4, limit: int | None = None, prepare: Prepare | None = None
) -> tuple[Outcome, State, Ledger]:
    integration = Integration(scene, fidelity, rtol)
    state = integration.initial_state()
    if prepare:
        prepare(state.y, state.n)
    first = state.copy()
    outcome = integration.advance(state, integration.table, Observation(scene.steady_window), limit)
    return outcome, state, integration.ledger(first, state, integration.table)


def dropped(height: float) -> Prepare:
    """Raise the grain before the run [m]."""

    def prepare(y: Array, n: Counters) -> None:
        n[columns.MODE] = columns.FREE
        y[columns.GRAIN] += height

    return prepare


@pytest.mark.parametrize("fidelity", ["soft", "impact"])
def test_endless_micro_bounces_are_replaced_by_static_contact(fidelity: str) -> None:
    """Dropped from nanometres under its weight it would hop 10^4 times a second for ever."""
    slow = {"excitation": {"amplitude": 0.6, "frequency": 0.02}, "grain": {"mass_fraction": 0.002, "radius": 0.0085}}
    scene = scene_of(ELASTIC, **slow)
    outcome, state, ledger = ran(scene, fidelity, prepare=dropped(1e-8 if fidelity == "soft" else 1e-10))
    assert outcome == Outcome.DONE
    assert 1000 < state.floor_impacts < 20_000
    assert state.mode == columns.ON_FLOOR
    assert abs(ledger.residual) < 1e-6
    assert ledger.contact_loss >= 0.0
    # at rest on the floor, beam and grain are one mass
    _, alone, _ = ran(scene_of(ELASTIC, ceiling={"height": 0.017}, **slow), "simplified")
    assert state.amplitude == pytest.approx(alone.amplitude, rel=1e-5)


@pytest.mark.parametrize("fidelity", ["soft", "impact"])
def test_hops_that_can_be_seen_go_on_and_a_lossy_grain_comes_to_rest(fidelity: str) -> None:
    """Elastic hops of a tenth of a millimetre lose nothing, however many."""
    scene = scene_of(ELASTIC, excitation={"amplitude": 1e-3, "frequency": 0.5})
    outcome, state, ledger = ran(scene, fidelity, prepare=dropped(1e-4))
    assert outcome == Outcome.DONE
    assert state.floor_impacts > 2000
    assert state.n[columns.LOW_HOPS] < 1000
    assert ledger.contact_loss == pytest.approx(0.0, abs=1e-9)
    assert state.grain != state.beam
    outcome, state, _ = ran(scene_of(TSUJI), fidelity, prepare=dropped(1e-6))
    assert outcome == Outcome.DONE
    assert state.floor_impacts < 10


@pytest.mark.parametrize("fidelity", ["soft", "impact", "simplified"])
def test_no_run_takes_more_steps_than_its_budget(fidelity: str) -> None:
    scene = scene_of(TSUJI, excitation={"amplitude": 0.05, "frequency": "resonance"})
    whole, state, _ = ran(scene, fidelity)
    assert whole == Outcome.DONE
    needed = state.steps
    for limit in (1, 7, needed // 3, needed - 1):
        outcome, state, _ = ran(scene, fidelity, limit=limit)
        assert outcome == Outcome.STEP_BUDGET
        assert state.steps <= limit


@pytest.mark.parametrize("law", [TSUJI, ELASTIC], ids=["tsuji", "hertz"])
def test_the_ledger_closes_at_a_kilohertz(law: dict[str, Any]) -> None:
    """The support's energy swings by a million times what it leaves in the beam."""
    fast = {"amplitude": 1e-4, "frequency": 1000.0}
    scene = scene_of(law, excitation=fast, gravity=0.0, duration=0.01, beam=UNDAMPED)
    outcome, _, ledger = ran(scene, "soft", rtol=1e-5)
    assert outcome == Outcome.DONE
    assert ledger.input > 0.0
    assert abs(ledger.residual) < 1e-4


def test_an_elastic_grain_between_near_walls_keeps_its_energy() -> None:
    """A thousand impacts of 1e-4 each would be a tenth: the contacts of an elastic grain are integrated more finely."""
    law, weak = ELASTIC | {"young_modulus": 1.3e9}, {"amplitude": 1e-4, "frequency": 3.0}
    near = {"ceiling": {"height": 0.019}, "gravity": 0.0}
    scene = scene_of(law, excitation=weak, duration=3.0, beam=UNDAMPED, **near)

    def thrown(y: Array, n: Counters) -> None:
        dropped(1e-3)(y, n)
        y[columns.GRAIN_VELOCITY] += 1.0

    outcome, state, ledger = ran(scene, "soft", prepare=thrown)
    assert outcome == Outcome.DONE
    assert state.floor_impacts + state.ceiling_impacts > 1000
    missing = ledger.stored - (ledger.input - ledger.beam_loss - ledger.contact_loss + ledger.ceiling_work)
    assert abs(missing) < 3e-3 * 0.5 * scene.grain_mass


@pytest.mark.parametrize("system", [693, 4325, 9041])
def test_a_grain_detached_at_the_very_surface_flies(system: int) -> None:
    """Lee-Herrmann without weight: rounding left it closing by 1e-17 m/s, for ever."""
    keep_every_guarantee(1, system, "soft")


def with_contact(scene: Scene, restitution: float | None) -> Scene:
    return scene if restitution is None else scene.with_(contact={"law": "impact", "restitution": restitution})


@pytest.mark.parametrize("elastic", [False, True], ids=["tsuji", "restitution"])
def test_a_ceiling_closes_at_any_speed(elastic: bool) -> None:
    """The last of the play would be taken by impacts without end."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        speed, height = 10.0 ** rng.uniform(-2.0, 1.0), rng.uniform(0.05, 0.5)
        closed = 2.0 + (height - 0.017) / speed
        profile, window = [[0.0, height], [2.0, height], [closed, 0.017]], [closed + 1.0, closed + 3.0]
        scene = standard_task(10.0 ** rng.uniform(-2.7, -1.1), rng.uniform(0.025, 0.3), 0.1)
        scene = scene.with_(ceiling={"profile": profile}, duration=closed + 3.0, steady_window=window)
        result = simulate(with_contact(scene, rng.random() if elastic else None), "impact", check=False)
        assert abs(result.energy_residual) < 1e-6


@pytest.mark.parametrize("restitution", [None, 0.0, 0.3, 0.9])
def test_a_sweep_is_carried(restitution: float | None) -> None:
    """A grain that touches as the wall begins to press, to within rounding, comes to rest."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        first, last = rng.uniform(3.0, 8.0, 2)
        swept = {"sweep": {"amplitude": 0.01, "from": float(first), "to": float(last), "duration": 10.0}}
        scene = standard_task(0.01, 0.1, 0.2).with_(excitation=swept, height=float(rng.uniform(0.03, 0.4)))
        scene = scene.with_(duration=12.0, steady_window=[8.0, 12.0])
        result = simulate(with_contact(scene, restitution), "impact", check=False)
        assert abs(result.energy_residual) < 1e-6


@given(index=st.integers(0, 100_000))
@example(index=24)  # elastic: what its contacts lose is below the error of a table, and not negative
@settings(max_examples=40, deadline=None, derandomize=True)
def test_an_extreme_system_keeps_every_guarantee(index: int) -> None:
    for fidelity in ("soft", "impact", "finite"):
        keep_every_guarantee(7, index, fidelity)


@pytest.mark.parametrize(
    "contact", [{"law": "impact", "restitution": 1.0}, ELASTIC | {"young_modulus": 2.1e8}], ids=["impact", "hertz"]
)
def test_an_elastic_grain_without_play_is_carried(contact: dict[str, Any]) -> None:
    scene = standard_bench(contact=contact, ceiling={"height": 0.017}, duration=2.0, steady_window=[1.0, 2.0])
    integration = Integration(scene, "impact")
    state = integration.initial_state()
    assert integration.advance(state, integration.table, limit=100_000) == Outcome.DONE
    assert state.grain == pytest.approx(state.beam, abs=1e-9)


def test_hundreds_of_thousands_of_periods_keep_their_phase() -> None:
    fast, late = {"amplitude": 0.001, "frequency": 1000.0}, {"duration": 200.0, "steady_window": [199.9, 200.0]}
    scene = standard_bench(excitation=fast, ceiling={"height": 0.017}, **late)
    omega = 2.0 * math.pi * 1000.0
    spring = complex(scene.beam.stiffness, scene.beam.damping * omega)
    steady = 0.001 * abs(spring / (spring - scene.total_mass * omega**2))
    assert simulate(scene, "simplified", check=False).amplitude == pytest.approx(steady, rel=1e-6)


@pytest.mark.parametrize(("fidelity", "periods"), [("impact", 1e5), ("soft", 1e4)])
def test_a_damper_works_for_a_hundred_thousand_periods(fidelity: str, periods: float) -> None:
    duration = periods / standard_bench().natural_frequency_hz
    window = {"duration": duration, "steady_window": [duration - 10.0, duration]}
    scene = standard_bench(ceiling={"height": 0.2}, tolerance=1e-4, **window)
    result = simulate(scene, fidelity, check=False)
    assert result.amplitude == pytest.approx(0.0456498937, rel=5e-3)
    assert abs(result.energy_residual) < 1e-4
    assert result.steps <= Integration(scene, fidelity).step_limit
