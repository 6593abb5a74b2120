# SPDX-License-Identifier: Apache-2.0
"""The parameters a bag keeps: those of the files it was started with, and those the recorder asked the nodes for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from atpid_control.bagread import Bag
from atpid_control.bench.graph import Part, parameters_in
from atpid_control.recording.run_info import SCENE

#: Parameters that say where a file is, or how messages queue; a replay sets them itself.
OF_THE_RUN = ("scene", "map", "lockstep")
#: Parameters that a parameter file of the package leaves open, beside those.
_LEFT_OPEN = ("method",)


def parameters_kept(bag: Bag, node: str) -> dict[str, Any]:
    """Return the parameters of `node` that the bag keeps; empty: none.

    What the node itself reported to the recorder (`NODE.yaml`) takes precedence over the files it was started with.
    """
    found: dict[str, Any] = {}
    own = f"{node}.yaml"
    for name, data in sorted(bag.files.items(), key=lambda file: file[0] == own):
        if name.endswith((".yaml", ".yml")) and name != SCENE:
            found.update(parameters_in(_blocks(data), node))
    return found


def differences(part: Part, kept: Mapping[str, Any]) -> list[str]:
    """Return, one parameter a line, where a replay cannot use what the bag keeps and what it uses instead."""
    today = part.configured()
    name = part.name
    if not kept:
        values = ", ".join(f"{key} {value}" for key, value in today.items())
        return [f"{name}: the bag keeps none of its parameters, those of {part.config} are used: {values}"]
    known = {*today, *OF_THE_RUN, *_LEFT_OPEN}
    lines = [f"{name}: {key} is not in the bag, {value} is used" for key, value in today.items() if key not in kept]
    unknown = {key: value for key, value in kept.items() if key not in known}
    return lines + [f"{name}: {key} was {value} and is not known any more" for key, value in unknown.items()]


def changes_while_running(bag: Bag) -> list[str]:
    """Return, one a line, which parameters were changed during the run: a replay keeps the values of its start."""
    events = (event for topic in bag.topics_of("Event") for _, event in bag.messages(topic))
    return [
        f"{event.header.frame_id}: changed during the run, which is not replayed: {event.text}"
        for event in events
        if event.kind == "parameter"
    ]


def _blocks(data: bytes) -> dict[str, Any]:
    """Return the blocks with `ros__parameters` of a parameter file; none where it is another file."""
    try:
        document = yaml.safe_load(data)
    except yaml.YAMLError:
        return {}
    if not isinstance(document, dict):
        return {}
    blocks = {str(key): block for key, block in document.items() if isinstance(block, dict)}
    return {key: block for key, block in blocks.items() if isinstance(block.get("ros__parameters"), dict)}
