# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs: levels against closed forms, initial states, windows, errors stated, the structure without the damper."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from sim_refusals import refused

from atpid_sim.engine import columns
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.modal import bare_amplitude
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.scene import Scene, SceneError, load_scene, standard_bench
from atpid_sim.scene.scene import scene_from_mapping
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.simulation.energy import Ledger
from atpid_sim.simulation.fidelity import choose, closed_error, impact_error
from atpid_sim.simulation.integration import Integration, Observation, amplitude_without_damper, drive_table, impact_log
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.simulation.simulate import simulate, trajectory, verdicts
from atpid_sim.system import Array, reduced_mass

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")
#: Samples a period of the excitation.
_SAMPLES = 400


@pytest.mark.parametrize("fidelity", ["impact", "finite", "soft"])
def test_a_run_begun_from_the_state_of_another_continues_it(fidelity: str) -> None:
    """The state after whole periods of the tone is the first one of a scene of its own."""
    scene = standard_bench(excitation={"amplitude": 0.01, "frequency": 5.0}, duration=4.0, steady_window=[3.0, 4.0])
    whole = trajectory(scene, 5.0 * _SAMPLES, fidelity, rtol=1e-9)
    in_flight = (whole.grain - whole.beam > 1e-3) & (np.arange(len(whole.time)) % _SAMPLES == 0)
    place = int(np.flatnonzero(in_flight)[1])
    # the grain's velocity from its parabola over two samples: exact but for rounding
    step = whole.time[1]
    grain_velocity = (whole.grain[place + 1] - whole.grain[place - 1]) / (2.0 * step)
    begun = {
        "displacement": float(whole.beam[place]) + scene.static_deflection,
        "velocity": float(whole.beam_velocity[place]),
        "grain_height": float(whole.grain[place] - whole.beam[place]),
        "grain_velocity": grain_velocity,
    }
    continued = scene.with_(initial=begun, duration=1.0, steady_window=[0.0, 1.0])
    again = trajectory(continued, 5.0 * _SAMPLES, fidelity, rtol=1e-9)
    for name in ("beam", "grain", "beam_velocity"):
        expected = getattr(whole, name)[place : place + len(again.time)]
        np.testing.assert_allclose(getattr(again, name), expected, atol=1e-6 * np.abs(expected).max())


def test_a_grain_thrown_from_the_floor_flies_a_parabola() -> None:
    still, thrown = {"amplitude": 0.0, "frequency": 1.0}, {"grain_velocity": 3.0}
    scene = standard_bench(ceiling={"height": 10.0}, initial=thrown, duration=0.3, excitation=still)
    motion = trajectory(scene, 1000.0)
    flight = -scene.static_deflection + 3.0 * motion.time - 0.5 * 9.81 * motion.time**2
    np.testing.assert_allclose(motion.grain, flight, atol=1e-12)
    assert len(motion.impacts) == 0


def test_a_beam_begun_from_a_displacement_is_the_free_decay() -> None:
    free = standard_bench(excitation={"free": {"deflection": 0.1}}, duration=2.0, steady_window=[0.0, 2.0])
    still = free.with_(excitation={"amplitude": 0.0, "frequency": 1.0}, initial={"displacement": 0.1})
    one, other = (trajectory(scene, 500.0, "soft") for scene in (still, free))
    np.testing.assert_allclose(one.beam, other.beam, atol=1e-9)


def test_the_energy_of_a_run_begun_in_motion_is_balanced() -> None:
    initial = {"displacement": -0.02, "velocity": 0.7, "grain_height": 0.05, "grain_velocity": -2.0}
    result = simulate(standard_bench(initial=initial))
    assert abs(result.energy_residual) < 1e-5
    assert result.impacts > 50


@pytest.mark.parametrize(
    ("initial", "parts"),
    [
        ({"grain_height": 0.19}, "initial.grain_height 0.19 clearance"),
        ({"grain_height": -0.1}, "initial.grain_height -0.1 0 1e+06"),
        ({"velocity": 1.0, "grain_velocity": 0.5}, "initial.grain_velocity 0.5 velocity 1"),
        ({"displacment": 0.1}, "initial.displacment displacement"),
        ({"velocity": "1 m/s"}, "initial.velocity '1 m/s' number m/s"),
        (0.1, "initial 0.1 displacement velocity grain_height grain_velocity"),
    ],
)
def test_what_cannot_be_is_one_line(initial: Any, parts: str) -> None:
    with refused(SceneError, *parts.split()):
        standard_bench(initial=initial)
    free = standard_bench(excitation={"free": {"deflection": 0.1}}).to_mapping()
    with refused(SceneError, "excitation.free.deflection"):  # a deflection is given once
        scene_from_mapping(free | {"initial": {"displacement": 0.1}})


