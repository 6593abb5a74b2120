# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pictures of README and docs, and the table of the atlas, show what is computed now.

No pixels are compared: each PNG carries the numbers of its curves (atpid_sim.figure_style). Those that take seconds
are drawn again and compared; the whole set is made by `make figures`.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from atpid_control.cli import main
from atpid_control.views.report.page import report
from atpid_sim.figure_style import KEY, Numbers, numbers_of
from atpid_sim.maps import HeightMap
from atpid_sim.scene import standard_bench
from studies.atlas.column import column_of
from studies.figures import contact, free_decay, mechanism, stand
from studies.figures import identification as identification
from studies.figures import selection as selection

ROOT = Path(__file__).resolve().parent.parent
#: Rows of docs/research/atlas.md: mass of the grain [%], support amplitude [mm], and the other cells.
ATLAS = re.findall(r"^\| (\d+) % \| (\d+) \| (.+) \|$", (ROOT / "docs/research/atlas.md").read_text(), re.MULTILINE)
#: Of the largest value on the axis: what processors round otherwise is far below, a changed model above.
CLOSE = 0.01


def cliffs_again(folder: Path) -> Numbers:
    picture = folder / "cliffs.png"
    options = ["--height", "0.19:0.3", "--frequencies", "5.2:5.75", "--picture", str(picture)]
    assert main(["cliffs", str(ROOT / "scenes/standard.yaml"), *options]) == 0
    return numbers_in(picture)


def grain_again(folder: Path) -> Numbers:
    report(ROOT / "bags/thesis_4_3_short", folder)
    return numbers_in(folder / "grain.png")


#: The pictures made again here; others take minutes, or show chaotic motion.
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


def test_the_table_of_the_stand_is_what_is_computed_now() -> None:
    assert stand.table() in (ROOT / "docs/stand.md").read_text()


def test_the_mechanism_moves_as_it_is_simulated_now(tmp_path: Path) -> None:
    for drawing in mechanism.draw(tmp_path):
        now, printed = (mechanism.numbers_of(folder / drawing.name) for folder in (tmp_path, ROOT / "docs/figures"))
        assert printed["right"] == pytest.approx(now["right"], rel=CLOSE)
    closed, low, right, irregular = (each.amplitude for each in mechanism.cases())
    assert 3.0 * right < 2.0 * irregular < 2.0 * low < 2.0 * closed
    # closed form: a beam alone on its support, at its own resonance
    alone = mechanism.SUPPORT * (1.0 + 4.0 * mechanism.DAMPING**2) ** 0.5 / (2.0 * mechanism.DAMPING)
    assert mechanism.without_damper() == pytest.approx(alone, rel=1e-6)


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


def numbers_in(picture: Path) -> Numbers:
    """Return the numbers kept in a PNG; raises ValueError for one without."""
    before, kind, after = picture.read_bytes().partition(f"tEXt{KEY}\0".encode())
    if not kind:
        raise ValueError(f"{picture}: no numbers inside; make it again with `make figures`")
    length = int.from_bytes(before[-4:], "big") - len(KEY) - 1  # of a chunk's content, which the kind follows
    numbers: Numbers = json.loads(after[:length])
    return numbers


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
