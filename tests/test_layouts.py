# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The layouts of Foxglove and PlotJuggler against a file with traces."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from traced_file import Traced

from atpid_control.cli import main
from atpid_control.runs.definitions import message_type
from atpid_control.runs.read import Bag, open_bag
from atpid_control.runs.topics import BY_CLOCK, DEFAULT, parse
from atpid_control.views.traces.records import LOG, MARKERS, TEXT

ROOT = next(folder for folder in Path(__file__).resolve().parents if (folder / "bags").is_dir())
BAG = ROOT / "bags/thesis_4_3_short"
FOXGLOVE, PLOTJUGGLER = ROOT / "docs/foxglove/atpid.json", ROOT / "docs/foxglove/plotjuggler.xml"
#: What a stand records besides, and no bag in lockstep: by the machine's clock.
BESIDES = {name.name if name.name.startswith("/") else f"/{name.name}": name.type for name in parse(DEFAULT, False)}
#: Traces of what is by the machine's clock.
TRACED_BESIDES = {"/traces/supervisor_state": TEXT}


@pytest.fixture(scope="module")
def bag() -> Bag:
    return open_bag(BAG)


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Traced:
    file = tmp_path_factory.mktemp("traces") / "traces.mcap"
    assert main(["bag", "traces", str(BAG), "--out", str(file)]) == 0
    return Traced(file)


# the file


def fields_of(store: Any, kind: str) -> dict[str, Any]:
    return dict(store.fielddefs[kind][1])


def leaf(traced: Traced, topic: str, path: str) -> str:
    """Return the type at the end of a path of fields, none of them an array: a plot of one line over time."""
    kind = traced.types.get(topic) or BESIDES.get(topic) or TRACED_BESIDES[topic]
    store = traced.store
    if kind not in store.fielddefs:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(message_type(kind).definition, kind))
    for name in path.split("."):
        node, inside = fields_of(store, kind)[name]
        assert node in (Nodetype.BASE, Nodetype.NAME), f"{topic}.{path}: an array"
        kind = inside[0] if node == Nodetype.BASE else inside
    return str(kind)


def numeric(kind: str) -> bool:
    return kind.startswith(("int", "uint", "float", "bool"))


def panels(kind: str) -> Iterator[dict[str, Any]]:
    layout = json.loads(FOXGLOVE.read_text())
    return (config for name, config in layout["configById"].items() if name.partition("!")[0] == kind)


def test_every_panel_has_its_place_once() -> None:
    def names(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*names(node["first"]), *names(node["second"])]

    layout = json.loads(FOXGLOVE.read_text())
    assert sorted(names(layout["layout"])) == sorted(layout["configById"])


def test_every_foxglove_path_leads_to_what_its_panel_shows(traced: Traced) -> None:
    plotted = [path["value"] for plot in panels("Plot") for path in plot["paths"]]
    assert len(plotted) > 10
    for path in plotted:
        topic, _, field = path.partition(".")
        assert numeric(leaf(traced, topic, field)), path
    for path in (path["value"] for panel in panels("StateTransitions") for path in panel["paths"]):
        assert leaf(traced, *path.split(".", 1)) == "string"
    assert [traced.types[topic] for panel in panels("3D") for topic in panel["topics"]] == [MARKERS]
    assert [traced.types[panel["topicToRender"]] for panel in panels("RosOut")] == [LOG]
    shown = [BESIDES[panel["topicToRender"]] for panel in panels("DiagnosticSummary")]
    assert shown == ["diagnostic_msgs/msg/DiagnosticArray"]
    assert {panel["topicPath"] for panel in panels("RawMessages")} <= traced.types.keys()


def test_every_curve_of_plotjuggler_is_a_number_in_the_file(traced: Traced) -> None:
    root = ElementTree.parse(PLOTJUGGLER).getroot()
    curves = [str(curve.get("name")) for curve in root.iter("curve")]
    assert len(curves) > 10
    for name in curves:
        topic, _, field = name.rpartition("/")
        assert traced.types[topic]
        assert numeric(leaf(traced, topic, field)), name
    split = next(root.iter("DockSplitter"))
    assert int(str(split.get("count"))) == len(split) == len(str(split.get("sizes")).split(";"))


def test_a_path_into_an_array_or_beside_the_fields_is_found(traced: Traced) -> None:
    with pytest.raises(AssertionError, match="an array"):
        leaf(traced, "/sensors/laser", "data")
    with pytest.raises(KeyError):
        leaf(traced, "/excitation", "amplitud")
    assert {kind for kind in BY_CLOCK if kind.startswith("atpid")} <= set(BESIDES.values())
