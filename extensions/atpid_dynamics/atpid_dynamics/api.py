# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `import atpid_sim as ap` offers where this package is installed (docs/python.md)."""

from atpid_dynamics import sweep as sweeps
from atpid_dynamics.basin import Basin, Starts, basin
from atpid_sim.api import compiled_first
from atpid_sim.scene import Scene

__all__ = ["compile_kernels", "kicked", "sweep"]

sweep = compiled_first(sweeps.sweep)


def kicked(scene: Scene, kick: float, fidelity: str = "auto") -> Basin:
    """Return the share of kicks [m/s] after which the steady motion of a scene comes back; raises as `steady_state`."""
    return basin(scene, Starts(kick), fidelity=fidelity)


def compile_kernels(scene: Scene) -> None:
    """Compile what a sweep needs, once after an installation: `atpid_sim.compile_kernels` calls this."""
    sweep(scene, [0.08, 0.09, 0.1, 0.11, 0.12])
