# SPDX-License-Identifier: Apache-2.0
"""Make the atlas: every column by itself, on all cores, kept in a journal until the atlas is whole."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

from atpid_sim.maps import map_tolerance
from atpid_sim.maps.identity import identity_of
from atpid_sim.maps.journal import Journal
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.studies.atlas.atlas import Atlas, Columns
from atpid_sim.studies.atlas.column import Column, column_at
from atpid_sim.studies.atlas.plan import Place, Plan

#: Format of the journal and of the file.
_FORMAT = 1


def build_atlas(
    scene: Scene, plan: Plan, out: Path, progress: Callable[[int], None] | None = None, workers: int | None = None
) -> Atlas:
    """Return the atlas of a scene's system, written to `out`; a run that was killed goes on where it stopped.

    Takes beam, grain radius, contact, gravity and tolerance from the scene. `progress` is called with the number of
    columns done; workers: threads, by default all cores. Raises MapError where the journal beside `out` is another's,
    in use or cannot be written.
    """
    identity = identity_of(scene)
    del identity["excitation.frequency"]  # the plan has it
    purpose = {"atlas": _FORMAT, "system": identity, "tolerance": map_tolerance(scene), "plan": asdict(plan)}
    report = progress or (lambda _: None)
    with closing(Journal(out, purpose)) as journal:
        done: Columns = {Place(*point): Column.from_mapping(plain) for point, plain in journal.points.items()}
        report(len(done))
        missing = [place for place in plan.places if place not in done]
        for place, column in on_all_cores(lambda place: column_at(scene, place, plan.shares), missing, workers):
            done[place] = column
            journal.record(place, asdict(column))
            report(len(done))
        atlas = Atlas.of(plan, done)
        atlas.save(out)
        journal.finish()
    return atlas