def test_the_closed_damper_of_a_scene_whose_grain_begins_in_the_air() -> None:
    """Beam and grain as one mass: the ratio of successive peaks is that of the damped oscillator, in closed form."""
    free, lifted = {"free": {"deflection": 0.1}}, {"grain_height": 0.05}
    scene = standard_bench(excitation=free, ceiling={"height": 0.2}, initial=lifted, duration=6.0)
    ratio = scene.beam.damping / (2.0 * math.sqrt(scene.beam.stiffness * scene.total_mass))
    expected = math.exp(2.0 * math.pi * ratio / math.sqrt(1.0 - ratio**2))
    assert simulate(scene, check=False).undamped_decrement == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("ceiling", [{"height": 0.017}, {"closed": 0.017, "open": 0.2, "start": 1.0, "end": 2.0}])
def test_under_a_closed_ceiling_the_grain_begins_on_the_floor(ceiling: dict[str, float]) -> None:
    start = {"displacement": 0.01, "grain_height": 0.05, "grain_velocity": 1.0}
    scene = standard_bench(ceiling={"height": 0.2}, initial=start)
    assert scene.with_(ceiling=ceiling).to_mapping()["initial"] == {"displacement": 0.01}
    with refused(SceneError, "grain_height", "0.05", "clearance"):
        scene.with_(height=0.05)


#: Regular at 0.2 m, irregular at 0.35 m, regular again.
PROFILE = [[0.0, 0.2], [12.0, 0.2], [12.5, 0.35], [24.0, 0.35], [24.5, 0.2], [36.0, 0.2]]
WINDOWS = [(10.0, 12.0), (22.0, 24.0), (34.0, 36.0)]


def test_one_window_is_judged_as_a_run() -> None:
    scene = standard_bench(tolerance=1e-5)
    verdict, result = verdicts(scene, [scene.steady_window])[0], simulate(scene)
    assert verdict is not None
    assert (verdict.reproducible, verdict.spread) == (result.reproducible, result.spread)
    assert verdict.error < 1e-4


def test_the_irregular_window_is_named_and_no_other() -> None:
    changing = standard_bench(ceiling={"profile": PROFILE}, duration=36.0, tolerance=1e-4, steady_window=[34.0, 36.0])
    found = verdicts(changing, WINDOWS)
    assert [verdict is not None and verdict.reproducible for verdict in found] == [True, False, True]
    assert found[1] is not None
    assert found[1].spread is not None


@settings(max_examples=5)
@given(st.floats(0.1, 60.0), st.floats(2.0, 50.0), st.floats(0.05, 0.2), st.floats(0.5, 1.5))
def test_the_closed_form_is_the_motion_of_an_independent_integration(
    mass: float, frequency: float, ratio: float, detuning: float
) -> None:
    own, amplitude = 2.0 * np.pi * frequency, 0.003
    stiffness, damping, omega = mass * own**2, 2.0 * ratio * own * mass, own * detuning

    def slope(t: float, state: list[float]) -> list[float]:
        support, speed = amplitude * np.sin(omega * t), amplitude * omega * np.cos(omega * t)
        return [state[1], (stiffness * (support - state[0]) + damping * (speed - state[1])) / mass]

    settled = 10.0 / (ratio * own)
    times = np.linspace(settled, settled + 2.0 * np.pi / omega, 400)
    motion = solve_ivp(slope, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-8, atol=1e-12).y[0]
    found = bare_amplitude(mass, stiffness, damping, amplitude, omega / (2.0 * np.pi))
    assert found == pytest.approx(half_peak_to_peak(motion), rel=2e-4)


def test_a_run_states_its_reduction_against_the_structure_without_the_damper() -> None:
    scene = STANDARD
    result, beam = simulate(scene, check=False), scene.beam
    expected = bare_amplitude(beam.mass, beam.stiffness, beam.damping, 0.01, scene.natural_frequency_hz)
    assert result.bare_amplitude == pytest.approx(expected, rel=1e-12)
    assert result.reduction == pytest.approx(1.0 - result.amplitude / expected, rel=1e-12)
    assert result.efficiency > result.reduction > 0.0


def test_what_is_no_constant_tone_is_simulated_without_the_damper(tmp_path: Path) -> None:
    scene = STANDARD.with_(duration=40.0, steady_window=[38.0, 40.0])
    times = np.arange(0.0, 40.01, 0.002)
    rows = np.column_stack([times, 0.01 * np.sin(2.0 * np.pi * scene.natural_frequency_hz * times)])
    np.savetxt(tmp_path / "tone.csv", rows, delimiter=",", header="t,x", comments="")
    series = {"file": str(tmp_path / "tone.csv"), "time": "t", "displacement": "x"}
    measured = scene.with_(excitation={"series": series})
    assert amplitude_without_damper(measured) == pytest.approx(amplitude_without_damper(scene), rel=1e-4)
    assert np.isnan(amplitude_without_damper(scene.with_(excitation={"free": {"deflection": 0.1}})))


