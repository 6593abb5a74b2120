# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `import atpid_sim as ap` offers where this package is installed (docs/python.md)."""

from atpid_dynamics import sweep as sweeps
from atpid_sim.api import compiled_first
from atpid_sim.scene import Scene

__all__ = ["compile_kernels", "sweep"]

sweep = compiled_first(sweeps.sweep)


def compile_kernels(scene: Scene) -> None:
    """Compile what a sweep needs, once after an installation: `atpid_sim.compile_kernels` calls this."""
    sweep(scene, [0.08, 0.09, 0.1, 0.11, 0.12])
