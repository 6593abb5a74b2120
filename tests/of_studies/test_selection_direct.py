# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selectors: `direct`, its search and margin, against brute force and beyond their ranges."""

import math
import re
import threading
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from sim_refusals import has_parts, refused

from atpid_control.loop.settings import selector_of
from atpid_control.selection import Excitation, SelectionError, make_selector
from atpid_control.selection.direct import Deadline, DirectSelector, OutOfTimeError, SelectionThreads, guaranteed
from atpid_control.selection.margin import MarginBox, MarginSearch, Robust, points, systems_of
from atpid_control.selection.pca_models import simplified
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.maps import FROM_CLOSED, DamperResponse, Timing, WindowResponse, best_height
from atpid_sim.maps.ratings import Approach
from atpid_sim.robust import with_beam, with_restitution
from atpid_sim.scene import Scene, load_scene, scene_from_mapping, standard_bench
from atpid_sim.simulation.integration import undamped_amplitude
from atpid_sim.system import reduced_mass
from studies.figures.selection import margin_curve, pca_errors
from studies.thorough_search import thorough_best

ROOT = Path(__file__).parents[2]
UNHURRIED = 600.0


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(ROOT / "scenes" / "standard.yaml")


def test_where_the_ceiling_is_counts(scene: Scene) -> None:
    # at 8 mm and 30 % the grain leaves the ceiling for good when it is lowered from above (docs/selection.md)
    selector = DirectSelector(scene.with_(mass_fraction=0.3))
    closed, above = selector.select(Excitation(0.008)), selector.select(Excitation(0.008), height=0.10)
    assert closed.beam_amplitude < 0.97 * above.beam_amplitude


def test_the_range_of_the_ceiling_is_kept() -> None:
    low = load_scene(ROOT / "scenes" / "thesis_4_3.yaml").with_(
        ceiling={"closed": 0.017, "range": [0.017, 0.3], "speed": 0.3, "controller": "direct"}
    )
    assert DirectSelector(low).select(Excitation(0.03)).height <= 0.3


@pytest.mark.parametrize("amplitude", [0.015, 0.03, 0.04])
def test_the_margin_keeps_out_of_rumble_where_the_bare_optimum_falls_in(amplitude: float) -> None:
    # what docs/figures/selection_margin.png shows
    shown = margin_curve(amplitude, count=5)
    assert shown.bare.max() > 0.25
    assert shown.safe.max() < 0.25
    assert shown.safe_height < shown.bare_height
    assert 0.0 < shown.price < 0.05


def test_without_gravity_the_pca_is_as_good_as_in_the_thesis() -> None:
    # what docs/figures/selection_pca_error.png shows: Fig. 4.43, about 4 %, at every amplitude
    amplitudes = np.geomspace(0.003, 0.1, 4)
    free, heavy = (pca_errors(amplitudes, gravity=gravity) for gravity in (False, True))
    assert float(np.median(np.abs(free.before))) < 0.08
    assert float(np.max(free.lost_after)) < 0.03
    assert float(np.max(np.abs(free.direct))) < 0.015  # a per cent of height below the best costs 0.2 % of amplitude
    assert float(np.max(free.lost_direct)) < 0.01
    assert float(np.max(heavy.lost_direct[amplitudes > 0.01])) < 0.01


def test_the_systems_differ_by_their_uncertainties(scene: Scene) -> None:
    assert len({tuple(corner) for corner in points()[:32].tolist()}) == 32  # all corners
    damper = DamperResponse(scene, 1e-5)
    found = systems_of(scene, damper, MarginBox(0.05, 1e-3, 0.01, 0.002, 0.1))
    assert len(found) == 1 + len(points())
    assert {round(one.damper.system.beam_mass / damper.system.beam_mass, 6) for one in found} == {0.99, 1.0, 1.01}
    assert {round(one.damper.system.stiffness / damper.system.stiffness, 6) for one in found} == {0.95, 1.0, 1.05}
    assert {one.offset for one in found[1:]} == {1e-3, -1e-3}
    assert len({one.approach(damper, 0.1, 3.0) for one in found}) == 4  # at once, slowly, half way up in two phases
    assert max(one.frequency for one in found) == 1.002


