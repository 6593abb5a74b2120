# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The physics of the tuned particle impact damper: contact laws, steppers, height maps, and the plant node.

`import atpid_sim as ap` gives the functions of `atpid_sim.api`, loaded when first used (docs/python.md).
"""

from typing import TYPE_CHECKING

__version__ = "1.0.0"
#: Those of `api`, which is not loaded to know them.
_NAMES = [
    "NumericalFailure", "Scene", "SceneError", "best_height", "compile_kernels", "height_map", "load_map", "load_scene",
    "scene_from_mapping", "simulate", "standard_bench", "steady_state", "sweep", "trajectory",
]  # fmt: skip

if TYPE_CHECKING:
    from atpid_sim.api import *  # noqa: F403
else:

    def __getattr__(name):
        """Return a function of the interface, or what another package adds under the entry point `atpid_sim`."""
        if name in _NAMES:
            from atpid_sim import api

            return getattr(api, name)
        from importlib.metadata import entry_points

        for added in () if name.startswith("_") else entry_points(group="atpid_sim", name=name):
            return added.load()
        hint = "; bags are read by the package atpid_control, which is not installed" if name == "open_run" else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")

    def __dir__():
        return [*_NAMES, "__version__"]
