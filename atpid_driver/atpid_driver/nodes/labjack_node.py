# SPDX-License-Identifier: Apache-2.0
"""The LabJack node: two lasers on a T7, published on sensors/laser."""

from __future__ import annotations

import sys
from typing import Any

from atpid_common.nodes.node_main import run_node
from atpid_driver.nodes.acquisition_node import AcquisitionNode
from atpid_driver.nodes.acquisition_parameters import LABJACK


class LabJackNode(AcquisitionNode):
    """The source of the loop on the stand; see AcquisitionNode."""

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters and topics; nothing is opened."""
        super().__init__("labjack_node", "sensors/laser", LABJACK, in_loop=True, **kwargs)


def main(args: list[str] | None = None) -> int:
    """Run the node as a process of its own; return the exit status."""
    return run_node(LabJackNode, args)


if __name__ == "__main__":
    sys.exit(main())
