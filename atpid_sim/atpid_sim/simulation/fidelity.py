# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fidelity level of a run: the one given, or with `auto` the cheapest that meets the scene's tolerance.

The amplitude error of a level that leaves out the depth of contacts is that depth relative to the beam's amplitude.
Measured against `soft` on random scenes of every law with E from 2e5 to 2e11 Pa, where both are reproducible: 0.5 times
the depth of an impact over the amplitude exceeds the error of `impact` in 95 of 100, twice the overlap of a grain that
is shaken without clearance that of one mass in 9 of 10 (docs/decisions/0009-fidelity.md). Where the two models end in
different motions the error has no bound.

That of contacts of finite duration grows with the cube of the share that a contact has of a period: 4 times the cube of
omega T, T the depth of an impact over its speed, exceeds it in 54 of 55 (docs/decisions/0031-finite-contacts.md).
"""

import math
from dataclasses import dataclass

from atpid_sim.contact import dispatch
from atpid_sim.contact.laws import IMPACT
from atpid_sim.engine.detachment import static_overlap
from atpid_sim.kernel_inputs import contact_of, system_of
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.root import root
from atpid_sim.scene import Scene, SceneError
from atpid_sim.simulation.contact_tables import table_of
from atpid_sim.simulation.integration import FIDELITIES, is_closed, undamped_amplitude
from atpid_sim.system import reduced_mass

#: Relative error of the amplitude over relative depth, measured: of instantaneous impacts, of the closed damper.
_IMPACT_ERROR, _CLOSED_ERROR = 0.5, 2.0
#: In a decay, a sweep or a measured series the errors of impacts add up; a grain heavier than a quarter of all has a
#: larger share of the motion.
_UNSTEADY_FACTOR, _GRAIN_MASS_FACTOR = 4.0, 4.0
#: Relative error of the amplitude over the cube of omega T, measured: of contacts of finite duration.
_FINITE_ERROR = 4.0
#: Residual error of the closed damper when contact compliance is added in series with the spring, over the error of the
#: closed damper; measured: at most a tenth.
_COMPLIANT_CLOSED_SHARE = 0.2
#: Share of the beam's own decay with which the error of a closed damper, taken as one mass, fades after its opening.
_CLOSED_DECAY_SHARE = 0.5
#: Clearance over the radius below which the grain is held, as the engine has it.
_HELD_CLEARANCE = 1e-5
#: Logarithms of the least and largest depth [m] considered.
_SHALLOW, _DEEP = -60.0, 10.0


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
    it does. undamped: amplitude of the closed damper [m], computed where it is not given and needed. Raises SceneError
    for an unknown name.
    """
    if fidelity == "auto" and scene.modes is not None and not is_closed(scene):
        return _described(scene, complete_fidelity(scene), undamped)  # what a contact does to fast modes has no bound
    if fidelity == "auto":
        closed = is_closed(scene) if stays_closed is None else stays_closed
        for cheap in ("simplified", "impact") if closed else ("impact",):
            choice = _described(scene, cheap, undamped)
            if choice.model_error <= scene.tolerance:
                return choice
        if contact_of(scene).law != IMPACT and _finite_physics(scene, undamped) <= scene.tolerance:
            choice = _described(scene, "finite", undamped)
            if choice.model_error <= scene.tolerance:
                return choice
        return _described(scene, "soft", undamped)
    if fidelity not in FIDELITIES:
        raise SceneError(f"fidelity {fidelity!r}: allowed are auto, {', '.join(FIDELITIES)}")
    return _described(scene, fidelity, undamped)


def complete_fidelity(scene: Scene) -> str:
    """Return the fidelity level that leaves out nothing of the scene's contact law."""
    return "impact" if contact_of(scene).law == IMPACT else "soft"


def _described(scene: Scene, fidelity: str, undamped: float | None) -> Choice:
    instantaneous = contact_of(scene).law == IMPACT
    if fidelity == "soft":
        return Choice("soft", "nothing of the contact model", 0.0)
    if fidelity == "impact":
        if instantaneous:
            return Choice("impact", "nothing: the scene's contact law is instantaneous", 0.0)
        return Choice("impact", "the duration and depth of contacts", impact_error(scene, undamped))
    if fidelity == "finite":
        left_out = "the change of the beam's force within a contact beyond first order; the play in the closed damper"
        return Choice("finite", left_out, finite_error(scene, undamped))
    if is_closed(scene):
        error = 0.0 if instantaneous else closed_error(scene, undamped)
        return Choice("simplified", "the grain's play inside the closed damper", error)
    return Choice("simplified", "the grain and its impacts: the beam swings alone (thesis Eq. 4.7)", 1.0)


