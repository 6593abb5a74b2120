# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pictures of README and docs, and the table of the atlas, show what is computed now.

No pixels are compared: each PNG carries the numbers of its curves (atpid_sim.figure_numbers). Those that take seconds
are drawn again and compared; the whole set is made by `make figures`.
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import atpid_sim as ap
from atpid_control.cli import main
from atpid_control.views.report import report
from atpid_sim.figure_numbers import Numbers, numbers_in, numbers_of
from atpid_sim.maps import HeightMap
from atpid_sim.scene import standard_bench
from studies.atlas.column import column_of
from studies.figures import contact, free_decay, mechanism, stand
from studies.figures import identification as identification
from studies.figures import selection as selection

ROOT = Path(__file__).resolve().parent.parent
PICTURES = sorted(ROOT.glob("docs/**/*.png"))
DRAWINGS = sorted(ROOT.glob("docs/**/*.svg"))
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]
#: Rows of docs/atlas.md: mass of the grain [%], support amplitude [mm], and the other cells.
ATLAS = re.findall(r"^\| (\d+) % \| (\d+) \| (.+) \|$", (ROOT / "docs/atlas.md").read_text(), re.MULTILINE)
#: Of the largest value on the axis: what processors round otherwise is far below, a changed model above.
CLOSE = 0.01


def shown() -> dict[Path, Path]:
    """Return each picture a page shows, with that page."""
    found = re.compile(r"!\[[^]]*\]\(([^)\s]+)\)")
    return {(page.parent / name).resolve(): page for page in PAGES for name in found.findall(page.read_text())}


def cliffs_again(folder: Path) -> Numbers:
    picture = folder / "cliffs.png"
    options = ["--height", "0.19:0.3", "--frequencies", "5.2:5.75", "--picture", str(picture)]
    assert main(["cliffs", str(ROOT / "scenes/standard.yaml"), *options]) == 0
    return numbers_in(picture)


def grain_again(folder: Path) -> Numbers:
    report(ROOT / "bags/thesis_4_3_short", folder)
    return numbers_in(folder / "grain.png")


#: The pictures made again here, bench.png in test_graph.py; others take minutes, or show chaotic motion.
AGAIN: dict[str, Callable[[Path], Numbers]] = {
    "cliffs": cliffs_again,
    "grain": grain_again,
    "contact_laws": lambda folder: numbers_in(contact.draw(folder)[0]),
    "free_decay": lambda folder: numbers_in(free_decay.draw(folder)[0]),
    "identification_ramps": lambda folder: numbers_of(identification.draw_ramps()),
    "identification_spoiled": lambda folder: numbers_of(identification.draw_spoiled()),
    "identification_beam": lambda folder: numbers_of(identification.draw_beam()),
    "identification_watch": lambda folder: numbers_of(identification.draw_watch()),
    "selection_map": lambda folder: numbers_in(
        selection.draw_map(folder, HeightMap.load(ROOT / "atpid_control/config/maps/standard.npz"))
    ),
}


def test_every_picture_shown_exists_is_shown_and_carries_its_numbers() -> None:
    assert [f"{page.name}: {path.name}" for path, page in shown().items() if not path.is_file()] == []
    assert [path.name for path in (*PICTURES, *DRAWINGS) if path not in shown()] == []
    assert [path.name for path in PICTURES if not any(numbers_in(path).values())] == []


def test_the_drawings_and_the_table_of_the_stand_are_what_is_computed_now(tmp_path: Path) -> None:
    words = re.compile(r"<!-- (.*?) -->")  # matplotlib names each text that it draws
    made = stand.draw(tmp_path)
    others = {"mechanism.svg", "mechanism_moving.svg"}
    assert [path.name for path in made] == [path.name for path in DRAWINGS if path.name not in others]
    for drawing in made:
        now, printed = (words.findall(path.read_text()) for path in (drawing, ROOT / "docs/figures" / drawing.name))
        assert now == printed, f"{drawing.name} is out of date: run `make figures`"
    assert stand.table() in (ROOT / "docs/stand.md").read_text()


