# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The physics of the tuned particle impact damper: contact laws, steppers, height maps, and the plant node.

`import atpid_sim as ap` gives the functions of `atpid_sim.api`, loaded when first used, and what installed packages add
(docs/python.md).
"""

from typing import TYPE_CHECKING

__version__ = "1.0.0"
#: Those of `api`, which is not loaded to know them.
_NAMES = [
    "NumericalFailure", "Scene", "SceneError", "best_height", "compile_kernels", "height_map", "load_map", "load_scene",
    "scene_from_mapping", "simulate", "standard_bench", "steady_state", "trajectory",
]  # fmt: skip
#: The entry points by which a package adds a name.
_ADDED = "atpid_sim"
#: What packages of this project add, for where they are not installed.
_ELSEWHERE = {
    "kicked": "kicks of a motion are tried by the package atpid_dynamics",
    "open_run": "bags are read by the package atpid_control",
    "sweep": "many heights are swept by the package atpid_dynamics",
}

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from atpid_sim.api import *  # noqa: F403

    _Added = Callable[..., Any]  # of atpid_dynamics, where its types are
    kicked: _Added
    sweep: _Added
else:

    def __getattr__(name):
        """Return a function of the interface, or what another package adds by an entry point of the group `_ADDED`."""
        if name in _NAMES:
            from atpid_sim import api

            return getattr(api, name)
        from importlib.metadata import entry_points

        for added in () if name.startswith("_") else entry_points(group=_ADDED, name=name):
            return added.load()
        hint = f"; {_ELSEWHERE[name]}, which is not installed" if name in _ELSEWHERE else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")

    def __dir__():
        from importlib.metadata import entry_points

        return [*_NAMES, "__version__", *sorted({added.name for added in entry_points(group=_ADDED)})]