SYSTEMS = 24


def with_modulus(modulus: float, **changes: Any) -> Scene:
    contact = {"law": "tsuji", "young_modulus": modulus, "poisson_ratio": 0.2, "damping_ratio": 1.0}
    return STANDARD.with_(contact=contact, **changes)


def drawn(closed: bool) -> Iterator[Scene]:
    """Random scenes: rubber to steel, every kind of play, near resonance."""
    rng = np.random.default_rng(8)
    for _ in range(SYSTEMS):
        modulus, amplitude = 2.1e8 * 10.0 ** rng.uniform(-3.0, 3.0), rng.uniform(1e-3, 5e-2)
        play, fraction, ratio = rng.uniform(0.0, 0.3), rng.uniform(0.025, 0.3), rng.uniform(0.7, 1.3)
        yield with_modulus(
            modulus,
            grain={"mass_fraction": fraction, "radius": 0.0085},
            excitation={"amplitude": amplitude, "frequency": ratio * STANDARD.natural_frequency_hz},
            ceiling={"height": 0.017 if closed else 0.0175 + play},
            tolerance=1e-4,
        )


@pytest.mark.parametrize(("fidelity", "stated"), [("impact", impact_error), ("simplified", closed_error)])
def test_what_is_stated_is_seldom_exceeded(fidelity: str, stated: Callable[[Scene], float]) -> None:
    def one(scene: Scene) -> tuple[bool, float]:
        try:
            cheap = simulate(scene, fidelity)
            soft = simulate(scene, "soft", rtol=1e-6)
        except NumericalFailure as failure:
            if "deeper" not in str(failure):  # rubber
                raise
            return False, math.nan
        return cheap.reproducible and soft.reproducible, abs(cheap.amplitude / soft.amplitude - 1.0) / stated(scene)

    shares = np.array([share for _, (sound, share) in on_all_cores(one, drawn(fidelity == "simplified")) if sound])
    assert len(shares) > SYSTEMS / 3
    assert np.mean(shares <= 1.0) >= 0.85
    assert np.median(shares) > 0.01  # a bound far above every error would be useless


def test_the_standard_task_states_little_more_than_it_costs() -> None:
    measured = abs(simulate(STANDARD, "impact", check=False).amplitude / 0.0456498937 - 1.0)
    assert measured <= impact_error(STANDARD) <= 3.0 * measured


def test_auto_does_not_take_impacts_for_rubber() -> None:
    assert choose(with_modulus(2.1e8, tolerance=1e-2)).fidelity == "impact"
    assert choose(with_modulus(2.1e5, tolerance=1e-2)).fidelity == "soft"
    closed = {"ceiling": {"height": 0.017}, "tolerance": 1e-3}
    assert choose(with_modulus(2.1e8, **closed)).fidelity == "simplified"
    assert choose(with_modulus(2.1e5, **closed)).fidelity == "soft"


def test_where_nothing_moves_no_error_is_stated() -> None:
    still = STANDARD.with_(excitation={"amplitude": 0.0, "frequency": "resonance"}, gravity=0.0)
    assert impact_error(still) == closed_error(still) == 1.0
    assert choose(still).fidelity == "soft"


