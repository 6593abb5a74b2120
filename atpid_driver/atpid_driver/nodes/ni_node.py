# SPDX-License-Identifier: Apache-2.0
"""The NI node: accelerometers on an NI-9230, published on sensors/accelerometer."""

from __future__ import annotations

import sys
from typing import Any

from atpid_common.nodes.node_main import run_node
from atpid_driver.nodes.acquisition_node import AcquisitionNode
from atpid_driver.nodes.acquisition_parameters import NI


class NiNode(AcquisitionNode):
    """Beside the loop: its handshake is for the recorder only; see AcquisitionNode."""

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters and topics; nothing is opened."""
        super().__init__("ni_node", "sensors/accelerometer", NI, in_loop=False, **kwargs)


def main(args: list[str] | None = None) -> int:
    """Run the node as a process of its own; return the exit status."""
    return run_node(NiNode, args)


if __name__ == "__main__":
    sys.exit(main())
