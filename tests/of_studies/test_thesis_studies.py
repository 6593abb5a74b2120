# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Study files, sweeps and rows: what a row compares, what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_sim.analysis import amplitude_spectrum
from atpid_sim.kernel_inputs import contact_of
from atpid_sim.scene import standard_bench
from studies.thesis import page, study
from studies.thesis.measured import Measured
from studies.thesis.measures import MEASURES
from studies.thesis.measures.driven import specific_damping
from studies.thesis.measures.free import dominant_frequency
from studies.thesis.points import Job, jobs, matches
from studies.thesis.rows import rows_of, shown
from studies.thesis.study import Expected, Study, StudyError

SCENE = standard_bench()


def rows(expected: dict[str, Any], values: list[float | str], quantity: str = "reduction") -> Any:
    """Return the rows of a study that found these values at h = 1, 2, 3, ... m."""
    points = [Job(number, {"height": float(number + 1)}, SCENE) for number in range(len(values))]
    made = Study(title="", section="1", measure="steady",
                 rows=[Expected.model_validate({"figure": "Fig. 1", "quantity": quantity} | expected)])  # fmt: skip
    return rows_of(made, points, [Measured({quantity: value}) for value in values])


@pytest.mark.parametrize(
    ("thesis", "ours", "within", "agrees"),
    [
        (50, 52.9, None, True),  # 3 points of a percentage
        (50, 53.1, None, False),
        (50, 55.0, 6.0, True),
        ("> 3", 3.1, None, True),
        ("> 3", 2.9, None, False),
        ("< 35", 34.0, None, True),
        ("< 35", 44.0, None, False),
        ("mixed", "mixed", None, True),
        ("mixed", "optimal", None, False),
        (None, 12.0, None, None),
    ],
)
def test_what_counts_as_agreement(thesis: Any, ours: Any, within: float | None, agrees: bool | None) -> None:
    (row,) = rows({"thesis": thesis, "within": within}, [ours])
    assert row.agrees is agrees


def test_a_quantity_that_is_no_percentage_agrees_within_a_share() -> None:
    assert [row.agrees for row in rows({"thesis": 2.0}, [2.09, 2.11], "decrement")] == [True, False]


def test_a_row_stands_for_each_point_or_for_all() -> None:
    each = rows({"thesis": [10, 20]}, [11.0, 22.0])
    assert [(row.quantity, row.thesis, row.difference) for row in each] == [
        ("reduction of the amplitude: h = 1 m", 10, 1.0),
        ("reduction of the amplitude: h = 2 m", 20, 2.0),
    ]
    (largest,) = rows({"thesis": 20, "reduce": "max", "at": {"height": [1.0, 2.0]}}, [11.0, 22.0, 99.0])
    assert (largest.ours, largest.difference) == (22.0, 2.0)
    (line,) = rows({"reduce": "line", "thesis": "> 0.99"}, [1.0, 2.0, 3.001])
    assert line.ours == pytest.approx(1.0, abs=1e-6)
    (word,) = rows({"thesis": "sticking", "same": ["mixed"]}, ["mixed"])
    assert word.agrees


@pytest.mark.parametrize(
    ("expected", "words"),
    [
        ({"thesis": [1, 2, 3]}, "3 numbers for 2 points"),
        ({"at": {"height": 7.0}}, "no point of the sweep"),
        ({"quantity": "decrement"}, "no point of the sweep has decrement"),
        ({"reduce": "median"}, "allowed: line, max"),
        ({"reduce": "max", "thesis": [1, 2]}, "one number is needed"),
    ],
)
def test_a_row_that_cannot_be_is_refused(expected: dict[str, Any], words: str) -> None:
    with pytest.raises(StudyError, match=words):
        rows(expected, [1.0, 2.0])


def test_points_are_matched_by_value_or_list() -> None:
    assert matches({"height": 0.2, "amplitude": 0.01}, {"height": [0.1, 0.2]})
    assert not matches({"height": 0.2}, {"height": 0.1})
    assert not matches({"height": 0.2}, {"amplitude": 0.01})


def swept(sweep: dict[str, list[Any]], **extra: Any) -> list[Job]:
    return jobs(Study(title="", section="1", measure="steady", rows=[], sweep=[sweep], **extra), Path("scenes"))


def test_a_sweep_changes_the_scene() -> None:
    opening = {"ceiling": {"closed": 0.017, "open": 0.2, "start": 6.0, "end": 7.0}}
    (first, second) = swept({"mass_fraction": [0.2], "height": [0.017, 0.1]}, scene=opening)
    assert first.scene.ceiling.heights == ((0.0, 0.017),)
    assert second.scene.ceiling.heights == ((6.0, 0.017), (7.0, 0.1))
    assert second.scene.grain.mass_fraction == 0.2
    (off,) = swept({"mass_fraction": [0.2], "frequency_ratio": [0.9]})
    assert off.scene.frequency_hz == pytest.approx(0.9 * off.scene.natural_frequency_hz)
    (small,) = swept({"radius": [0.005]}, scene=opening)
    assert small.scene.ceiling.heights[0] == (6.0, 0.01)


def test_instantaneous_impacts_keep_the_restitution() -> None:
    (one,) = swept({"mass_fraction": [0.1]}, instantaneous=True)
    assert one.scene.contact.law == "impact"
    assert float(contact_of(one.scene).parameters[0]) == pytest.approx(0.1463, abs=1e-4)


def test_an_unknown_key_of_a_sweep_is_refused() -> None:
    with pytest.raises(StudyError, match="given colour"):
        swept({"colour": [1.0]})


def test_every_study_has_a_measure_and_panels_that_find_points() -> None:
    for name in study.names():
        one = study.load(name)
        assert one.measure in MEASURES, name
        points = jobs(one, Path(__file__).parents[2] / "scenes")
        for panel in one.panels:
            assert any(matches(job.point, panel.at) for job in points), (name, panel.title)
            assert (panel.curve is None) != (panel.y is None), (name, panel.title)


def test_a_study_file_that_does_not_fit_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "odd.yaml").write_text("{title: a, section: '1', measure: steady, rows: [], colour: red}")
    monkeypatch.setattr(study, "FOLDER", tmp_path)
    with pytest.raises(StudyError, match=r"odd\.yaml: colour"):
        study.load("odd")


def test_numbers_are_shown_with_their_digits() -> None:
    assert [shown(value, 3) for value in (0.123456, 0.0, float("nan"), "word", None)] == [
        "0.123",
        "0",
        "none",
        "word",
        "",
    ]
    assert shown(np.float64(1234567.0), 4) == "1.235e+06"
    (row,) = rows({"thesis": 50, "why": "a reason"}, [60.0])
    assert page.cells(row)[2:] == ["60", "50", "+10 **differs**", "a reason"]


@pytest.mark.parametrize("ratio", [1.05, 0.95])
def test_specific_damping_and_frequency_of_a_decay_that_are_known(ratio: float) -> None:
    time = np.arange(4000) / 1000.0
    decay = 0.1 * ratio ** (-5.47 * time) * np.cos(2.0 * np.pi * 5.47 * time)
    assert specific_damping(decay)[3:10] == pytest.approx(1.0 - ratio**-2, abs=1e-3)
    tone = 0.3 + 0.02 * np.sin(2.0 * np.pi * 5.47 * time)
    assert dominant_frequency(*amplitude_spectrum(tone, 1000.0)) == pytest.approx(5.47, abs=0.005)
