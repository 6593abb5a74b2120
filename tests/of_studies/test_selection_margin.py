# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A margin found by a deadline: its systems, what it guarantees, and the threads it is computed on."""

import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from atpid_control.loop.settings import selector_of
from atpid_control.selection import Excitation, SelectionError
from atpid_control.selection.deadline import Deadline, OutOfTimeError
from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.margin import Robust, robust_height
from atpid_control.selection.uncertain import MarginBox, points, systems_of
from atpid_control.selection.workers import SelectionThreads
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.maps import DamperResponse
from atpid_sim.robust import with_restitution
from atpid_sim.scene import Scene, load_scene
from atpid_sim.system import reduced_mass
from studies.cli import main

ROOT = Path(__file__).parents[2]
UNHURRIED = 60.0


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(ROOT / "scenes" / "standard.yaml")


def test_the_corners_are_a_two_level_design() -> None:
    corners = points()[:32]
    assert len({tuple(corner) for corner in corners.tolist()}) == 32  # all of them
    first = corners[:16]
    assert np.array_equal(first.T @ first, 16.0 * np.eye(5))  # main effects clear of each other
    products = [first[:, i] * first[:, j] for i in range(5) for j in range(i)]
    assert all(abs(one @ other) < 1e-9 for k, one in enumerate(products) for other in products[:k])
    assert (np.abs(points()) <= 1.0).all()


def test_the_systems_differ_by_their_uncertainties(scene: Scene) -> None:
    damper = DamperResponse(scene, 1e-5)
    found = systems_of(scene, damper, MarginBox(0.05, 1e-3, 0.01, 0.002, 0.1))
    assert len(found) == 1 + len(points())
    assert found[0].damper is damper
    masses = {round(one.damper.system.beam_mass / damper.system.beam_mass, 6) for one in found}
    stiffnesses = {round(one.damper.system.stiffness / damper.system.stiffness, 6) for one in found}
    assert masses == {0.99, 1.0, 1.01}
    assert stiffnesses == {0.95, 1.0, 1.05}
    assert all(one.damper.system.grain_mass == pytest.approx(damper.system.grain_mass) for one in found)
    assert {one.offset for one in found[1:]} == {1e-3, -1e-3}
    ways = {one.approach(damper, 0.1, 3.0) for one in found}
    assert len(ways) == 4  # at once, slowly, and from half the clearance in two phases
    assert all(way[-1][1] == 0.1 for way in ways)
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
    assert "in 123 of 123 sampled systems" in margin.note
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
    assert "not ended within 0.0005 s: the price of the margin is unknown" in searched.note
    assert "in 1 of 123 sampled systems" in margin.note  # the expected one
    assert "late: " in margin.note
    assert safe.late
    assert safe.note == f"the search {searched.note}; {margin.note}"
    assert "of 0.001 s" in margin.note


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
        return robust_height(systems, excitation, 0.235, limits, map, Counted(questions))

    complete = ended_after(math.inf)
    assert complete.verified == complete.sampled == 123
    found = [ended_after(questions) for questions in (0, 3, 20, 80, 100, 120)]
    assert found[0].evaluations == 1  # the expected system
    for questions, one in zip((0, 3, 20, 80, 100, 120), found, strict=True):
        assert damper.diameter < one.height <= 0.235
        assert 1 <= one.verified <= 123
        assert one.evaluations <= questions + 1
        assert one.worst >= one.amplitude
    assert ended_after(2 * complete.evaluations) == complete


def test_without_the_bare_optimum_a_margin_begins_with_a_look(scene: Scene) -> None:
    damper = DamperResponse(scene, 1e-5)
    systems = systems_of(scene, damper, MarginBox())
    excitation, limits = Excitation(0.01, 6e-4, damper.frequency), (damper.diameter, 0.5)
    given, looked = (robust_height(systems, excitation, bare, limits, map, lambda: False) for bare in (0.235, math.nan))
    assert looked.height == pytest.approx(given.height, rel=0.06)
    assert looked.worst == pytest.approx(given.worst, rel=0.05)


def test_a_deadline_in_lockstep_depends_on_no_clock(scene: Scene) -> None:
    values = {"stiffness_uncertainty": 0.02, "selection_deadline": 1e-3}
    selector = selector_of(values.__getitem__, "direct", scene, None, lockstep=True)
    assert "in 123 of 123 sampled systems" in selector.select(Excitation(0.01, 2e-4), 3.0).note
    hurried = selector_of(values.__getitem__, "direct", scene, None, lockstep=False)
    assert "in 1 of 123 sampled systems" in hurried.select(Excitation(0.01, 2e-4), 3.0).note


def test_runs_are_begun_while_time_is_left() -> None:
    def twice(job: int) -> int:
        return 2 * job

    unlimited = Deadline(math.inf)
    assert unlimited.limited(map, 0.5) is map
    assert not unlimited.passed()
    begun = Deadline(UNHURRIED)
    assert list(begun.limited(map, 0.5)(twice, [1, 2])) == [2, 4]
    assert not begun.passed(0.5)
    assert not begun.near(0.5)
    assert 0.0 < begun.spent < UNHURRIED
    over = Deadline(1e-9)
    assert over.passed()
    assert over.near(1.0)
    with pytest.raises(OutOfTimeError):
        list(over.limited(map, 0.5)(twice, [1, 2]))


@pytest.mark.parametrize("deadline", [0.0, -1.0, math.nan])
def test_an_impossible_deadline_is_refused(scene: Scene, deadline: float) -> None:
    with pytest.raises(SelectionError, match="deadline"):
        DirectSelector(scene, deadline=deadline)


def test_workers_answer_in_order_whoever_does_the_job() -> None:
    with SelectionThreads(3) as workers:
        assert workers.map(lambda job: job * job, range(100)) == [k * k for k in range(100)]
        assert workers.map(lambda job: job, []) == []
    with SelectionThreads(1) as alone:
        assert alone.map(lambda job: -job, [1, 2]) == [-1, -2]


def test_an_error_of_any_job_is_raised() -> None:
    with SelectionThreads(2) as workers, pytest.raises(ZeroDivisionError):
        workers.map(lambda job: 1 / job, [1, 2, 0, 3])


def test_a_job_whose_thread_is_held_up_is_done_again() -> None:
    caller, begun, done = threading.get_ident(), threading.Event(), threading.Event()

    def work(job: int) -> int:
        if threading.get_ident() != caller:  # as a thread that waits for its processor
            begun.set()
            done.wait(UNHURRIED)
        elif job == 0:
            begun.wait(UNHURRIED)
        return job

    with SelectionThreads(2) as workers:
        asked = time.monotonic()
        assert workers.map(work, range(4)) == [0, 1, 2, 3]
        assert time.monotonic() - asked < UNHURRIED
        done.set()


@pytest.mark.slow
def test_the_command_puts_its_table_into_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    begin, end = "<!-- made by python -m studies selection-speed -->", "<!-- end -->"
    page.write_text(f"before\n{begin}\nold\n{end}\nafter\n", encoding="utf-8")
    main(["selection-speed", "--systems", "1", "--busy", "1", "--page", str(page)])
    text = capsys.readouterr().out
    assert "| systems held out | 1 |" in text
    assert page.read_text(encoding="utf-8") == f"before\n{begin}\n{text}{end}\nafter\n"
    row = next(line for line in text.splitlines() if "best, worst" in line)
    assert float(row.split("|")[2].removesuffix(" % ")) < 5.0
