# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes: what one run needs, read from YAML and checked (docs/scenes.md)."""

from atpid_sim.scene.ceiling import ControlledCeiling, OpeningCeiling
from atpid_sim.scene.excitation import FreeExcitation, HarmonicExcitation, SeriesExcitation, SweepExcitation
from atpid_sim.scene.scene import Scene, load_scene, scene_from_mapping, standard_bench
from atpid_sim.scene.yaml12 import SceneError

__all__ = [
    "ControlledCeiling", "FreeExcitation", "HarmonicExcitation", "OpeningCeiling", "Scene", "SceneError",
    "SeriesExcitation", "SweepExcitation", "load_scene", "scene_from_mapping", "standard_bench",
]  # fmt: skip