def test_the_mechanism_moves_as_it_is_simulated_now(tmp_path: Path) -> None:
    """Labels, the loops of what is regular, and what the labels state: the irregular motion is another everywhere."""
    words, chance = re.compile(r"<text.*?>(.*?)</text>"), mechanism.cases()[3]
    luck = {f"±{1e3 * chance.amplitude:.0f} mm", f"{100 * chance.amplitude / mechanism.without_damper():.0f} %"}
    for drawing in mechanism.draw(tmp_path):
        now, printed = (path.read_text() for path in (drawing, ROOT / "docs/figures" / drawing.name))
        old, new = words.findall(printed), words.findall(now)
        assert [one for one, other in zip(old, new, strict=True) if one != other and other not in luck] == []
        assert mechanism.numbers_of(ROOT / "docs/figures" / drawing.name)["right"] == pytest.approx(
            mechanism.numbers_of(drawing)["right"], rel=CLOSE
        )
    *regular, irregular = mechanism.cases()
    assert [each.motion for each in (*regular, irregular)] == ["closed", "sticking", "optimal", "irregular"]
    for each in regular:  # six periods, a loop without a seam, as far as the beam moves as simulated
        assert max(each.beam) - min(each.beam) == pytest.approx(2.0 * each.amplitude, rel=0.02)
        assert abs(each.beam[0] - each.beam[-len(each.beam) // 6]) < 0.02 * each.amplitude
    closed, low, right = (each.amplitude for each in regular)
    assert 3.0 * right < 2.0 * irregular.amplitude < 2.0 * low < 2.0 * closed
    # closed form: a beam alone on its support, at its own resonance
    alone = mechanism.SUPPORT * (1.0 + 4.0 * mechanism.DAMPING**2) ** 0.5 / (2.0 * mechanism.DAMPING)
    assert mechanism.without_damper() == pytest.approx(alone, rel=1e-6)


def test_the_grain_strikes_a_rising_floor_and_a_falling_ceiling() -> None:
    """As the labelled drawing states, once each in every period."""
    scene = mechanism.scene().with_(height=mechanism.cases()[2].height)
    periods = int((scene.duration - 10.0) * scene.frequency_hz)
    run = ap.trajectory(scene, t_eval=np.linspace(10.0, scene.duration, 256 * periods))
    struck = run.impacts[(run.impacts["time"] > 10.0)]
    velocity = np.interp(struck["time"], run.time, run.beam_velocity)
    assert np.all(velocity * struck["wall"] > 0.0)
    assert np.count_nonzero(struck["wall"] > 0) == pytest.approx(periods, abs=1)
    assert np.count_nonzero(struck["wall"] < 0) == pytest.approx(periods, abs=1)


def test_a_strip_s_limits_are_those_of_beam_theory() -> None:
    strip = stand.Strip("steel", 0.002, 206e9, 7850.0, 0.002)
    found = stand.limits_of(strip, 0.02)
    force = found.stiffness * found.tip  # at the tip; the moment at the clamp over the section's modulus is the stress
    stress = force * stand.LENGTH / (stand.WIDTH * strip.thickness**2 / 6.0)
    assert stress == pytest.approx(strip.modulus * strip.strain)
    # Rayleigh: 33/140 of the beam's mass moves with the tip
    mass = stand.TIP + 33.0 / 140.0 * strip.density * stand.WIDTH * strip.thickness * stand.LENGTH
    assert found.frequency == pytest.approx((found.stiffness / mass) ** 0.5 / (2.0 * 3.141592653589793), rel=2e-3)
    assert found.support == pytest.approx(2.0 * 0.02 * min(found.tip, 0.15))


@pytest.mark.parametrize("name", AGAIN)
def test_a_picture_shows_what_is_computed_now(name: str, tmp_path: Path) -> None:
    now, printed = AGAIN[name](tmp_path), numbers_in(ROOT / "docs/figures" / f"{name}.png")
    assert differences(printed, now) == [], f"{name}.png is out of date: run `make figures`"


def test_the_atlas_has_a_row_of_each_grain_and_amplitude() -> None:
    assert [tuple(map(int, row[:2])) for row in ATLAS] == [
        (5, 10), (5, 30), (10, 10), (10, 30), (20, 10), (20, 30), (30, 30)
    ]  # fmt: skip


@pytest.mark.parametrize(("percent", "millimetres", "printed"), ATLAS)
def test_best_heights_multipliers_and_cliffs_are_those_printed(percent: str, millimetres: str, printed: str) -> None:
    scene = standard_bench(grain={"mass_fraction": 0.01 * float(percent), "radius": 0.0085})
    column = column_of(scene, 1e-3 * float(millimetres), [0.1])
    best, stability = column.best, column.stability
    *numbers, loss = printed.split(" | ")
    height, efficiency, multiplier, cliff, distance, back = map(float, numbers)
    assert 1e3 * best.height == pytest.approx(height, abs=0.06)
    assert 100.0 * (1.0 - best.amplitude / column.closed) == pytest.approx(efficiency, abs=0.06)
    assert stability.largest == pytest.approx(multiplier, abs=1e-3)
    assert 1e3 * stability.cliff == pytest.approx(cliff, rel=1e-4, abs=0.06)
    assert 1e3 * (stability.cliff - best.height) == pytest.approx(distance, abs=0.06)
    assert 1e3 * (stability.cliff - stability.recovered) == pytest.approx(back, rel=0.02, abs=0.01)
    assert stability.loss.lower() == loss


def test_a_column_without_a_cliff_is_named() -> None:
    scene = standard_bench(grain={"mass_fraction": 0.3, "radius": 0.0085})
    assert column_of(scene, 0.01, [0.1]).stability.loss == "NONE"


def differences(printed: Numbers, now: Numbers, close: float = CLOSE) -> list[str]:
    """Describe each curve whose numbers are others; panels and curves must be the same."""
    one, other = ({panel: len(curves) for panel, curves in each.items()} for each in (printed, now))
    if one != other:
        return [f"other panels or curves: {list(printed)}, now {list(now)}"]
    return [
        f"{panel}, curve {place}: {before}, now {after}"
        for panel, curves in printed.items()
        for place, (before, after) in enumerate(zip(curves, now[panel], strict=True))
        if not alike(before, after, close)
    ]


def alike(one: list[float], other: list[float], close: float = CLOSE) -> bool:
    """Compare (smallest, largest, mean) of x, then of y, each by its own largest value."""
    scales = [max(map(abs, one[part : part + 3])) for part in range(0, len(one), 3) for _ in range(3)]
    same_length = len(one) == len(other)
    return same_length and all(abs(a - b) <= close * s for a, b, s in zip(one, other, scales, strict=True))
