# SPDX-License-Identifier: Apache-2.0
"""docs/parameters.md shows the tables the nodes declare, and the shipped parameter files hold the same defaults."""

from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml
from rclpy.parameter import Parameter

from atpid_common.nodes.parameters import Row
from atpid_control.nodes import recorder_parameters
from atpid_control.nodes.live_node import PARAMETERS as LIVE
from atpid_control.nodes.parameter_tables import IDENTIFIER, SELECTOR, SUPERVISOR
from atpid_driver.acquisition.registry import BUILT_IN, backend
from atpid_driver.nodes import motor_interface
from atpid_driver.nodes.acquisition_parameters import COMMON, own_rows, rows_of
from atpid_driver.nodes.channel_watch import THRESHOLDS

CONFIGURED = {
    "identifier_node": (IDENTIFIER, "atpid_control/config/identifier.yaml"),
    "selector_node": (SELECTOR, "atpid_control/config/selector.yaml"),
    "supervisor_node": (SUPERVISOR, "atpid_control/config/supervisor.yaml"),
    "live_node": (LIVE, "atpid_control/config/live.yaml"),
}


#: Sections of the page.
TABLES = {
    **{node: table for node, (table, _) in CONFIGURED.items()},
    "motor_node": motor_interface.TABLE,
    # its lists of topics and nodes are on docs/recording.md
    "recorder_node": tuple(row for row in recorder_parameters.PARAMETERS if not isinstance(row.default, list)),
    "acquisition_node": (*own_rows(None, "sensors/acquisition", False, 0.0), *COMMON, *THRESHOLDS),
    **{f"Backend {name}": rows_of(backend(name).settings) for name in BUILT_IN},
}


def markdown(table: Sequence[Row]) -> str:
    """Return the table as the page shows it."""
    head = ("parameter", "default", "allowed", "live", "meaning")
    rows = [head, ("---",) * len(head), *map(cells, table)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def cells(row: Row) -> tuple[str, str, str, str, str]:
    default = f"`{row.default}`" if row.default != "" else "empty"
    if isinstance(row.default, Parameter.Type):
        default = "none"
    allowed = ", ".join(f"`{choice}`" if choice else "empty" for choice in row.choices)
    if row.low is not None and row.high is not None:
        allowed = f"{row.low:g} to {row.high:g}"
    descriptor = row.descriptor()
    return f"`{row.name}`", default, allowed, "" if descriptor.read_only else "yes", descriptor.description


@pytest.mark.parametrize("node", TABLES)
def test_the_page_shows_the_table(root: Path, node: str) -> None:
    table = TABLES[node]
    page = (root / "docs" / "parameters.md").read_text()
    shown = f"## {node}\n\n{markdown(table)}\n"
    assert shown in page, f"docs/parameters.md: the section has to be\n\n{shown}"


@pytest.mark.parametrize("node", CONFIGURED)
def test_the_parameter_file_holds_the_defaults(root: Path, node: str) -> None:
    table, config = CONFIGURED[node]
    (values,) = yaml.safe_load((root / config).read_text()).values()
    defaults = {row.name: row.default for row in table}
    assert values["ros__parameters"] == {name: defaults[name] for name in values["ros__parameters"]}
    started_with_the_node = {"scene", "map", "method", "lockstep"}
    assert set(defaults) - set(values["ros__parameters"]) <= started_with_the_node


@pytest.mark.parametrize("node", TABLES)
def test_every_default_is_allowed_and_every_row_explained(node: str) -> None:
    table = TABLES[node]
    given = [row for row in table if not isinstance(row.default, Parameter.Type)]
    assert [row.name for row in given if row.problem(row.default)] == []
    assert [row.name for row in table if not row.description] == []