Counters = NDArray[np.int64]
#: Changes the state vector and the counters of a run before it begins.
Prepare = Callable[[Array, Counters], None]
LAWS: list[dict[str, Any]] = [
    {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 0.2},
    {"law": "hertz", "young_modulus": 2.1e8, "poisson_ratio": 0.2},
    {"law": "linear", "stiffness": 1e5, "restitution": 0.5},
    {"law": "lee_herrmann", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping": 20.0},
    {"law": "kuwabara_kono", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping": 1000.0},
    {"law": "walton_braun", "stiffness": 1e5, "restitution": 0.6},
]
NAMES = [f"{law['law']}-{index}" for index, law in enumerate(LAWS)]
#: A beam so soft and heavy that it is a free mass during a contact; no gravity.
FREE: dict[str, Any] = {
    "beam": {"mass": 0.3258, "stiffness": 1e-6, "damping": 0.0},
    "excitation": {"free": {"deflection": 0.0}},
    "gravity": 0.0,
    "ceiling": {"height": 3.0},
}


def scene_of(contact: dict[str, Any], **changes: Any) -> Scene:
    return standard_bench(
        **({"ceiling": {"height": 0.2}, "contact": contact, "duration": 1.0, "tolerance": 1e-8} | changes)
    )


def ran(
    scene: Scene, fidelity: str = "soft", rtol: float = 1e-9, prepare: Prepare | None = None
) -> tuple[Array, Counters, Array, Ledger]:
    """State, counters and impact log after a run; `prepare(y, n)` may change the start."""
    integration = Integration(scene, fidelity, rtol)
    table, state, log = drive_table(scene), integration.initial_state(), impact_log(1000)
    if prepare:
        prepare(state.y, state.n)
    first = state.copy()
    outcome = integration.advance(state, table, Observation(scene.steady_window, impacts=log), 10_000_000)
    assert outcome == Outcome.DONE, outcome.sentence
    ledger = integration.ledger(first, state, table)
    return state.y, state.n, log[: state.n[columns.IMPACTS]], ledger


def approach(speed: float) -> Prepare:
    """A grain that flies toward a floor at rest, far from any other influence."""

    def prepare(y: Array, n: Counters) -> None:
        n[columns.MODE] = columns.FREE
        y[columns.GRAIN] = y[columns.BEAM] + 1e-3
        y[columns.GRAIN_VELOCITY] = -speed

    return prepare


@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_a_bounce_has_the_restitution_of_its_law(contact: dict[str, Any]) -> None:
    scene = scene_of(contact, **FREE, duration=0.03)
    y, _n, log, ledger = ran(scene, prepare=approach(0.5))
    assert len(log) == 1
    assert log[0, columns.E_SPEED] == pytest.approx(0.5, rel=1e-6)
    after = y[columns.GRAIN_VELOCITY] - y[columns.BEAM_VELOCITY]
    e = restitution_of(contact_of(scene), 0.5, reduced_mass(system_of(scene)))
    assert after / 0.5 == pytest.approx(e, rel=2e-5, abs=1e-5)
    # momentum and energy: what is lost is what restitution takes
    system = system_of(scene)
    momentum = system.beam_mass * y[columns.BEAM_VELOCITY] + system.grain_mass * y[columns.GRAIN_VELOCITY]
    assert momentum == pytest.approx(-0.5 * system.grain_mass, rel=1e-6)
    taken = 0.5 * reduced_mass(system) * 0.25 * (1.0 - e * e)
    assert ledger.contact_loss == pytest.approx(taken, rel=1e-4, abs=1e-9)


def test_tsuji_restitution_is_the_published_one_at_every_speed() -> None:
    scene = scene_of(LAWS[0], **FREE, duration=0.12)
    for speed in (0.01, 0.1, 1.0, 5.0):
        y, *_ = ran(scene, prepare=approach(speed))
        assert (y[columns.GRAIN_VELOCITY] - y[columns.BEAM_VELOCITY]) / speed == pytest.approx(0.1463, abs=2e-4)


@pytest.mark.parametrize("fidelity", ["soft", "finite", "impact"])
@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_energy_closes_and_contacts_only_dissipate(contact: dict[str, Any], fidelity: str) -> None:
    # an elastic grain without play never comes to rest between instantaneous impacts: leave it some
    closed = 0.02 if contact["law"] == "hertz" else 0.017
    scene = scene_of(contact, ceiling={"closed": closed, "open": 0.15, "start": 0.4, "end": 0.6}, duration=2.0)
    *_, ledger = ran(scene, fidelity, 1e-8)
    assert abs(ledger.residual) <= (1e-4 if fidelity == "finite" else 1e-6)  # a table is not exact
    assert ledger.contact_loss >= 0.0
    assert ledger.beam_loss >= 0.0


@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_error_falls_with_the_tolerance(contact: dict[str, Any]) -> None:
    scene = scene_of(contact, duration=0.5)
    exact = ran(scene, rtol=1e-12)[0][columns.BEAM]
    errors = [abs(ran(scene, rtol=rtol)[0][columns.BEAM] - exact) for rtol in (1e-4, 1e-6, 1e-8)]
    # without damping in the contact small errors grow from bounce to bounce
    assert errors[2] <= (1e-8 if contact.get("damping_ratio", 0.0) else 1e-6)
    assert errors[2] <= 0.01 * errors[0]


def test_a_grain_at_rest_sinks_to_its_static_overlap() -> None:
    scene = scene_of(LAWS[0], excitation={"amplitude": 0.0, "frequency": "resonance"}, duration=3.0)
    y, n, _log, _ledger = ran(scene)
    k_c = contact_of(scene).parameters[0]
    assert n[columns.MODE] == columns.ON_FLOOR
    assert y[columns.BEAM] - y[columns.GRAIN] == pytest.approx((scene.grain_mass * 9.81 / k_c) ** (2 / 3), rel=1e-4)