CONTACTS = [
    {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    {"law": "linear", "stiffness": 1e5, "restitution": 0.3},
    {"law": "linear", "stiffness": 1e5, "damping": 20.0},
    {"law": "impact", "restitution": 0.5},
]


@pytest.mark.parametrize("contact", CONTACTS, ids=lambda contact: "-".join(contact))
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_the_restitution_of_a_law_is_changed_as_asked(scene: Scene, contact: dict[str, object], factor: float) -> None:
    given = scene.with_(contact=contact)
    mass = reduced_mass(system_of(given))
    changed = with_restitution(given, factor)
    assert changed is not None
    before, after = (restitution_of(contact_of(one), 1.0, mass) for one in (given, changed))
    assert after == pytest.approx(factor * before, rel=1e-9)


def test_without_a_hurry_a_margin_holds_in_every_system(scene: Scene) -> None:
    selector = DirectSelector(scene, deadline=UNHURRIED)
    bare, safe = selector.select(Excitation(0.01)), selector.select(Excitation(0.01, 2e-4), 3.0)
    assert safe.height < bare.height
    margin = next(stage for stage in safe.stages if stage.name == "margin")
    assert re.search("123.*123", margin.note)
    assert "late" not in margin.note
    assert margin.amplitude >= safe.beam_amplitude
    again = selector.select(Excitation(0.01, 2e-4), 3.0)
    assert (again.height, again.beam_amplitude) == (safe.height, safe.beam_amplitude)


def test_at_its_deadline_a_margin_states_what_it_holds_for(scene: Scene) -> None:
    hurried = DirectSelector(scene, deadline=1e-3)
    safe = hurried.select(Excitation(0.01, 2e-4), 3.0)
    assert safe.height <= hurried.select(Excitation(0.01)).height
    assert math.isnan(safe.price)
    searched, margin = safe.stages
    assert "0.0005 s" in searched.note
    assert re.search(r"\b1 of 123\b", margin.note)  # the expected one
    assert re.search(r"late.*0\.001 s", margin.note)
    assert safe.late
    has_parts(safe.note, (searched.note, margin.note))


class Counted:
    """Whether the time has passed, in questions instead of seconds."""

    def __init__(self, questions: float) -> None:
        self.left = questions

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


def test_whenever_it_is_ended_there_is_an_answer_and_no_more_runs(scene: Scene) -> None:
    damper = DamperResponse(scene, 1e-5)
    systems = systems_of(scene, damper, MarginBox())
    excitation, limits = Excitation(0.01, 6e-4, damper.frequency), (damper.diameter, 0.5)

    def ended_after(questions: float) -> Robust:
        return MarginSearch(systems, excitation, limits, map, Counted(questions)).found(0.235)

    complete = ended_after(math.inf)
    assert complete.verified == complete.sampled == 123
    assert ended_after(0).evaluations == 1  # the expected system
    for questions in (0, 3, 20, 80, 100, 120):
        one = ended_after(questions)
        assert damper.diameter < one.height <= 0.235
        assert 1 <= one.verified <= 123
        assert one.evaluations <= questions + 1
        assert one.worst >= one.amplitude
    assert ended_after(2 * complete.evaluations) == complete


def test_a_deadline_in_lockstep_depends_on_no_clock(scene: Scene) -> None:
    values = {"stiffness_uncertainty": 0.02, "selection_deadline": 1e-3}
    selector = selector_of(values.__getitem__, "direct", scene, None, lockstep=True)
    hurried = selector_of(values.__getitem__, "direct", scene, None, lockstep=False)
    notes = [one.select(Excitation(0.01, 2e-4), 3.0).note for one in (selector, hurried)]
    assert [re.findall(r"(\d+) of 123", note) for note in notes] == [["123"], ["1"]]


def test_runs_are_begun_while_time_is_left(scene: Scene) -> None:
    assert not Deadline(math.inf).passed()
    begun, over = Deadline(UNHURRIED), Deadline(1e-9)
    assert list(begun.limited(map, 0.5)(abs, [-1, 2])) == [1, 2]
    assert [begun.passed(0.5), begun.near(0.5), over.passed(), over.near(1.0)] == [False, False, True, True]
    with pytest.raises(OutOfTimeError):
        list(over.limited(map, 0.5)(abs, [1, 2]))
    for deadline in (0.0, -1.0, math.nan):
        with pytest.raises(SelectionError, match="deadline"):
            DirectSelector(scene, deadline=deadline)


def test_workers_answer_in_order_and_an_error_of_any_job_is_raised() -> None:
    for threads in (1, 3):
        with SelectionThreads(threads) as workers:
            assert workers.map(lambda job: job * job, range(100)) == [k * k for k in range(100)]
            assert workers.map(lambda job: job, []) == []
            with pytest.raises(ZeroDivisionError):
                workers.map(lambda job: 1 / job, [1, 2, 0, 3])


def test_a_job_whose_thread_is_held_up_is_done_again() -> None:
    caller, begun, done = threading.get_ident(), threading.Event(), threading.Event()
    waited_for: list[bool] = []

    def work(job: int) -> int:
        if threading.get_ident() != caller:  # as a thread that waits for its processor
            begun.set()
            waited_for.append(not done.wait(UNHURRIED))
        elif job == 0:
            begun.wait(UNHURRIED)
        return job

    with SelectionThreads(2) as workers:
        assert workers.map(work, range(4)) == [0, 1, 2, 3]
        assert waited_for == []
        done.set()


NATURAL = standard_bench().natural_frequency_hz


def tone(ratio: float, amplitude: float = 0.015, **changes: object) -> Scene:
    """Return the standard bench under a tone at a ratio to its natural frequency."""
    return standard_bench(excitation={"amplitude": amplitude, "frequency": ratio * NATURAL}, **changes)


@pytest.mark.parametrize("ratio", [0.5, 0.8, 0.95, 1.0, 1.03, 1.1, 1.4, 2.0])
def test_the_predicted_amplitude_is_the_lesser_of_two_simulated_beams(ratio: float) -> None:
    """The closed damper and the beam without its grain, each integrated until its transient is gone."""
    scene = tone(ratio, ceiling={"height": 0.017}, duration=40.0, steady_window=[38.0, 40.0])
    closed = undamped_amplitude(scene)
    light = scene.with_(mass_fraction=1e-6)
    bare = undamped_amplitude(light)
    predicted = simplified(system_of(scene), scene.frequency_hz, 0.015).amplitude
    assert predicted == pytest.approx(min(closed, bare), rel=1e-3)


@pytest.mark.parametrize(("ratio", "share"), [(0.85, 1.4), (0.95, 1.0), (1.0, 0.7), (1.05, 0.8), (1.1, 1.0)])
def test_the_best_height_lies_below_the_first_guess_of_its_frequency(ratio: float, share: float) -> None:
    damper = DamperResponse(tone(ratio), 1e-4)
    guess = simplified(damper.system, damper.frequency, 0.015).amplitude * math.pi
    assert guess == pytest.approx(damper.ballistic_clearance(0.015))
    best = thorough_best(damper, 0.015)
    assert 0.15 * guess < best.height - damper.diameter < share * guess


@pytest.mark.parametrize("method", ["pca", "direct"])
def test_where_the_grain_is_not_lifted_nothing_is_simulated_and_it_stays_closed(method: str) -> None:
    chosen = make_selector(method, tone(1.0)).select(Excitation(0.015, frequency=0.55 * NATURAL))
    assert (chosen.height, chosen.efficiency, chosen.evaluations) == (0.017, 0.0, 0)
    assert chosen.beam_amplitude == pytest.approx(DamperResponse(tone(0.55)).closed_amplitude(0.015))
    has_parts(chosen.no_use, ("0.015 m", "3.008 Hz", "closed"))


def test_where_every_height_is_worse_it_stays_closed() -> None:
    """12.6 m/s^2 lift the grain, but no height takes a hundredth off the beam."""
    chosen = make_selector("direct", tone(0.7, 0.01)).select(Excitation(0.01))
    assert chosen.height == 0.017
    assert chosen.evaluations > 50
    assert chosen.no_use


@pytest.mark.parametrize("method", ["pca", "direct"])
def test_an_undamped_beam_is_refused_at_resonance_alone_and_a_stiff_one_at_large_amplitudes(method: str) -> None:
    undamped = standard_bench(beam={"mass": 0.3258, "stiffness": 427.6, "damping": 0.0})
    selector = make_selector(method, undamped)
    with refused(SelectionError, method, "damping", "resonance"):
        selector.select(Excitation(0.01))
    assert selector.select(Excitation(0.01, frequency=1.2 * undamped.natural_frequency_hz)).height >= 0.017
    # at 1 mm the grain would be pressed deeper into a wall than its radius
    stiff = standard_bench(beam={"mass": 1.2, "stiffness": 3.0e5, "damping": 6.0})
    selector = make_selector(method, stiff)
    with refused(SelectionError, "deeper"):
        selector.select(Excitation(0.02))
    assert 0.017 < selector.select(Excitation(5e-5)).height < 0.1


def test_frequencies_beyond_half_and_twice_the_natural_one_are_refused() -> None:
    selector = make_selector("direct", tone(1.0))
    for ratio in (0.49, 2.01):
        with refused(SelectionError, "2.735", "10.94 Hz"):
            selector.select(Excitation(0.015, frequency=ratio * NATURAL))


SYSTEMS: dict[str, Any] = yaml.safe_load((Path(__file__).parent / "systems.yaml").read_text(encoding="utf-8"))


def damper_of(scene: Scene) -> tuple[DamperResponse, float]:
    """Return the damper of a scene, and the amplitude of its drive."""
    return DamperResponse(scene, 1e-6), float(scene.excitation.amplitude_points[0][1])


def approached(
    damper: DamperResponse, amplitude: float, height: float, approaches: Sequence[Approach] = FROM_CLOSED
) -> list[WindowResponse]:
    """Return what a height shows long after the ceiling has come to it on several paths."""
    settle = max(min(10.0 * damper.decay_periods, 800.0), 120.0)
    ways = [approach(damper, height, 0.5 * settle * damper.period) for approach in approaches]
    return [damper.follow(amplitude, way, Timing(4.0 * settle, 32.0)) for way in ways]


@pytest.mark.parametrize("name", SYSTEMS["selection"])
def test_direct_is_as_good_as_brute_force(name: str) -> None:
    """Where a narrower search took another height, and with modes under a force."""
    scene = scene_from_mapping(SYSTEMS["selection"][name]["scene"])
    damper, amplitude = damper_of(scene)
    found = approached(damper, amplitude, DirectSelector(scene).select(Excitation(amplitude)).height)
    assert all(one.regular for one in found)
    assert max(one.amplitude for one in found) <= 1.02 * SYSTEMS["selection"][name]["best"]


def test_a_motion_of_three_or_four_periods_is_regular_where_that_is_asked_for() -> None:
    damper, amplitude = damper_of(scene_from_mapping(SYSTEMS["periods of three or four"]))
    height = damper.diameter + 0.1779 * np.pi * damper.closed_amplitude(amplitude)
    state = damper.closed_state(amplitude)
    assert not damper.follow_on(amplitude, state, ((0.0, height),), Timing(600.0, 16.0)).regular
    later = ((state.time, height),)
    assert not damper.follow_on(amplitude, state.copy(), later, Timing(16.0, 16.0)).regular
    assert damper.follow_on(amplitude, state.copy(), later, Timing(16.0, 16.0, 4)).regular


def test_under_a_margin_the_motion_is_regular_in_its_box() -> None:
    scene, box, random = scene_from_mapping(SYSTEMS["margin"]), MarginBox(), np.random.default_rng(7)
    _, amplitude = damper_of(scene)
    chosen = DirectSelector(scene, deadline=UNHURRIED).select(Excitation(amplitude, 0.05 / 3.0 * amplitude), 3.0)
    least = re.match(r"least efficiency (\S+)", chosen.note)
    assert least
    for k, point in enumerate([*np.eye(5), *-np.eye(5), *random.choice([-1.0, 1.0], (8, 5))]):
        size, frequency, mass, stiffness, restitution = point.tolist()
        varied = with_beam(scene, mass=1.0 + mass * box.mass, stiffness=1.0 + stiffness * box.stiffness)
        varied = with_restitution(varied, 1.0 + restitution * box.restitution) or varied
        damper, _ = damper_of(varied.with_(frequency=scene.frequency_hz * (1.0 + frequency * box.frequency)))
        driven = amplitude * (1.0 + 0.05 * size)
        (found,) = approached(damper, driven, chosen.height, [FROM_CLOSED[k % len(FROM_CLOSED)]])
        assert found.regular
        reached = 1.0 - found.amplitude / damper.closed_amplitude(driven)
        assert reached >= float(least[1]) - 2e-3


@pytest.mark.parametrize(
    ("verified", "irregular", "bound", "none"), [(9, 0, True, False), (8, 0, False, False), (9, 1, False, True)]
)
def test_a_least_efficiency_is_a_bound_only_where_all_is_verified_and_regular(
    verified: int, irregular: int, bound: bool, none: bool
) -> None:
    robust = Robust(0.2, 0.03, 0.05, 0.43219, verified, 9, irregular, 40)
    note = guaranteed(robust, Deadline(60.0)).note
    assert bool(re.search(r"\bno\s+bound", note)) != bound
    assert note.startswith("no") == none
    assert "0.412" in note  # rounded down, less what lies between the systems


#: Left out: here better heights are reached only after longer irregular transients than either search waits for, and
#: rounding decides which of them finds one (docs/research/selection.md, what falls short).
LUCK = (0.2, 0.01)


@pytest.mark.parametrize(
    ("fraction", "amplitude"),
    [one for one in product((0.02, 0.1, 0.2, 0.3), (0.005, 0.01, 0.03, 0.07)) if one != LUCK][::2],
)
def test_the_amplitude_is_at_most_four_parts_in_a_thousand_above_that_of_the_thorough_search(
    scene: Scene, fraction: float, amplitude: float
) -> None:
    damper = DamperResponse(scene.with_(mass_fraction=fraction), 1e-5)
    assert best_height(damper, amplitude).amplitude <= 1.004 * thorough_best(damper, amplitude).amplitude


def test_of_heights_equally_good_the_lowest_is_taken(scene: Scene) -> None:
    # at 2 mm the grain never reaches a ceiling above 43 mm: everything from there on is equally good
    damper = DamperResponse(scene, 1e-5)
    assert thorough_best(damper, 0.002).height == pytest.approx(0.0434, rel=0.01)
    assert best_height(damper, 0.002).height == pytest.approx(0.0434, rel=0.02)  # in steps of a hundredth
