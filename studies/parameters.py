# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies parameters`: docs/parameters.md and the parameter files, from what the nodes declare."""

import argparse
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import yaml

from atpid_common.errors import DONE
from atpid_common.nodes import node_main
from atpid_common.parameters import Entry
from atpid_control.nodes import live_node, recorder_parameters, replay_node
from atpid_control.nodes.parameter_tables import IDENTIFIER, SELECTOR
from atpid_control.supervision.limits import SUPERVISOR
from atpid_driver.acquisition.registry import BUILT_IN, backend
from atpid_driver.nodes import feed_node, motor_interface
from atpid_driver.nodes.acquisition_parameters import common_rows, own_rows
from atpid_exciter.nodes import excitation_node
from atpid_lab.nodes import foxglove_node
from atpid_sim.nodes import plant_node

Table = tuple[Entry, ...]
ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "parameters.md"
BACKENDS: dict[str, Table] = {name: own_rows(backend(name).settings) for name in BUILT_IN}
ACQUISITION: Table = common_rows()
#: What motor and exciter share.
DRIVES: Table = tuple(row for row in motor_interface.TABLE if row in excitation_node.TABLE)
#: The tables of the page, by their headings.
SECTIONS: dict[str, Table] = {
    "Every node": node_main.PARAMETERS,
    "identifier_node": IDENTIFIER,
    "selector_node": SELECTOR,
    "supervisor_node": SUPERVISOR,
    "live_node": live_node.PARAMETERS,
    "Motor and exciter": DRIVES,
    "motor_node": tuple(row for row in motor_interface.TABLE if row not in DRIVES),
    "excitation_node": tuple(row for row in excitation_node.TABLE if row not in DRIVES),
    "recorder_node": recorder_parameters.PARAMETERS,
    "acquisition_node": ACQUISITION,
    **{f"Backend {name}": table for name, table in BACKENDS.items()},
    "plant_node": plant_node.PARAMETERS,
    "replay_node": replay_node.PARAMETERS,
    "foxglove_node": foxglove_node.PARAMETERS,
    "feed_node": feed_node.PARAMETERS,
}
#: The parameter files that hold all defaults but of what a start sets, and those that hold values of their own.
DEFAULTS: dict[str, Table] = {
    "atpid_control/config/identifier.yaml": IDENTIFIER,
    "atpid_control/config/selector.yaml": SELECTOR,
    "atpid_control/config/supervisor.yaml": SUPERVISOR,
    "atpid_control/config/live.yaml": live_node.PARAMETERS,
}
CHOSEN: dict[str, Table] = {
    "atpid_control/config/recorder.yaml": recorder_parameters.PARAMETERS,
    "atpid_driver/config/labjack.yaml": (*ACQUISITION, *BACKENDS["labjack"]),
    "atpid_driver/config/ni.yaml": (*ACQUISITION, *BACKENDS["nidaqmx"]),
    "atpid_driver/config/motor.yaml": motor_interface.TABLE,
    "atpid_driver/config/motor_serial.yaml": motor_interface.TABLE,
    "extensions/atpid_exciter/config/excitation.yaml": excitation_node.TABLE,
    "atpid_sim/config/plant.yaml": plant_node.PARAMETERS,
}
#: Arguments of the example in the help.
EXAMPLE = ""
SET_AT_START = ("scene", "map", "method", "lockstep")
#: A list of more entries is described in words on the page.
_LONGEST_LIST = 6


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """Add none."""


def run(_args: argparse.Namespace) -> int:
    """Write the page and the files anew."""
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    for name in (*DEFAULTS, *CHOSEN):
        path = ROOT / name
        path.write_text(parameter_file(name, path.read_text(encoding="utf-8")), encoding="utf-8")
    return DONE


def page(text: str) -> str:
    """Return the page with the table of each section as its node declares it."""
    for heading, table in SECTIONS.items():
        section = rf"(?<=\n## {heading}\n)((?:(?!\n## ).)*?)\n\|.*?\n(?=\n|\Z)"
        text = re.sub(section, partial(_anew, table), text, flags=re.DOTALL)
    return text


def _anew(table: Table, section: re.Match[str]) -> str:
    return f"{section[1]}\n{markdown(table)}\n"


def markdown(table: Sequence[Entry]) -> str:
    """Return the table as the page shows it."""
    head = ("parameter", "default; allowed", "meaning")
    rows = [head, ("---",) * len(head), *_joined([_cells(row) for row in table])]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _joined(rows: Sequence[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """Return the rows, the two levels of one quantity as one."""
    joined: list[tuple[str, str, str]] = []
    for name, values, meaning in rows:
        if name.endswith("_abort`") and joined and joined[-1][0] == name.replace("_abort", "_warning"):
            joined[-1] = (f"{joined[-1][0]}, {name}", values, meaning.replace("abort level", "warning and abort level"))
        else:
            joined.append((name, values, meaning))
    return joined


def _cells(row: Entry) -> tuple[str, str, str]:
    default = f"`{row.default}`" if row.default != "" else "empty"
    if isinstance(row.default, type):
        default = "none"
    elif isinstance(row.default, list) and len(row.default) >= _LONGEST_LIST:
        default = "all of the graph"
    allowed = ", ".join(f"`{choice}`" if choice else "empty" for choice in row.choices)
    if row.low is not None and row.high is not None:
        allowed = f"{row.low:g}…{row.high:g}"
    values = f"{default}; {allowed}" if allowed else default
    return f"`{row.name}`{', live' if row.live else ''}", values, row.meaning


def parameter_file(name: str, text: str) -> str:
    """Return the parameter file `name`, now `text`: its head as it is, and the meaning of each value beside it."""
    head = [line for line in text.splitlines() if not line.startswith("    ")]
    (node,) = yaml.safe_load(text).values()
    table = {row.name: row for row in DEFAULTS.get(name, CHOSEN.get(name, ()))}
    values = node["ros__parameters"]
    if name in DEFAULTS:
        values = {row.name: row.default for row in table.values() if row.name not in SET_AT_START}
    lines = [f"    {key}: {_scalar(value)}  # {table[key].meaning}" for key, value in values.items()]
    return "\n".join([*head, *lines, ""])


def _scalar(value: object) -> str:
    """Return a value in YAML 1.1, on one line."""
    return yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("...\n").strip()
