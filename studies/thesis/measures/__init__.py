# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The measures a study file can name."""

from studies.thesis.measured import Measure
from studies.thesis.measures import algorithms, driven, energies, free, heights, references

MEASURES: dict[str, Measure] = {
    "constants": driven.constants,
    "steady": driven.steady,
    "forces": driven.forces,
    "damping": driven.damping,
    "energies": energies.energies,
    "decay": free.decay,
    "spectrum": free.spectrum,
    "first_impact": free.first_impact,
    "free_energy": free.free_energy,
    "landscape": heights.landscape,
    "best": heights.best,
    "search": algorithms.search,
    "loop": algorithms.loop,
    "pca_steps": algorithms.pca_steps,
    "pca": algorithms.pca,
    "reference": references.reference,
}
