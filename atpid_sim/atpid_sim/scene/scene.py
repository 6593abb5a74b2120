# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scene: read from a YAML file or a mapping, checked, changed; the standard bench."""

from __future__ import annotations

import html
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from atpid_common.files import FileError, read_text
from atpid_sim.scene.errors import SceneError
from atpid_sim.scene.explain import decimal_comma, explained, shown
from atpid_sim.scene.model import SceneValues
from atpid_sim.scene.plausibility import warnings_of
from atpid_sim.scene.yaml12 import read_yaml

#: Size of a scene's file at most [bytes]: a profile of a whole day fits.
_LARGEST = 8_000_000
#: What a key of the beam is given in place of.
_REPLACES = {"frequency": "stiffness", "damping_ratio": "damping"}
#: Lines of a scene that are shown.
_SHOWN = 60
#: The standard bench of thesis section 3.4, which studies and figures start from.
_STANDARD: dict[str, object] = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
    "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "excitation": {"amplitude": 0.01, "frequency": "resonance"},
    "ceiling": {"height": 0.2},
    "gravity": 9.81,
    "duration": 16.0,
    "tolerance": 1e-6,
}


class Scene(SceneValues):
    """One run: structure, contact, excitation, ceiling and how long (docs/scenes.md)."""

    def warnings(self) -> list[str]:
        """Return one line for each value that is possible but unusual: key, value, usual range (`plausibility`)."""
        return warnings_of(self)

    def hint(self) -> str:
        """Return the unusual values as the end of an error's line; empty where there are none."""
        found = [line.partition(" is unusual")[0] for line in self.warnings()]
        return f"; unusual in the scene: {'; '.join(found)}" if found else ""

    def with_(self, *, height: float | None = None, mass_fraction: float | None = None, **changes: Any) -> Scene:
        """Return a validated copy with some values changed.

        `height` [m] puts a fixed ceiling there; `mass_fraction`, and `amplitude` and `frequency` of a tone,
        replace that value in its block, as `beam={"mass": 0.4}` and `grain={...}` do with those given; any other name
        is a key of the scene itself (duration, ceiling={...}, ...).
        Under a closed ceiling the grain begins on the floor, wherever it did before.
        Raises SceneError as loading does.
        """
        mapping, changes = self.to_mapping(), {key: _plain(value) for key, value in changes.items()}
        if height is not None:
            mapping["ceiling"] = {"height": _plain(height)}
        if mass_fraction is not None:
            mapping["grain"]["mass_fraction"] = _plain(mass_fraction)
        for key in ("beam", "grain"):
            if isinstance(given := changes.get(key), Mapping):
                replaced = {_REPLACES[name] for name in given if name in _REPLACES}
                kept = {name: own for name, own in mapping[key].items() if name not in replaced}
                changes[key] = {**kept, **given}
        for key in ("amplitude", "frequency"):
            if key in changes:
                mapping["excitation"][key] = changes.pop(key)
        mapping |= changes
        start, ceiling = mapping.get("initial"), mapping["ceiling"]
        first = ceiling.get("height", ceiling.get("closed"))
        if start and first is not None and first <= 2.0 * self.grain.radius and "initial" not in changes:
            mapping["initial"] = {key: value for key, value in start.items() if not key.startswith("grain_")}
        return scene_from_mapping(mapping, source="changed scene")

    def __dir__(self) -> list[str]:
        """Return the names without pydantic's own."""
        return [name for name in super().__dir__() if name.startswith("__") or not hasattr(BaseModel, name)]

    def __repr__(self) -> str:
        lines = self.to_yaml().splitlines()
        return "\n".join(["Scene", *(f"  {line}" for line in lines[:_SHOWN]), *(["  ..."] if lines[_SHOWN:] else [])])

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return the text that a notebook shows."""
        return f"<pre>{html.escape(repr(self))}</pre>"


def _plain(value: Any) -> Any:
    """Return numpy's numbers and arrays as plain ones."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def load_scene(path: str | Path) -> Scene:
    """Read, check and return the scene in the YAML file `path`; raise SceneError in one line where that fails."""
    file = Path(path)
    try:
        text = read_text(file, _LARGEST)
    except FileError as error:
        raise SceneError(f"{error}; a scene is a YAML file in UTF-8") from None
    return scene_from_mapping(read_yaml(text, str(path)), source=str(path), folder=file.parent)


def scene_from_mapping(mapping: Mapping[str, Any], source: str = "scene", folder: Path | None = None) -> Scene:
    """Check and return the scene in `mapping`; `source` names it in errors, relative paths start from `folder`."""
    if not isinstance(mapping, Mapping):
        wanted = ", ".join(Scene.model_fields)
        raise SceneError(f"{source}: given {shown(mapping)}; allowed: a mapping with the keys {wanted}")
    if comma := decimal_comma(mapping):
        raise SceneError(f"{source}: {comma}")
    try:
        return Scene.model_validate(dict(mapping), context={"folder": folder})
    except ValidationError as error:
        raise SceneError(f"{source}: {explained(error.errors(include_url=False))}") from None


def standard_bench(**changes: object) -> Scene:
    """Return the standard bench with the ceiling at 0.2 m, with some keys of the scene changed.

    Raises SceneError where a change does not fit.
    """
    return scene_from_mapping({**_STANDARD, **changes}, source="standard bench")
