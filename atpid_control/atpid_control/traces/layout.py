# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control.traces.layout --out DIR`: layouts for Foxglove and PlotJuggler, from one table of plots."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_common.cli import Parser, run_parsed
from atpid_common.errors import DONE
from atpid_control.traces.markers import FRAME
from atpid_control.traces.records import PREFIX

#: Names of the files.
FOXGLOVE, PLOTJUGGLER = "atpid.json", "plotjuggler.xml"
#: Arguments of the example in the help.
EXAMPLE = "--out docs/foxglove"
_LICENCE = "<!-- SPDX-License-Identifier: Apache-2.0 -->"
_COLOURS = ("#4e98e2", "#f5774d", "#5cd6a9", "#a395e2")


class Series(NamedTuple):
    """One curve: a number in the messages of a topic."""

    topic: str
    field: str
    label: str


class Plot(NamedTuple):
    """One plot over time."""

    title: str
    series: tuple[Series, ...]
    steps: bool = False  # the value holds until the next message


def _trace(name: str, label: str) -> Series:
    return Series(f"{PREFIX}{name}", "data", label)


PLOTS = (
    Plot("support [m]", (_trace("support_displacement", "support"),)),
    Plot("beam and grain [m]", (_trace("beam_displacement", "beam"), _trace("true_grain", "grain, simulated"))),
    Plot(
        "excitation [m]",
        (
            Series("/excitation", "amplitude", "identified"),
            _trace("amplitude_low", "2 standard deviations below"),
            _trace("amplitude_high", "2 standard deviations above"),
        ),
    ),
    Plot(
        "ceiling [m]",
        (
            Series("/ceiling/command", "height", "commanded"),
            Series("/ceiling/state", "height", "moved"),
            _trace("true_ceiling", "simulated"),
        ),
        steps=True,
    ),
    Plot("efficiency [-]", (_trace("efficiency", "efficiency"),)),
    Plot("frequency [Hz]", (Series("/excitation", "frequency", "identified"),)),
)
#: Texts, shown as transitions of a state.
STATES = (
    _trace("ceiling_mode", "ceiling"),
    _trace("excitation_quality", "estimate"),
    _trace("supervisor_state", "run"),
)
#: Their numbers: PlotJuggler draws no texts.
_NUMBERS = Plot(
    "states", (Series("/ceiling/state", "mode", "ceiling"), Series("/excitation", "quality", "estimate")), steps=True
)  # fmt: skip


def foxglove_layout() -> dict[str, Any]:
    """Return the layout that Foxglove imports from a file."""
    plots = {f"Plot!{place}": _foxglove_plot(plot) for place, plot in enumerate(PLOTS)}
    panels = {
        **plots,
        "3D!damper": _scene(),
        "StateTransitions!states": {
            "isSynced": True,
            "paths": [_path(state) | {"label": state.label} for state in STATES],
        },
        "RosOut!events": {"topicToRender": f"{PREFIX}log", "minLogLevel": 1, "searchTerms": []},
        "DiagnosticSummary!nodes": {
            "topicToRender": "/diagnostics", "minLevel": 0, "sortByLevel": True, "pinnedIds": [],
            "hardwareIdFilter": "",
        },
        "RawMessages!command": {"topicPath": "/ceiling/command", "expansion": "all"},
        "RawMessages!estimate": {"topicPath": "/excitation", "expansion": "all"},
    }  # fmt: skip
    left = _stack("column", [*plots, "StateTransitions!states"])
    right = _stack("column", ["3D!damper", "RosOut!events", "DiagnosticSummary!nodes"])
    raw = _stack("row", ["RawMessages!command", "RawMessages!estimate"])
    right = {"direction": "column", "first": right, "second": raw, "splitPercentage": 75}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": left, "second": right, "splitPercentage": 65},
    }


def _foxglove_plot(plot: Plot) -> dict[str, Any]:
    paths = [
        _path(series) | {"label": series.label, "color": colour, "lineSize": 1.5, "showLine": True}
        for series, colour in zip(plot.series, _COLOURS, strict=False)
    ]
    return {
        "foxglovePanelTitle": plot.title, "lichtblickPanelTitle": plot.title, "paths": paths,
        "xAxisVal": "timestamp", "isSynced": True, "showLegend": True, "legendDisplay": "floating",
        "showXAxisLabels": True, "showYAxisLabels": True,
        "showPlotValuesInLegend": True, "followingViewWidth": 10,
    }  # fmt: skip


def _path(series: Series) -> dict[str, Any]:
    return {"value": f"{series.topic}.{series.field}", "enabled": True, "timestampMethod": "receiveTime"}


def _scene() -> dict[str, Any]:
    camera = {
        "perspective": True, "distance": 0.7, "phi": 80, "thetaOffset": 40, "targetOffset": [0, 0, 0.05],
        "target": [0, 0, 0], "targetOrientation": [0, 0, 0, 1], "fovy": 45, "near": 0.01, "far": 100,
    }  # fmt: skip
    return {
        "followTf": FRAME, "followMode": "follow-pose", "cameraState": camera, "scene": {}, "transforms": {},
        "topics": {f"{PREFIX}damper": {"visible": True}}, "layers": {}, "imageMode": {},
    }  # fmt: skip


def _stack(direction: str, panels: Sequence[str]) -> Any:
    """Return the panels side by side, of equal size, as the nested pairs that Foxglove splits the window into."""
    if len(panels) == 1:
        return panels[0]
    rest = _stack(direction, panels[1:])
    return {"direction": direction, "first": panels[0], "second": rest, "splitPercentage": 100 / len(panels)}


def plotjuggler_layout() -> str:
    """Return the layout that PlotJuggler loads."""
    root = Element("root")
    tabs = SubElement(root, "tabbed_widget", {"parent": "main_window", "name": "Main Window"})
    tab = SubElement(tabs, "Tab", tab_name="ATPID", containers="1")
    plots = (*PLOTS, _NUMBERS)
    share = ";".join([f"{1.0 / len(plots):.6f}"] * len(plots))
    split = SubElement(
        SubElement(tab, "Container"), "DockSplitter", orientation="-", count=str(len(plots)), sizes=share
    )
    for plot in plots:
        area = SubElement(split, "DockArea", name=plot.title)
        drawn = SubElement(
            area, "plot", mode="TimeSeries", style="Steps" if plot.steps else "Lines", line_width="1.0",
            flip_x="false", flip_y="false",
        )  # fmt: skip
        for series, colour in zip(plot.series, _COLOURS, strict=False):
            SubElement(drawn, "curve", name=f"{series.topic}/{series.field}", color=colour)
    SubElement(tabs, "currentTabIndex", index="0")
    SubElement(root, "use_relative_time_offset", enabled="1")
    indent(root, " ")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{_LICENCE}\n{tostring(root, encoding="unicode")}\n'


def write_layouts(folder: Path) -> list[Path]:
    """Write both layouts; return their files. Raises OutputError."""
    texts = {FOXGLOVE: json.dumps(foxglove_layout(), indent=2) + "\n", PLOTJUGGLER: plotjuggler_layout()}
    output.folder(folder)
    for name, text in texts.items():
        with output.writing(folder / name):
            (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""

    def run(given: Any) -> int:
        print(*write_layouts(given.out), sep="\n")
        return DONE

    parser = Parser(prog="python -m atpid_control.traces.layout", description=__doc__, example=EXAMPLE)
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help="folder for both files")
    parser.set_defaults(run=run)
    return run_parsed(lambda: parser, argv)


if __name__ == "__main__":
    sys.exit(main())
