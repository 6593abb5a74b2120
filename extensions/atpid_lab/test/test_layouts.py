# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each path in the layouts of Foxglove and PlotJuggler leads to a number, or a text, in a file with traces."""

import json
from typing import Any
from xml.etree.ElementTree import parse

import pytest
from documented import ROOT
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from traced_file import Traced

from atpid_control.cli import main
from atpid_control.runs import topics
from atpid_control.runs.decode import message_type
from atpid_lab.traces.records import TEXT

#: What a stand records besides, and no bag in lockstep: by the machine's clock.
RECORDED = topics.parse(topics.DEFAULT, False)
BESIDES = {name.name if name.name.startswith("/") else f"/{name.name}": name.type for name in RECORDED}
LAYOUT: dict[str, Any] = json.loads((ROOT / "docs/foxglove/atpid.json").read_text(encoding="utf-8"))
PLOTJUGGLER = parse(ROOT / "docs/foxglove/plotjuggler.xml").getroot()


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Traced:
    file = tmp_path_factory.mktemp("traces") / "traces.mcap"
    assert main(["bag", "traces", str(ROOT / "bags/thesis_4_3_short"), "--out", str(file)]) == 0
    return Traced(file)


def leaf(traced: Traced, topic: str, path: str) -> str:
    """Return the type at the end of a path of fields, none of them an array: a plot of one line over time."""
    kind = traced.types.get(topic) or {"/traces/supervisor_state": TEXT, **BESIDES}[topic]
    store = traced.store
    if kind not in store.fielddefs:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(message_type(kind).definition, kind))
    for name in path.split("."):
        node, inside = dict(store.fielddefs[kind][1])[name]
        assert node in (Nodetype.BASE, Nodetype.NAME), f"{topic}.{path}: an array"
        kind = str(inside[0] if node == Nodetype.BASE else inside)
    return kind


def test_every_path_leads_to_what_its_panel_shows(traced: Traced) -> None:
    plotted, states = (
        [path["value"].split(".", 1) for name, panel in LAYOUT["configById"].items() if name.startswith(f"{kind}!")
         for path in panel["paths"]] for kind in ("Plot", "StateTransitions")
    )  # fmt: skip
    curves = [str(curve.get("name")).rpartition("/") for curve in PLOTJUGGLER.iter("curve")]
    assert min(len(plotted), len(curves)) > 10
    assert {topic for topic, _, _ in curves} <= traced.types.keys()
    for topic, field in (*plotted, *((topic, field) for topic, _, field in curves)):
        assert leaf(traced, topic, field).startswith(("int", "uint", "float", "bool")), (topic, field)
    assert [leaf(traced, *path) for path in states] == ["string"] * len(states)
    with pytest.raises(AssertionError, match="array"):
        leaf(traced, "/sensors/laser", "data")
    with pytest.raises(KeyError):
        leaf(traced, "/excitation", "amplitud")
