# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What simulates nothing starts without the libraries of what does: a graph has many processes."""

import subprocess
import sys

import pytest

NODES = [f"atpid_control.nodes.{name}_node" for name in ("supervisor", "recorder", "live", "foxglove", "replay")]
COMMANDS = [f"atpid_control.commands.{name}" for name in ("bag_files", "bag_views", "replay", "doctor")]


@pytest.mark.parametrize("module", ["atpid_sim.scene", *NODES, *COMMANDS])
def test_it_is_imported_without_numba(module: str) -> None:
    text = f"import sys, {module}; print({{'numba', 'scipy', 'matplotlib', 'plotly', 'pandas'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_bench_ends_without_the_slowest_imports() -> None:
    slow = {f"scipy.{name}" for name in ("interpolate", "optimize", "signal", "stats")}
    text = f"import sys, atpid_control.commands.bench, atpid_control.stand.summary; print({slow} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_the_identifier_of_the_support_loads_no_simulation() -> None:
    text = "import sys, atpid_control.nodes.identifier_node; print('atpid_sim.engine' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
