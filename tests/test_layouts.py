# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The layouts of Foxglove and PlotJuggler: against a file with traces, and against what the programs read.

The programs pass over a name they do not have. Foxglove: Lichtblick, its open fork, packages/suite-base/src
(panels/*/types.ts) and packages/message-path/src/grammar.ne. PlotJuggler: plotjuggler_app (mainwindow.cpp and others).
"""

import json
import re
from typing import Any
from xml.etree.ElementTree import Element, parse

import pytest
from documented import ROOT
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from traced_file import Traced

from atpid_control.cli import main
from atpid_control.runs import topics
from atpid_control.runs.definitions import message_type
from atpid_control.views.traces.records import LOG, MARKERS, TEXT

#: What a stand records besides, and no bag in lockstep: by the machine's clock.
RECORDED = topics.parse(topics.DEFAULT, False)
BESIDES = {name.name if name.name.startswith("/") else f"/{name.name}": name.type for name in RECORDED}
#: Type of a panel, and settings it reads; a title is foxglovePanelTitle in one program, in the other not.
PANELS = {
    "Plot": {"foxglovePanelTitle", "lichtblickPanelTitle", "paths", "xAxisVal", "isSynced", "showLegend",
             "legendDisplay", "showPlotValuesInLegend", "showXAxisLabels", "showYAxisLabels", "followingViewWidth"},
    "StateTransitions": {"isSynced", "paths"},
    "RawMessages": {"topicPath", "expansion"},
    "RosOut": {"searchTerms", "minLogLevel", "topicToRender"},
    "DiagnosticSummary": {"minLevel", "pinnedIds", "topicToRender", "hardwareIdFilter", "sortByLevel"},
    "3D": {"cameraState", "followMode", "followTf", "scene", "transforms", "topics", "layers", "imageMode"},
}  # fmt: skip
CAMERA = {"distance", "perspective", "phi", "target", "targetOffset", "targetOrientation", "thetaOffset", "fovy",
          "near", "far"}  # fmt: skip
PLOTTED = {"value", "enabled", "color", "label", "timestampMethod", "showLine", "lineSize"}
#: grammar.ne: a topic without quotes, then fields; no slice, since each plot is one number over time.
PATH = re.compile(r"(?:/[a-zA-Z0-9_-]*)+(?:\.[a-zA-Z0-9_-]+)+")
#: Attribute of a plot: its values.
VALUES = {"mode": {"TimeSeries"}, "style": {"Lines", "Steps"}, "line_width": {"1.0", "1.5"}, "flip_x": {"false"},
          "flip_y": {"false"}}  # fmt: skip
#: Element: the attributes that are read, and the elements inside.
ELEMENTS: dict[str, tuple[set[str], set[str]]] = {
    "root": (set(), {"tabbed_widget", "use_relative_time_offset"}),
    "tabbed_widget": ({"name", "parent"}, {"Tab", "currentTabIndex"}),
    "Tab": ({"tab_name", "containers"}, {"Container"}),
    "Container": (set(), {"DockSplitter"}),
    "DockSplitter": ({"orientation", "count", "sizes"}, {"DockArea", "DockSplitter"}),
    "DockArea": ({"name"}, {"plot"}),
    "plot": (set(VALUES), {"curve"}),
    "curve": ({"name", "color"}, set()),
    "currentTabIndex": ({"index"}, set()),
    "use_relative_time_offset": ({"enabled"}, set()),
}
LAYOUT: dict[str, Any] = json.loads((ROOT / "docs/foxglove/atpid.json").read_text(encoding="utf-8"))
PLOTJUGGLER = parse(ROOT / "docs/foxglove/plotjuggler.xml").getroot()


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Traced:
    file = tmp_path_factory.mktemp("traces") / "traces.mcap"
    assert main(["bag", "traces", str(ROOT / "bags/thesis_4_3_short"), "--out", str(file)]) == 0
    return Traced(file)


def panels(kind: str) -> list[dict[str, Any]]:
    return [config for name, config in LAYOUT["configById"].items() if name.partition("!")[0] == kind]


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


def is_number(traced: Traced, topic: str, path: str) -> bool:
    return leaf(traced, topic, path).startswith(("int", "uint", "float", "bool"))


def test_foxglove_has_every_panel_once_and_reads_every_setting() -> None:
    def names(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*names(node["first"]), *names(node["second"])]

    assert sorted(names(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
    assert set(LAYOUT) <= {"configById", "layout", "globalVariables", "playbackConfig", "userNodes"}
    for name, config in LAYOUT["configById"].items():
        assert set(config) <= PANELS[name.partition("!")[0]], name
        assert set(config.get("cameraState", {})) <= CAMERA
        assert config.get("xAxisVal", "timestamp") in {"timestamp", "index", "custom", "currentCustom"}
        assert config.get("legendDisplay", "none") in {"floating", "top", "left", "none"}
        assert config.get("followMode", "follow-pose") in {"follow-pose", "follow-position", "follow-none"}
    for plot in panels("Plot"):
        assert re.search(r" \[[^]]+\]$", plot["foxglovePanelTitle"]), "the unit"
        assert plot["lichtblickPanelTitle"] == plot["foxglovePanelTitle"]


def test_every_foxglove_path_leads_to_what_its_panel_shows(traced: Traced) -> None:
    plotted, states = (
        [path for panel in panels(kind) for path in panel["paths"]] for kind in ("Plot", "StateTransitions")
    )
    assert len(plotted) > 10
    for path in (*plotted, *states):
        assert set(path) <= (PLOTTED if path in plotted else PLOTTED - {"showLine", "lineSize"})
        assert PATH.fullmatch(path["value"]), path["value"]
        assert path["timestampMethod"] in {"receiveTime", "headerStamp"}
        assert re.fullmatch("#[0-9a-f]{6}", path.get("color", "#000000"))
    for path in plotted:
        assert is_number(traced, *path["value"].split(".", 1)), path
    for path in states:
        assert leaf(traced, *path["value"].split(".", 1)) == "string"
    assert [traced.types[topic] for panel in panels("3D") for topic in panel["topics"]] == [MARKERS]
    assert [traced.types[panel["topicToRender"]] for panel in panels("RosOut")] == [LOG]
    shown = [BESIDES[panel["topicToRender"]] for panel in panels("DiagnosticSummary")]
    assert shown == ["diagnostic_msgs/msg/DiagnosticArray"]
    assert {panel["topicPath"] for panel in panels("RawMessages")} <= traced.types.keys()


def test_plotjuggler_reads_every_element_and_each_curve_is_a_number_in_the_file(traced: Traced) -> None:
    def check(element: Element) -> None:
        attributes, inside = ELEMENTS[element.tag]
        assert set(element.keys()) <= attributes, element.tag
        assert {child.tag for child in element} <= inside, element.tag
        for child in element:
            check(child)

    check(PLOTJUGGLER)
    (window,) = PLOTJUGGLER.findall("tabbed_widget")  # the only one the program looks for is its main window
    assert (window.get("parent"), window.get("name")) == ("main_window", "Main Window")
    for plot in PLOTJUGGLER.iter("plot"):
        assert all(str(plot.get(name)) in allowed for name, allowed in VALUES.items())
    for split in PLOTJUGGLER.iter("DockSplitter"):
        assert str(split.get("orientation")) in {"-", "|"}
        assert int(str(split.get("count"))) == len(split) == len(str(split.get("sizes")).split(";"))
    curves = [str(curve.get("name")) for curve in PLOTJUGGLER.iter("curve")]
    assert len(curves) > 10
    for topic, _, field in (name.rpartition("/") for name in curves):
        assert topic in traced.types
        assert is_number(traced, topic, field)


def test_a_path_that_is_no_number_over_time_is_found(traced: Traced) -> None:
    for wrong in ("/a b.data", "/sensors/laser.data[:]", "/traces/x", "x..data", "/größe.data"):
        assert not PATH.fullmatch(wrong)
    with pytest.raises(AssertionError, match="array"):
        leaf(traced, "/sensors/laser", "data")
    with pytest.raises(KeyError):
        leaf(traced, "/excitation", "amplitud")
    assert {kind for kind in topics.BY_CLOCK if kind.startswith("atpid")} <= set(BESIDES.values())