def impact_error(scene: Scene, undamped: float | None = None) -> float:
    """Return the relative amplitude error to expect of instantaneous impacts, at most 1.

    undamped: amplitude of the closed damper [m], computed where it is not given.
    """
    amplitude = undamped_amplitude(scene) if undamped is None else undamped
    if not amplitude > 0.0:
        return 1.0
    speed = 2.0 * math.pi * scene.frequency_hz * amplitude
    return min(1.0, _times(scene) * _IMPACT_ERROR * _depth(scene, speed) / amplitude)


def _times(scene: Scene) -> float:
    """Return how many times as large errors are as those of a steady motion with a light grain."""
    more = max(1.0, _GRAIN_MASS_FACTOR * scene.grain.mass_fraction)
    return more if scene.excitation.is_tone and not scene.frequency_moves else more * _UNSTEADY_FACTOR


def finite_error(scene: Scene, undamped: float | None = None, held: float | None = None) -> float:
    """Return the relative amplitude error to expect of contacts from a table, at most 1; see `impact_error`.

    held: share of the closed damper's error that is left, by default that of the scene's ceiling.
    """
    return min(1.0, _finite_physics(scene, undamped, held) + table_of(system_of(scene), contact_of(scene))[1])


def _finite_physics(scene: Scene, undamped: float | None, held: float | None = None) -> float:
    """Return the part of that error that needs no table."""
    amplitude = undamped_amplitude(scene) if undamped is None else undamped
    if not amplitude > 0.0:
        return 1.0
    pace = 2.0 * math.pi * max(scene.frequency_hz, scene.natural_frequency_hz)
    share = pace * _depth(scene, pace * amplitude) / (pace * amplitude)
    held = _held_share(scene) if held is None else held
    return min(
        1.0, _times(scene) * _FINITE_ERROR * share**3 + (held * held_error(scene, amplitude) if held > 0.0 else 0.0)
    )


def judged_errors(scene: Scene, choice: Choice, undamped: float | None = None) -> tuple[float, float]:
    """Return the errors by which a run is disturbed to judge it: of the level, and while the grain is held; else 0."""
    return (choice.model_error, held_error(scene, undamped)) if choice.fidelity == "finite" else (0.0, 0.0)


def held_error(scene: Scene, undamped: float | None = None) -> float:
    """Return the relative error of a closed damper as one mass on a spring in series with the contact."""
    return _COMPLIANT_CLOSED_SHARE * closed_error(scene, undamped)


def _held_share(scene: Scene) -> float:
    """Return the share of the closed damper's error that is left in the steady window."""
    shut = 2.0 * scene.grain.radius + _HELD_CLEARANCE * scene.grain.radius
    heights = scene.ceiling.heights
    ends = [time for time, height in heights if height <= shut]
    if not ends:
        return 0.0
    last = scene.duration if heights[-1][1] <= shut else max(ends)
    waited = scene.steady_window[0] - last
    decay = 0.5 * scene.beam.damping / scene.total_mass
    return math.exp(-_CLOSED_DECAY_SHARE * decay * waited) if waited > 0.0 else 1.0


def closed_error(scene: Scene, undamped: float | None = None) -> float:
    """Return the relative amplitude error to expect of the closed damper as one mass, at most 1; see `impact_error`."""
    amplitude = undamped_amplitude(scene) if undamped is None else undamped
    return min(1.0, _CLOSED_ERROR * _held_overlap(scene, amplitude) / amplitude) if amplitude > 0.0 else 1.0


def require_shallow(scene: Scene, choice: Choice, undamped: float) -> None:
    """Raise NumericalFailure where one mass stands for a grain that would be held deeper than its radius.

    At the other levels the engine ends such a run.
    """
    if choice.fidelity != "simplified" or not is_closed(scene) or contact_of(scene).law == IMPACT:
        return
    if _held_overlap(scene, undamped) > scene.grain.radius:
        raise NumericalFailure(Outcome.OVERLAP_TOO_DEEP.sentence)


def _held_overlap(scene: Scene, amplitude: float) -> float:
    """Return the overlap [m] of a grain in a closed damper that swings with an amplitude [m]."""
    law, p = contact_of(scene)
    push = scene.grain_mass * ((2.0 * math.pi * scene.frequency_hz) ** 2 * amplitude + scene.gravity)
    return float(static_overlap(law, p, push, 1e-3))


def _depth(scene: Scene, speed: float) -> float:
    """Return the largest overlap [m] of an impact at `speed` [m/s]."""
    law, p = contact_of(scene)
    kinetic = 0.5 * reduced_mass(system_of(scene)) * speed * speed

    def excess(log_depth: float) -> float:
        depth = math.exp(log_depth)
        return float(dispatch.energy(law, depth, depth, p)) - kinetic

    if not excess(_SHALLOW) < 0.0:
        return 0.0
    return math.inf if excess(_DEEP) < 0.0 else math.exp(root(excess, _SHALLOW, _DEEP, xtol=1e-6, rtol=1e-6))
