# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture and the table of docs/contact.md are what the command makes."""

from pathlib import Path

import numpy as np
import pytest

from atpid_sim.contact.laws import NAMES
from atpid_sim.kernel_inputs import restitution_of, system_of
from atpid_sim.scene import standard_bench
from atpid_sim.system import reduced_mass
from studies.figures import contact as figure

DOCS = Path(__file__).parents[2] / "docs"


def test_the_documented_table_is_the_computed_one() -> None:
    assert figure.table() in (DOCS / "contact.md").read_text(encoding="utf-8")


def test_every_law_is_described() -> None:
    text = (DOCS / "contact.md").read_text(encoding="utf-8")
    assert [law for law in NAMES if f"`{law}`" not in text] == []


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    (file,) = figure.draw(tmp_path)
    assert file.name == "contact_laws.png"
    assert file.stat().st_size > 20_000
    assert (DOCS / "figures" / file.name).is_file()


@pytest.mark.parametrize("law", [law for law in figure.laws_that_agree() if law != "impact"])
def test_the_impact_that_is_drawn_has_the_restitution_that_is_drawn(law: str) -> None:
    contact = figure.laws_that_agree()[law]
    mass = reduced_mass(system_of(standard_bench()))
    impact = figure.impact_of(contact, mass, figure.SPEED)
    impulse = np.sum(0.5 * (impact.force[1:] + impact.force[:-1]) * np.diff(impact.time))
    assert impulse / (mass * figure.SPEED) - 1.0 == pytest.approx(restitution_of(contact, figure.SPEED, mass), abs=2e-3)
