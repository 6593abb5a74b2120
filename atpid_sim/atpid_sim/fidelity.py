# SPDX-License-Identifier: Apache-2.0
"""`auto`: the cheapest rung that meets the scene's tolerance, and what it leaves out."""

from __future__ import annotations

from dataclasses import dataclass

from atpid_sim.contact import contact_of
from atpid_sim.contact.ids import IMPACT
from atpid_sim.model_error import closed_error, impact_error
from atpid_sim.run import FIDELITIES, is_closed
from atpid_sim.scene import Scene


@dataclass(frozen=True)
class Choice:
    """A rung, what it leaves out, and the relative amplitude error that costs."""

    fidelity: str
    left_out: str
    model_error: float


def choose(scene: Scene, fidelity: str = "auto") -> Choice:
    """Return the rung for a scene. Raises ValueError for an unknown name."""
    if fidelity == "auto":
        return _cheapest(scene)
    if fidelity not in FIDELITIES:
        raise ValueError(f"fidelity {fidelity!r}: allowed are auto, {', '.join(FIDELITIES)}")
    return _described(scene, fidelity)


def _cheapest(scene: Scene) -> Choice:
    cheaper = ("simplified", "impact") if is_closed(scene) else ("impact",)
    for fidelity in cheaper:
        choice = _described(scene, fidelity)
        if choice.model_error <= scene.tolerance:
            return choice
    return _described(scene, "soft")


def _described(scene: Scene, fidelity: str) -> Choice:
    instantaneous = contact_of(scene).law == IMPACT
    if fidelity == "soft":
        return Choice("soft", "nothing of the contact model", 0.0)
    if fidelity == "impact":
        if instantaneous:
            return Choice("impact", "nothing: the scene's contact law is instantaneous", 0.0)
        return Choice("impact", "the duration and depth of contacts", impact_error(scene))
    if is_closed(scene):
        error = 0.0 if instantaneous else closed_error(scene)
        return Choice("simplified", "the grain's play inside the closed damper", error)
    return Choice("simplified", "the grain and its impacts: the beam swings alone (thesis Eq. 4.7)", 1.0)
