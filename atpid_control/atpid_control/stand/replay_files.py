# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a bag to the files its replay needs: the scene, the height map, and a parameter file for every node."""

from dataclasses import dataclass
from pathlib import Path

from atpid_common.files import Document, FileError, parse_yaml
from atpid_common.vocabulary import EventKind
from atpid_control.runs.errors import BagError, in_words
from atpid_control.runs.metadata import SCENE, commit_of
from atpid_control.runs.read import Bag, open_bag
from atpid_control.stand.parameters import Parameters, parameters_in, write_parameters
from atpid_control.stand.parts import LOOP, Part

_PARAMETER_FILE = "parameters.yaml"
#: There is no motor: the ceiling's state comes from the bag as well.
PLAYED = ["sensors/*", "ceiling/state"]
IDENTIFIER, SELECTOR, RECORDER = LOOP
REPLAY = Part("atpid_control", "replay_node", "")
#: Parameters that name a file, or how messages are queued; a replay sets them itself.
_OF_THE_RUN = ("scene", "map", "lockstep")
#: Parameters that a parameter file of the package leaves open, beside those.
_LEFT_OPEN = ("method", "real_time_priority", "lock_memory")
#: A file that may be given.
_File = Path | None
#: Longest parameter file that is read from a bag [bytes]; ours have some thousand.
_MOST_BYTES = 200_000


@dataclass(frozen=True)
class _ReplayFiles:
    """What a replay is started with."""

    parameters: Path  # parameter file of identifier_node, selector_node, recorder_node and replay_node
    scene: Path
    height_map: Path | None
    notes: tuple[str, ...]  # where the replay differs from the run, a line each; empty: nowhere


def write_replay_files(
    bag: Path,
    folder: Path,
    *,
    rate: float = 0.0,
    record: _File = None,
    scene: _File = None,
    height_map: _File = None,
) -> _ReplayFiles:
    """Write what a replay of `bag` needs into `folder`, with the parameters the bag was made with.

    rate: speed against the recording [-], 0: as fast as the loop answers.
    record: bag to make of the replay, None: none.
    scene, height_map: files to use in place of those kept in the bag.

    Raises BagError: no bag, no scene or map in it and none given, or a folder that cannot be written.
    """
    opened = open_bag(bag)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scene_file = scene or _scene(opened, folder)
        chosen = {part.name: part.configured() | _parameters_kept(opened, part.name) for part in (IDENTIFIER, SELECTOR)}
        map_file = height_map or _height_map(opened, chosen[SELECTOR.name], folder)
        parameters = _all_parameters(chosen, bag, scene_file, map_file, rate, record)
        path = folder / _PARAMETER_FILE
        write_parameters(parameters, path)
    except OSError as error:
        raise BagError(f"{folder}: cannot be written: {in_words(error)}") from None
    notes = [line for part in (IDENTIFIER, SELECTOR) for line in differences(part, _parameters_kept(opened, part.name))]
    recorded, installed = opened.run.get("commit", "unknown"), commit_of(Path(__file__))
    if recorded.removesuffix("-dirty") != installed.removesuffix("-dirty"):
        notes.append(f"recorded with version {recorded}, replayed with {installed}")
    return _ReplayFiles(path, scene_file, map_file, (*notes, *_changes_while_running(opened)))


def _all_parameters(
    chosen: Parameters, bag: Path, scene: Path, height_map: Path | None, rate: float, record: Path | None
) -> Parameters:
    """Return the parameters of the four nodes; what depends on this machine is this machine's."""
    run = {"scene": str(scene.absolute()), "lockstep": True}
    identifier = chosen[IDENTIFIER.name] | {"lockstep": True}
    if identifier.get("scene"):
        identifier["scene"] = run["scene"]
    selector = chosen[SELECTOR.name] | run | {"map": str(height_map.absolute()) if height_map else ""}
    recorder = RECORDER.configured() | run | {"bag": str(record.absolute()) if record else ""}
    replay = {"bag": str(bag.absolute()), "rate": float(rate), "topics": PLAYED, "expect_recorder": record is not None}
    return {IDENTIFIER.name: identifier, SELECTOR.name: selector, RECORDER.name: recorder, REPLAY.name: replay}


def _scene(bag: Bag, folder: Path) -> Path:
    if bag.scene_text is None:
        missing = f"{bag.path}: no scene is kept in this bag"
        raise BagError(f"{missing}, so the selector cannot be started; give one (--scene)")
    path = folder / SCENE
    path.write_text(bag.scene_text, encoding="utf-8")
    return path


def _height_map(bag: Bag, selector: Document, folder: Path) -> Path | None:
    """Write the height map that the selector used; None where it used none."""
    used = str(selector.get("map", ""))
    if not used:
        return None
    name = Path(used).name
    if name not in bag.files or not name.strip("."):
        raise BagError(f"{bag.path}: the height map {name} of the run is not kept in this bag; give it (--map)")
    (folder / name).write_bytes(bag.files[name])
    return folder / name


def _parameters_kept(bag: Bag, node: str) -> Document:
    """Return the parameters of `node` that the bag keeps; empty: none.

    What the node itself reported to the recorder (`NODE.yaml`) takes precedence over the files it was started with.
    """
    found: Document = {}
    own = f"{node}.yaml"
    for name, data in sorted(bag.files.items(), key=lambda file: file[0] == own):
        if name.endswith((".yaml", ".yml")) and name != SCENE:
            found.update(parameters_in(_blocks(data), node))
    return found


def differences(part: Part, kept: Document) -> list[str]:
    """Return, one parameter a line, where a replay cannot use what the bag keeps and what it uses instead."""
    today, name = part.configured(), part.name
    if not kept:
        values = ", ".join(f"{key} {value}" for key, value in today.items())
        return [f"{name}: the bag keeps none of its parameters, those of {part.config} are used: {values}"]
    known = {*today, *_OF_THE_RUN, *_LEFT_OPEN}
    lines = [f"{name}: {key} is not in the bag, {value} is used" for key, value in today.items() if key not in kept]
    unknown = {key: value for key, value in kept.items() if key not in known}
    return lines + [f"{name}: {key} was {value} and does not exist any more" for key, value in unknown.items()]


def _changes_while_running(bag: Bag) -> list[str]:
    """Return, one a line, which parameters were changed during the run: a replay keeps the values of its start."""
    return [
        f"{event.node}: changed during the run, which is not replayed: {event.text}"
        for _, event in bag.of_kind("Event")
        if event.kind == EventKind.PARAMETER
    ]


def _blocks(data: bytes) -> Document:
    """Return the blocks with `ros__parameters` of a parameter file; none where it is another file."""
    try:
        document = parse_yaml(data) if len(data) < _MOST_BYTES else None
    except FileError:
        return {}
    if not isinstance(document, dict):
        return {}
    blocks = {str(key): block for key, block in document.items() if isinstance(block, dict)}
    return {key: block for key, block in blocks.items() if isinstance(block.get("ros__parameters"), dict)}
