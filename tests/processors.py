# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a command as another processor rounds: `python tests/processors.py x86-64-v2 python -m pytest PATH`.

What rounds differently is chosen by the processor in four places: numba compiles for it, numpy, the linear algebra
under numpy and scipy, and the C library's sines choose by what it can. numba's cache keeps each processor's code apart.
"""

import os
import platform
import sys
from dataclasses import dataclass

#: Whether another processor can be emulated here, and the reason where it cannot.
EMULATES = platform.machine() == "x86_64"
REASON = "another processor is emulated on x86-64 only"


@dataclass(frozen=True)
class Processor:
    """One to emulate: numba's name for it, OpenBLAS's, and what it lacks in numpy's names and in the C library's."""

    core: str
    lacks: tuple[str, ...]
    hardware: tuple[str, ...]


_WIDE = ("AVX512F", "AVX512VL")
PROCESSORS = {
    "znver3": Processor("Zen", ("512", "V4"), _WIDE),
    "haswell": Processor("Haswell", ("512", "V4"), _WIDE),
    "x86-64-v2": Processor(
        "Prescott", ("512", "V4", "V3", "AVX", "FMA", "F16C"), (*_WIDE, "AVX2", "AVX", "FMA", "FMA4")
    ),
}


def environment(name: str) -> dict[str, str]:
    """Return the variables with which a process rounds as the processor of that name does."""
    import numpy as np

    processor = PROCESSORS[name]
    config = np.show_config(mode="dicts")
    offered = config["SIMD Extensions"].get("found", [])
    off = [feature for feature in offered if any(part in feature for part in processor.lacks)]
    return {
        "NUMBA_CPU_NAME": name,
        "NUMBA_CPU_FEATURES": "",  # what the name has, nothing of this machine's
        "OPENBLAS_CORETYPE": processor.core,
        "NPY_DISABLE_CPU_FEATURES": " ".join(off),
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=" + ",".join(f"-{each}" for each in processor.hardware),
    }


if __name__ == "__main__":
    if len(sys.argv) < 3 or sys.argv[1] not in PROCESSORS:
        sys.exit(f"given {sys.argv[1:]}; allowed: one of {', '.join(PROCESSORS)}, then a command")
    os.execvpe(sys.argv[2], sys.argv[2:], os.environ | environment(sys.argv[1]))
