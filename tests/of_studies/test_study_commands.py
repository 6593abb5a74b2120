# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each study makes its result for its least size; the measured free decays; kernels that are compiled ahead."""

import itertools
import re
from pathlib import Path

import pytest

from atpid_control.identification import linear
from atpid_sim.scene import standard_bench
from studies import designs, modal, peace01, time_base
from studies.cli import main
from studies.figures import free_decay
from studies.identification import coverage
from studies.tradeoff.measure import measure, reference_of, with_front

#: A study, the arguments of its least size, and a pattern of what it prints.
CASES = {
    "designs": ("--draws 1 --seed 1 --points 2 --page {}", r"farthest.*0\.\d"),
    "extremes": ("--systems 4 --seed 7 --fidelities impact --out {}", r"\| impact \|"),
    "identification": ("--signals 2 --seed 1 --page {}", r"\| white noise, 1 % \| 2 \|"),
    "modes": ("--systems 1 --seed 11", r"impacts, median +\d"),
    "off-resonance": ("--systems 1 --seed 8 --json", '"brute": 0.499'),
    "peace01": ("--order 15", "multiplier"),
    "planar": ("--systems 1 --seed 3 --page {}", r"\| friction \|"),
    "random-selection": ("--systems 1 --seed 2 --only direct --page {}", r"\| systems \| 1 \|"),
    "selection-speed": ("--systems 1 --busy 1 --page {}", r"\| systems held out \| 1 \|"),
    "steady": ("--systems 1 --seed 4 --workers 1 --page {}", r"\| all \| 1 \| 1 \| 1 \| 1 \|"),
    "sweep": ("--points 4 --rtol 1e-2 --fidelity impact --steady", '"steady": '),
    "time-base": ("--pairs 1 --signals 1 --page {}", r"\| sweep of"),
}


@pytest.fixture
def least_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(designs, "STRUCTURES", {})
    monkeypatch.setattr("studies.designs.SYSTEMS", 2)
    monkeypatch.setattr(coverage, "CASES", {"white noise, 1 %": coverage.CASES["white noise, 1 %"]})
    drawn = modal.drawn
    monkeypatch.setattr(modal, "drawn", lambda rng: drawn(rng).with_(duration=0.8, steady_window=[0.4, 0.8]))
    monkeypatch.setattr("studies.modal.LONGEST", 4e-4)
    monkeypatch.setattr("studies.modal.REPEATS", 1)
    monkeypatch.setattr(peace01, "SPAN", (0.8, 1.1))
    monkeypatch.setattr("studies.peace01.CHECKED", 2)
    monkeypatch.setattr("studies.peace01.STEP", 2e-2)
    monkeypatch.setattr(time_base, "HOUR", 700.0)


@pytest.mark.usefixtures("least_sizes")
@pytest.mark.parametrize("name", CASES)
def test_a_study_makes_its_result(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, pattern = CASES[name]
    page = tmp_path / "page.md"
    begin = f"before\n<!-- made by python -m studies {name} -->\n"
    end = f"<!-- end of {name} -->" if name in ("planar", "random-selection") else "<!-- end -->"
    into_a_page = "--page" in arguments and name != "designs"  # which makes the whole page
    if into_a_page:
        page.write_text(f"{begin}old\n{end}\nafter\n", encoding="utf-8")
    assert main([name, *arguments.format(page).split()]) == 0
    written = page.read_text(encoding="utf-8") if page.is_file() else ""
    assert re.search(pattern, capsys.readouterr().out + written)
    if into_a_page:
        assert written.startswith(begin)
        assert written.endswith(f"{end}\nafter\n")
        assert "old\n" not in written


def test_a_tradeoff_has_what_nothing_beats_and_levels_that_converge() -> None:
    short = standard_bench(
        duration=1.6, steady_window=[1.2, 1.6], ceiling={"closed": 0.017, "open": 0.1, "start": 0.6, "end": 0.7}
    )
    reference = reference_of(short)
    assert reference.agreement < 1e-8
    points = list(itertools.takewhile(lambda point: point.method != "lsoda", measure(short, reference)))
    error = {(point.method, point.tolerance): point.amplitude_error for point in points}
    assert error["soft", 1e-6] < 1e-5
    assert error["soft", 1e-8] < 1e-7
    assert error["finite", 1e-6] < 1e-3  # the damper is open for half a second: what was closed counts
    assert any(point.front for point in with_front(points))


@pytest.mark.parametrize("case", free_decay.MEASURED, ids=lambda case: f"{case.mass_fraction}-{case.height}")
def test_decrements_are_those_measured_on_the_stand(case: free_decay.Measurement) -> None:
    """The only real measurements there are: the free decays of thesis section 2.3.1."""
    largest = free_decay.decrements(free_decay.free_decay(case.mass_fraction, case.height)).max()
    if case.within is None:
        assert largest > case.decrement
    else:
        assert largest == pytest.approx(case.decrement, rel=case.within)


def test_the_cache_of_compiled_functions_covers_all_their_sources() -> None:
    package = Path(__file__).parents[2] / "atpid_control" / "atpid_control"
    users = {path.stem for path in package.rglob("*.py") if "\n@compiled\n" in path.read_text(encoding="utf-8")}
    assert users == set(linear.KERNELS)
