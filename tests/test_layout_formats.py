# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The layouts against the formats that the two programs read, as their public sources have them.

Foxglove: Lichtblick, its open fork, packages/suite-base/src (panels/*/types.ts, context/CurrentLayoutContext) and
packages/message-path/src/grammar.ne. PlotJuggler: plotjuggler_app (mainwindow.cpp, tabbedplotwidget.cpp,
plot_docker.cpp, plotwidget.cpp). The programs pass over a name they do not have, so that a slip shows as nothing.
"""

import json
import re
from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import pytest
from documented import ROOT

#: Type of a panel, and the settings it reads; a title is foxglovePanelTitle in one program, in the other not.
PANELS = {
    "Plot": {"foxglovePanelTitle", "lichtblickPanelTitle", "paths", "xAxisVal", "isSynced", "showLegend",
             "legendDisplay", "showPlotValuesInLegend", "showXAxisLabels", "showYAxisLabels", "followingViewWidth",
             "minXValue", "maxXValue", "minYValue", "maxYValue", "xAxisPath", "xAxisLabel", "yAxisLabel",
             "sidebarDimension"},
    "StateTransitions": {"isSynced", "paths", "xAxisMaxValue", "xAxisMinValue", "xAxisRange", "xAxisLabel",
                         "showPoints"},
    "RawMessages": {"topicPath", "expansion", "diffEnabled", "diffMethod", "diffTopicPath", "showFullMessageForDiff",
                    "fontSize"},
    "RosOut": {"searchTerms", "minLogLevel", "topicToRender", "nameFilter"},
    "DiagnosticSummary": {"minLevel", "pinnedIds", "topicToRender", "hardwareIdFilter", "sortByLevel",
                          "secondsUntilStale"},
    "3D": {"cameraState", "followMode", "followTf", "scene", "transforms", "topics", "layers", "publish",
           "synchronize", "imageMode"},
}  # fmt: skip
CAMERA = {"distance", "perspective", "phi", "target", "targetOffset", "targetOrientation", "thetaOffset", "fovy",
          "near", "far"}  # fmt: skip
PLOT_PATH = {"value", "enabled", "color", "label", "timestampMethod", "showLine", "lineSize"}
STATE_PATH = {"value", "enabled", "color", "label", "timestampMethod"}
LAYOUT = {"configById", "layout", "globalVariables", "playbackConfig", "userNodes", "savedProps", "version"}
#: grammar.ne: a topic without quotes, then fields; no slice, since each plot is one number over time.
PATH = re.compile(r"(?:/[a-zA-Z0-9_-]*)+(?:\.[a-zA-Z0-9_-]+)+")

#: Element: the attributes that are read, and the elements inside.
ELEMENTS = {
    "root": (set(), {"tabbed_widget", "use_relative_time_offset", "streaming_buffer_size", "Plugins"}),
    "tabbed_widget": ({"name", "parent"}, {"Tab", "currentTabIndex"}),
    "Tab": ({"tab_name", "containers"}, {"Container"}),
    "Container": (set(), {"DockSplitter"}),
    "DockSplitter": ({"orientation", "count", "sizes"}, {"DockArea", "DockSplitter"}),
    "DockArea": ({"name"}, {"plot"}),
    "plot": ({"mode", "style", "line_width", "flip_x", "flip_y"}, {"curve", "range", "limitY"}),
    "curve": ({"name", "color"}, {"transform"}),
    "currentTabIndex": ({"index"}, set()),
    "use_relative_time_offset": ({"enabled"}, set()),
}
#: Attribute of a plot: its values.
VALUES = {
    "mode": {"TimeSeries", "XYPlot"},
    "style": {"Lines", "LinesAndDots", "Dots", "Sticks", "Steps", "StepsInv"},
    "line_width": {"1.0", "1.5", "2.0", "3.0"},
    "flip_x": {"true", "false"},
    "flip_y": {"true", "false"},
}


def foxglove_layout() -> dict[str, Any]:
    layout: dict[str, Any] = json.loads((ROOT / "docs/foxglove/atpid.json").read_text())
    return layout


def panels(layout: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield type and settings of each panel."""
    return ((name.partition("!")[0], config) for name, config in layout["configById"].items())


def test_foxglove_has_every_panel_and_reads_every_setting() -> None:
    layout = foxglove_layout()
    assert layout.keys() <= LAYOUT
    for kind, config in panels(layout):
        assert config.keys() <= PANELS[kind], kind
        assert config.get("cameraState", {}).keys() <= CAMERA
        assert config.get("xAxisVal", "timestamp") in {"timestamp", "index", "custom", "currentCustom"}
        assert config.get("legendDisplay", "none") in {"floating", "top", "left", "none"}
        assert config.get("followMode", "follow-pose") in {"follow-pose", "follow-position", "follow-none"}


def test_foxglove_parses_every_path_as_one_number_over_time() -> None:
    for kind, config in panels(foxglove_layout()):
        for path in config.get("paths", ()):
            assert path.keys() <= (PLOT_PATH if kind == "Plot" else STATE_PATH)
            assert PATH.fullmatch(path["value"]), path["value"]
            assert path["timestampMethod"] in {"receiveTime", "headerStamp"}
            assert re.fullmatch("#[0-9a-f]{6}", path.get("color", "#000000"))


def test_a_title_has_the_unit_in_both_programs() -> None:
    plots = [config for kind, config in panels(foxglove_layout()) if kind == "Plot"]
    assert len(plots) > 4
    assert all(re.search(r" \[[^]]+\]$", plot["foxglovePanelTitle"]) for plot in plots)
    assert all(plot["lichtblickPanelTitle"] == plot["foxglovePanelTitle"] for plot in plots)


def test_plotjuggler_reads_every_element_and_attribute() -> None:
    def check(element: Element) -> None:
        attributes, inside = ELEMENTS[element.tag]
        assert element.keys() == [] or set(element.keys()) <= attributes, element.tag
        for child in element:
            assert child.tag in inside, f"{child.tag} in {element.tag}"
            check(child)

    root = fromstring((ROOT / "docs/foxglove/plotjuggler.xml").read_text())
    check(root)
    (window,) = root.findall("tabbed_widget")  # the only one the program looks for is its main window
    assert (window.get("parent"), window.get("name")) == ("main_window", "Main Window")
    for plot in root.iter("plot"):
        assert all(str(plot.get(name)) in allowed for name, allowed in VALUES.items())
    for split in root.iter("DockSplitter"):
        assert str(split.get("orientation")) in {"-", "|"}
        assert int(str(split.get("count"))) == len(split) == len(str(split.get("sizes")).split(";"))


@pytest.mark.parametrize("wrong", ["/a b.data", "/sensors/laser.data[:]", "/traces/x", "x..data", "/größe.data"])
def test_a_path_that_is_no_number_over_time_is_found(wrong: str) -> None:
    assert not PATH.fullmatch(wrong)
