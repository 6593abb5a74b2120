# SPDX-License-Identifier: Apache-2.0
"""The journal of a map being made, beside the map's file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from atpid_sim.maps.height_map import MapError
from atpid_sim.simulation import journal

#: Where a point lies: mass fraction [-], amplitude [m].
Point = tuple[float, ...]


class Journal(journal.Journal):
    """See `simulation.journal`; its errors are those of a map."""

    error = MapError

    def __init__(self, out: Path, purpose: Mapping[str, Any]) -> None:
        """Open or begin the journal of the map `out`; raise MapError where it is another's or in use."""
        super().__init__(journal.beside(out), purpose)
