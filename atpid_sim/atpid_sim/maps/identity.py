# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a map holds for: the values that decide best heights, by the scene's own keys."""

from atpid_common.files import Document
from atpid_sim.scene import Scene

#: Numbers that differ by less are the same [relative].
_SAME = 1e-9
#: A frequency given as a number counts as resonance within this share.
_RESONANCE = 1e-4

#: The key of the frequency, which a map over frequencies does not have.
FREQUENCY = "excitation.frequency"

Identity = Document


def identity_of(scene: Scene) -> Identity:
    """Return {key: value} of structure, grain radius, contact, gravity and frequency (Hz, or the word resonance)."""
    contact = scene.contact.model_dump(exclude_none=True)
    return {
        **{f"beam.{key}": value for key, value in scene.beam.model_dump().items()},
        **{
            f"further_modes.{k}.{key}": value
            for k, mode in enumerate(scene.further_modes)
            for key, value in mode.model_dump().items()
        },
        **({} if scene.drive == "support" else {"drive": scene.drive}),
        "grain.radius": scene.grain.radius,
        "contact.law": scene.contact.law,
        **{f"contact.{key}": value for key, value in contact.items() if key != "law"},
        "gravity": scene.gravity,
        FREQUENCY: _frequency(scene),
    }


def difference(made_for: Identity, wanted: Identity) -> str | None:
    """Return the first key that differs, with both values, in words; None where nothing differs."""
    for key in [*wanted, *(key for key in made_for if key not in wanted)]:
        left, right = made_for.get(key), wanted.get(key)
        if not _same(left, right):
            return f"{key} {_shown(left)} and not {_shown(right)}"
    return None


def _frequency(scene: Scene) -> float | str:
    if not scene.excitation.is_tone or scene.frequency_moves:
        return "resonance"
    near = abs(scene.frequency_hz / scene.natural_frequency_hz - 1.0) <= _RESONANCE
    return "resonance" if near else scene.frequency_hz


def _same(left: object, right: object) -> bool:
    if isinstance(left, float | int) and isinstance(right, float | int):
        return abs(left - right) <= _SAME * max(abs(left), abs(right))
    return bool(left == right)


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else ("nothing" if value is None else str(value))
