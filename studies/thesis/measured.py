# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a measure returns for one point of a sweep."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from atpid_sim.system import Array
from studies.thesis.points import Job


@dataclass(frozen=True)
class Measured:
    """Numbers and words by name, and curves (2, n) for the picture."""

    values: dict[str, float | str]
    curves: dict[str, Array] = field(default_factory=dict)


#: A measure: (job, options of the study) to what was found. Raises NumericalFailure.
Measure = Callable[[Job, Mapping[str, Any]], Measured]


def curve(x: Array, y: Array, most: int = 3000) -> Array:
    """Return a curve (2, k), thinned to at most about `most` points."""
    step = max(1, len(x) // most)
    return np.array([x[::step], y[::step]])
