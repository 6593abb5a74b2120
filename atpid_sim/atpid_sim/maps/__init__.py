# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Height maps: the best ceiling height over support amplitude and grain mass (thesis section 4.2, Fig. 3.25)."""

from atpid_sim.maps.build import Best, best_height, build_map, map_tolerance
from atpid_sim.maps.header import header_text, write_header
from atpid_sim.maps.height_map import Failure, HeightMap, MapEntry, MapError
from atpid_sim.maps.ratings import ALL_APPROACHES, FROM_CLOSED, Approach, travelled
from atpid_sim.maps.response import DamperResponse, EarlyEnd, Timing, WindowResponse

__all__ = [
    "ALL_APPROACHES", "FROM_CLOSED", "Approach", "Best", "DamperResponse", "EarlyEnd", "Failure", "HeightMap",
    "MapEntry", "MapError", "Timing", "WindowResponse", "best_height", "build_map", "header_text", "map_tolerance",
    "travelled", "write_header",
]  # fmt: skip
