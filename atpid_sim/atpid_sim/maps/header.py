# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A map as a C header for the motor's firmware: amplitudes and heights in micrometres, in program memory."""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from atpid_common.output import writing
from atpid_sim.maps.height_map import HeightMap, MapError

_A_LINE = 8


def header_text(height_map: HeightMap, mass_fraction: float) -> str:
    """Return the header for one mass fraction: ATPID_TABLE_N, atpid_amplitude_um[] and atpid_height_um[].

    The firmware takes the recorded amplitude nearest to the measured one, so heights are rounded down, to the side
    away from the cliff. A point that could not be computed has height 0, which lies outside the soft limits: the
    firmware refuses it (RANGE). Raises MapError where the map does not reach the mass fraction.
    """
    height_map.check_mass_fraction(mass_fraction)
    heights = [_height_um(height_map, float(a), mass_fraction) for a in height_map.amplitudes]
    amplitude_um = np.round(1e6 * height_map.amplitudes).astype(np.int64)
    height_um = np.array(heights, dtype=np.int64)
    if (np.diff(amplitude_um) <= 0).any():
        raise MapError(f"{height_map.source}: amplitudes closer than 1 um cannot go into a header; use fewer")
    missing = int(np.count_nonzero(height_um == 0))
    note = [f"// Height 0, which the firmware refuses: could not be computed ({missing} amplitudes)"] if missing else []
    system = ", ".join(f"{key} {value}" for key, value in height_map.identity.items())
    return "\n".join(
        [
            "// SPDX-License-Identifier: Apache-2.0",
            "// Best ceiling heights over support amplitude, made by `atpid map --header`. Do not edit.",
            f"// System: {system}; mass fraction {mass_fraction:g}",
            *note,
            "#pragma once",
            "#include <stdint.h>",
            f"#define ATPID_TABLE_N {len(amplitude_um)}",
            _array("atpid_amplitude_um", amplitude_um),
            _array("atpid_height_um", height_um),
            "",
        ]
    )


def write_header(height_map: HeightMap, mass_fraction: float, path: str | os.PathLike[str]) -> None:
    """Write the header; raise OutputError where that is not possible."""
    with writing(path, "--header"):
        Path(path).write_text(header_text(height_map, mass_fraction), encoding="utf-8")


def _height_um(height_map: HeightMap, amplitude: float, mass_fraction: float) -> int:
    try:
        height = height_map.lookup(amplitude, mass_fraction).height
    except MapError:
        return 0
    return int(np.floor(1e6 * height + 1e-6))


def _array(name: str, values: NDArray[np.int64]) -> str:
    texts = [f"{value}" for value in values]
    lines = [", ".join(texts[k : k + _A_LINE]) for k in range(0, len(texts), _A_LINE)]
    return f"static const uint32_t {name}[ATPID_TABLE_N] PROGMEM = {{\n    " + ",\n    ".join(lines) + "};"
