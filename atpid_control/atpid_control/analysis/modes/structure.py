# SPDX-License-Identifier: Apache-2.0
"""Modes of a structure as its container meets them, and the blocks of a scene that they make."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from atpid_common.errors import InputError
from atpid_sim.scene import Scene, scene_from_mapping

#: A mode whose shape is smaller at a place than this share of its largest is at rest there [-].
AT_REST = 1e-3


class ModesError(InputError):
    """Modes that a scene cannot have, or dimensions or a file that do not determine them."""


class Mode(NamedTuple):
    """A mode, of the scale at which its shape is 1 at the container."""

    frequency: float  # without damping [Hz]
    mass: float  # modal mass over the square of the shape at the container [kg]
    damping_ratio: float  # 0 where it is not known [-]
    base: float  # of the base's motion: participation factor times shape at the container [-]
    force: float  # shape where the force acts over shape at the container [-]
    slope: float  # rotation over displacement at the container, NaN where it is not known [rad/m]

    @property
    def stiffness(self) -> float:
        """Stiffness of the same scale [N/m]."""
        return (2.0 * math.pi * self.frequency) ** 2 * self.mass


class Structure(NamedTuple):
    """All modes that are known, by rising frequency."""

    modes: tuple[Mode, ...]
    compliance: float  # static, at the container, of all modes or of those known [m/N]
    notes: tuple[str, ...]  # a line each


class Chosen(NamedTuple):
    """The modes that a scene gets, as it has them, and what is left out."""

    modes: tuple[Mode, ...]
    blocks: dict[str, Any]
    amplitude_factor: float  # by which a force's amplitude is multiplied [-]
    left_of_base: float  # share of the base's motion that is in modes left out [-]
    left_of_compliance: float  # of the static compliance at the container [-]
    next_mode: Mode | None
    impulse_mass: float  # that an impulse at the container meets in all modes kept together [kg]
    notes: tuple[str, ...]


def choose(structure: Structure, count: int, ratios: Sequence[float], forced: bool) -> Chosen:
    """Return the `count` lowest modes with damping `ratios` [-]: one for all, one a mode, or none for the structure's.

    forced: a force drives the structure, in place of its base. Modes left out follow the base without delay, and the
    last one kept nearly does: theirs is added to its share. Raises ModesError.
    """
    modes = structure.modes[:count]
    if len(modes) < count:
        raise ModesError(f"--modes: given {count}; allowed: at most {len(modes)}, as many as are known")
    modes = tuple(mode._replace(damping_ratio=one) for mode, one in zip(modes, _damping(modes, ratios), strict=True))
    first = modes[0]
    if forced:
        if abs(first.force) < AT_REST:
            raise ModesError(f"--force-at: the mode at {first.frequency:.4g} Hz is at rest there; give another place")
        factors = [mode.force / first.force for mode in modes]
    else:
        factors = [mode.base for mode in modes]
        factors[-1] = 1.0 - sum(factors[:-1])
    keys = ("mass", "frequency", "damping_ratio")
    plain = [{key: _digits(getattr(mode, key)) for key in keys} for mode in modes]
    further = [one | {"drive_factor": _digits(by)} for one, by in zip(plain[1:], factors[1:], strict=True)]
    blocks = (
        {"beam": plain[0]} | ({"further_modes": further} if further else {}) | ({"drive": "force"} if forced else {})
    )
    after = structure.modes[count] if len(structure.modes) > count else None
    left = 1.0 - sum(1.0 / mode.stiffness for mode in modes) / structure.compliance
    base = 1.0 - sum(mode.base for mode in modes)
    together = 1.0 / sum(1.0 / mode.mass for mode in modes)
    return Chosen(modes, blocks, first.force, base, left, after, together, structure.notes)


def merged(scene: Scene, blocks: dict[str, Any], source: str) -> Scene:
    """Return a scene with the blocks in place of its own, and a grain of the same mass. Raises SceneError."""
    mapping = {key: value for key, value in scene.to_mapping().items() if key not in ("further_modes", "drive")}
    share = scene.grain_mass / (scene.grain_mass + blocks["beam"]["mass"])
    return scene_from_mapping(mapping | blocks | {"grain": mapping["grain"] | {"mass_fraction": share}}, source)


def _damping(modes: Sequence[Mode], ratios: Sequence[float]) -> Sequence[float]:
    if len(ratios) not in (0, 1, len(modes)):
        raise ModesError(f"--damping-ratio: given {len(ratios)}; allowed: one for all, or {len(modes)}, one a mode")
    for mode in modes:
        if not ratios and not mode.damping_ratio > 0.0:
            raise ModesError(f"no damping is known of the mode at {mode.frequency:.4g} Hz; give --damping-ratio")
    return (list(ratios) * len(modes))[: len(modes)] or [mode.damping_ratio for mode in modes]


def _digits(value: float) -> float:
    return float(f"{value:.7g}")
