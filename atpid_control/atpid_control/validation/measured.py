# SPDX-License-Identifier: Apache-2.0
"""What was measured: support, beam and ceiling of a recording, and the scene that is kept in it."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from atpid_common.errors import InputError
from atpid_control.analysis.signals import fault_line, runs
from atpid_control.bags.read import Bag, open_bag, stamp_of
from atpid_control.beam_calibration.recording import TOPIC, Recording, read_recording, recording_in
from atpid_sim.scene import Scene, SceneError, load_scene, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.system import Array

#: Channels compared.
SUPPORT, BEAM = "support_displacement", "beam_displacement"
#: Event.FAULT.
_FAULT = "fault"
#: Samples below which nothing is compared: a cubic spline and an initial velocity need more.
_FEWEST = 100


class ValidationError(InputError):
    """A recording that cannot be simulated: what is missing in it, and what to give."""


@dataclass(frozen=True)
class Measured:
    """Displacements (n,) [m] at `rate` [Hz]; height of the ceiling (k, 2) [s, m], None where it was not recorded."""

    rate: float
    support: Array
    beam: Array
    ceiling: Array | None
    begin: float = 0.0  # of the part, in the recording [s]
    chosen: bool = False  # as the longest part without a gap

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return (len(self.beam) - 1) / self.rate


def opened(path: Path) -> Bag | None:
    """Return the bag at `path`, of one that is cut off what is there; None for a table. Raises BagError."""
    return None if path.suffix.lower() == ".csv" else open_bag(path, torn_ok=True)


def read_measured(path: Path, bag: Bag | None, begin: float, end: float) -> Measured:
    """Return the part from `begin` to `end` [s] of a bag or a table; of a whole one with gaps the longest without.

    Raises ValidationError where there is none, or where a part that was chosen has gaps.
    """
    whole = read_recording(path, SUPPORT, BEAM) if bag is None else recording_in(bag, SUPPORT, BEAM)
    chosen = begin == 0.0 and math.isinf(end) and whole.support is not None
    if chosen:
        begin, end = _without_gap(whole)
        chosen = not (begin == 0.0 and math.isinf(end))
    part = whole.between(begin, end)
    if part.support is None:
        raise ValidationError(f"{path}: {SUPPORT} was not recorded, so nothing can drive the scene")
    if len(part.beam) < _FEWEST:
        raise ValidationError(f"{path}: {len(part.beam)} samples in that part; needed: {_FEWEST}")
    for name, series in ((SUPPORT, part.support), (BEAM, part.beam)):
        gaps = np.flatnonzero(~np.isfinite(series))
        if len(gaps):
            at = begin + gaps[0] / part.rate
            raise ValidationError(f"{path}: {name} is missing or invalid at {at:g} s; choose a part with --from, --to")
    first = np.ceil(begin * part.rate) / part.rate
    ceiling = None if bag is None else _ceiling(bag, float(first))
    return Measured(part.rate, part.support, part.beam, ceiling, float(first), chosen)


def _without_gap(whole: Recording) -> tuple[float, float]:
    """Return begin and end [s] of the longest part in which support and beam are valid; all where nothing is."""
    support = whole.beam if whole.support is None else whole.support
    parts = runs(np.isfinite(support + whole.beam))
    first, last = max(parts, key=lambda part: part[1] - part[0], default=(0, whole.beam.size))
    if last - first == whole.beam.size:
        return 0.0, math.inf
    return max(0.0, first - 0.25) / whole.rate, (last + 0.25) / whole.rate  # between two samples


def scene_of(path: Path, bag: Bag | None, given: Path | None) -> Scene:
    """Return the scene in `given`, else the one kept in the bag; raise SceneError or ValidationError."""
    if given is not None:
        return load_scene(given)
    if bag is None or bag.scene_text is None:
        raise ValidationError(f"{path}: no scene was recorded; give one with --scene")
    try:
        return scene_from_mapping(read_yaml(bag.scene_text, "recorded scene"), source="recorded scene", folder=path)
    except SceneError as error:
        raise SceneError(f"{error}; give a scene with --scene") from None


def _ceiling(bag: Bag, begin: float) -> Array | None:
    """Return times since `begin` [s] and heights (k, 2) of the ceiling; None where its state was not recorded."""
    start = _first_stamp(bag)
    found = [((stamp_of(state) - start) * 1e-9 - begin, state.height) for _, state in bag.of_kind("CeilingState")]
    heights = np.array(found, dtype=np.float64).reshape(-1, 2)
    heights = heights[np.isfinite(heights).all(axis=1)]
    return heights[np.argsort(heights[:, 0], kind="stable")] if len(heights) else None


def faults_in(bag: Bag, measured: Measured) -> list[str]:
    """Return a line for each fault that was reported within the part."""
    start, ends = _first_stamp(bag), (measured.begin, measured.begin + measured.duration)
    events = (((stamp_of(event) - start) * 1e-9, event) for _, event in bag.of_kind("Event"))
    return [fault_line(time, event.header.frame_id, event.text)
            for time, event in events if event.kind == _FAULT and ends[0] <= time <= ends[1]]  # fmt: skip


def _first_stamp(bag: Bag) -> int:
    return next(stamp_of(block) for _, block in bag.messages(TOPIC) if len(block.data))
