# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Make the atlas: every column by itself, kept in a journal until the atlas is whole."""

from dataclasses import asdict
from pathlib import Path

from atpid_sim.maps import map_tolerance
from atpid_sim.maps.identity import identity_of
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import HERE, Batch, Progress, Record, Workers, beside
from studies.atlas.atlas import Atlas
from studies.atlas.column import Column, column_at
from studies.atlas.plan import Place, Plan

#: Format of the journal and of the file.
_FORMAT = 1


def build_atlas(
    scene: Scene, plan: Plan, out: Path, progress: Progress | None = None, workers: Workers = HERE
) -> Atlas:
    """Return the atlas of a scene's system, written to `out`; a run that was killed goes on where it stopped.

    Takes beam, grain radius, contact, gravity and tolerance from the scene. `progress` is called with the number of
    columns done. Raises JournalError where the journal beside `out` is another's, in use or cannot be written.
    """
    identity = identity_of(scene)
    del identity["excitation.frequency"]  # the plan has it
    purpose = {"atlas": _FORMAT, "system": identity, "tolerance": map_tolerance(scene), "plan": asdict(plan)}
    record: Record[Place, Column] = Record(beside(out), purpose, tuple, asdict, Column.from_mapping)
    columns = Batch(lambda place: column_at(scene, place, plan.shares), plan.places)
    atlas = Atlas.of(plan, dict(zip(plan.places, columns.run(workers, progress, record), strict=True)))
    atlas.save(out)
    record.finish()
    return atlas
