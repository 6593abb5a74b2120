# SPDX-License-Identifier: Apache-2.0
"""The LabJack node: two lasers on a T7, published on sensors/laser; the source of the loop on the stand."""

from __future__ import annotations

import sys

from atpid_common.nodes.node_main import run_node
from atpid_driver.nodes.acquisition_node import AcquisitionNode
from atpid_driver.nodes.acquisition_parameters import Use


class LabJackNode(AcquisitionNode):
    """The acquisition node, used for the lasers."""

    NAME = "labjack_node"
    USE = Use("labjack", "sensors/laser", in_loop=True)


def main(args: list[str] | None = None) -> int:
    """Run the node as a process of its own; return the exit status."""
    return run_node(LabJackNode, args)


if __name__ == "__main__":
    sys.exit(main())
