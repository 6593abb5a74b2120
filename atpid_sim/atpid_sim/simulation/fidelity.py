# SPDX-License-Identifier: Apache-2.0
"""The fidelity level of a run: the one given, or with `auto` the cheapest that meets the scene's tolerance."""

from __future__ import annotations

from dataclasses import dataclass

from atpid_sim.contact.laws import IMPACT
from atpid_sim.kernel_inputs import contact_of
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import FIDELITIES, is_closed
from atpid_sim.simulation.model_error import closed_error, impact_error


@dataclass(frozen=True)
class Choice:
    """A fidelity level, what it leaves out, and the relative amplitude error that causes."""

    fidelity: str
    left_out: str
    model_error: float


def choose(
    scene: Scene, fidelity: str = "auto", stays_closed: bool | None = None, undamped: float | None = None
) -> Choice:
    """Return the fidelity level for a scene; `auto` is the cheapest that meets the scene's tolerance.

    stays_closed: whether the ceiling stays closed, by default as the scene has it; simplified is only considered where
    it does. undamped: amplitude of the closed damper [m], computed where it is not given and needed. Raises ValueError
    for an unknown name.
    """
    if fidelity == "auto":
        return _cheapest(scene, is_closed(scene) if stays_closed is None else stays_closed, undamped)
    if fidelity not in FIDELITIES:
        raise ValueError(f"fidelity {fidelity!r}: allowed are auto, {', '.join(FIDELITIES)}")
    return _described(scene, fidelity, undamped)


def complete_fidelity(scene: Scene) -> str:
    """Return the fidelity level that leaves out nothing of the scene's contact law."""
    return "impact" if contact_of(scene).law == IMPACT else "soft"


def _cheapest(scene: Scene, stays_closed: bool, undamped: float | None) -> Choice:
    for fidelity in ("simplified", "impact") if stays_closed else ("impact",):
        choice = _described(scene, fidelity, undamped)
        if choice.model_error <= scene.tolerance:
            return choice
    return _described(scene, "soft", undamped)


def _described(scene: Scene, fidelity: str, undamped: float | None) -> Choice:
    instantaneous = contact_of(scene).law == IMPACT
    if fidelity == "soft":
        return Choice("soft", "nothing of the contact model", 0.0)
    if fidelity == "impact":
        if instantaneous:
            return Choice("impact", "nothing: the scene's contact law is instantaneous", 0.0)
        return Choice("impact", "the duration and depth of contacts", impact_error(scene, undamped))
    if is_closed(scene):
        error = 0.0 if instantaneous else closed_error(scene, undamped)
        return Choice("simplified", "the grain's play inside the closed damper", error)
    return Choice("simplified", "the grain and its impacts: the beam swings alone (thesis Eq. 4.7)", 1.0)
