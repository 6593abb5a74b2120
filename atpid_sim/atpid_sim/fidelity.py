# SPDX-License-Identifier: Apache-2.0
"""`auto`: the cheapest rung that meets the scene's tolerance, and what it leaves out."""

from __future__ import annotations

from dataclasses import dataclass

from atpid_sim.contact import contact_of
from atpid_sim.contact.ids import IMPACT
from atpid_sim.run import FIDELITIES, is_closed
from atpid_sim.scene import Scene

#: Amplitude error of instantaneous impacts against the soft contact, relative (4e-3 on the standard task, measured:
#: docs/tradeoff.md).
IMPACT_MODEL_ERROR = 1e-2

#: One mass against soft contact for the closed damper: the grain's play of micrometres (measured: 2e-4 at most).
CLOSED_MODEL_ERROR = 1e-3


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
    if is_closed(scene) and scene.tolerance >= CLOSED_MODEL_ERROR:
        return _described(scene, "simplified")
    if contact_of(scene).law == IMPACT or scene.tolerance >= IMPACT_MODEL_ERROR:
        return _described(scene, "impact")
    return _described(scene, "soft")


def _described(scene: Scene, fidelity: str) -> Choice:
    if fidelity == "soft":
        return Choice("soft", "nothing of the contact model", 0.0)
    if fidelity == "impact":
        if contact_of(scene).law == IMPACT:
            return Choice("impact", "nothing: the scene's contact law is instantaneous", 0.0)
        return Choice("impact", "the duration and depth of contacts", IMPACT_MODEL_ERROR)
    if is_closed(scene):
        return Choice("simplified", "the grain's play inside the closed damper", CLOSED_MODEL_ERROR)
    return Choice("simplified", "the grain and its impacts: the beam swings alone (thesis Eq. 4.7)", 1.0)
