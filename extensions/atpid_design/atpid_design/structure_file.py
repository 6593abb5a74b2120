# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A structure for `atpid design` from a file: the blocks `beam`, `further_modes` and `drive` of a scene."""

import math
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, ValidationError

from atpid_common.files import FileError, read_text
from atpid_design.problem import DesignError
from atpid_sim.fields import SceneBlock
from atpid_sim.scene.scene import explained
from atpid_sim.scene.structure import Beam, FurtherMode
from atpid_sim.scene.yaml12 import read_yaml

#: Size of the file at most [bytes].
_LARGEST = 1_000_000


class Blocks(SceneBlock):
    """What is read of a scene, or of what `atpid modes` writes; the rest of it is not used."""

    model_config = ConfigDict(extra="ignore")
    beam: Beam = Field(description="the mode that matters")
    further_modes: tuple[FurtherMode, ...] = Field(default=(), description="the modes beside it")
    drive: Literal["support", "force"] = Field(default="support", description="what shakes it")


def structure_in(path: Path) -> dict[str, Any]:
    """Return the structure in a YAML file by the names of `Problem`. Raises DesignError and SceneError in one line."""
    try:
        given = Blocks.model_validate(read_yaml(read_text(path, _LARGEST), str(path)))
    except FileError as error:
        raise DesignError(f"--structure: {error}") from None
    except ValidationError as error:
        raise DesignError(f"--structure: {path}: {explained(error.errors(include_url=False), Blocks)}") from None
    beam = given.beam
    omega = math.sqrt(beam.stiffness / beam.mass)
    return {
        "mass": beam.mass, "frequency": omega / (2.0 * math.pi), "damping": beam.damping / (2.0 * beam.mass * omega),
        "further_modes": given.further_modes, "drive": given.drive,
    }  # fmt: skip
