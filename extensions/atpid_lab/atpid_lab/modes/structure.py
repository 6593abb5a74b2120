# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Modes of a structure as its container meets them, and the blocks of a scene that they make."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from atpid_common.errors import InputError
from atpid_common.files import Document
from atpid_sim.scene import Scene, scene_from_mapping

#: A mode is at rest at a place where its shape is less than this share of its largest [-].
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
    """The modes that are known, by rising frequency."""

    modes: tuple[Mode, ...]
    compliance: float  # static, at the container, of all modes or of those known [m/N]
    notes: tuple[str, ...] = ()  # a line each


def choose(structure: Structure, count: int, ratios: Sequence[float], forced: bool) -> Document:
    """Return the `count` lowest modes, what is left out, and the `blocks` of a scene.

    ratios: damping [-], one for all, one a mode, or none for the structure's own; forced: a force drives the structure,
    and not its base. Modes left out follow the base at once; the last mode kept nearly does, and gets their share.
    Raises ModesError.
    """
    modes = structure.modes[:count]
    if len(modes) < count:
        raise ModesError(f"--modes: given {count}; allowed: at most {len(modes)}, as many as move the container")
    if len(ratios) not in (0, 1, count):
        raise ModesError(f"--damping-ratio: given {len(ratios)}; allowed: one for all, or {count}, one a mode")
    given = (list(ratios) * count)[:count] or [mode.damping_ratio for mode in modes]
    modes = tuple(mode._replace(damping_ratio=one) for mode, one in zip(modes, given, strict=True))
    first = modes[0]
    if forced and abs(first.force) < AT_REST:
        raise ModesError(f"--force-at: the mode at {first.frequency:.4g} Hz is at rest there; give another place")
    factors = [mode.force / first.force if forced else mode.base for mode in modes]
    if not forced:
        factors[-1] = 1.0 - sum(factors[:-1])
    keys = ("mass", "frequency", "damping_ratio")
    beam, *further = ({key: _digits(getattr(mode, key)) for key in keys} for mode in modes)
    further = [one | {"drive_factor": _digits(by)} for one, by in zip(further, factors[1:], strict=True)]
    blocks: Document = {"beam": beam}
    if further:
        blocks["further_modes"] = further
    if forced:
        blocks["drive"] = "force"
    for mode in modes:
        if not ratios and not mode.damping_ratio > 0.0:
            raise ModesError(f"no damping is known of the mode at {mode.frequency:.4g} Hz; give --damping-ratio")
    return {
        "modes": [mode._asdict() | {"stiffness": mode.stiffness} for mode in modes],
        "amplitude_factor": first.force,
        "impulse_mass": 1.0 / sum(1.0 / mode.mass for mode in modes),
        "left_of_base": 1.0 - sum(mode.base for mode in modes),
        "left_of_compliance": 1.0 - sum(1.0 / mode.stiffness for mode in modes) / structure.compliance,
        "next_mode": next((mode._asdict() for mode in structure.modes[count:]), None),
        "notes": structure.notes,
        "blocks": blocks,
    }


def merged(scene: Scene, blocks: Document, source: str) -> Document:
    """Return a scene with the blocks in place of its own, and a grain of the same mass. Raises SceneError."""
    mapping = {key: value for key, value in scene.to_mapping().items() if key not in ("further_modes", "drive")}
    share = _digits(scene.grain_mass / (scene.grain_mass + blocks["beam"]["mass"]))
    mapping = blocks | mapping | blocks | {"grain": mapping["grain"] | {"mass_fraction": share}}
    scene_from_mapping(mapping, source)
    return mapping


def _digits(value: float) -> float:
    return float(f"{value:.7g}")
