# SPDX-License-Identifier: Apache-2.0
"""From a YAML file, or a mapping, to a scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from atpid_sim.scene.errors import SceneError
from atpid_sim.scene.explain import decimal_comma, explained, shown
from atpid_sim.scene.model import Scene
from atpid_sim.scene.yaml12 import read_yaml


def load_scene(path: str | Path) -> Scene:
    """Read, check and return the scene in the YAML file `path`; raise SceneError in one line where it cannot be."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}; give the path of a scene file") from None
    except UnicodeDecodeError:
        raise SceneError(f"{path}: is not text; give a scene, a YAML file in UTF-8") from None
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
