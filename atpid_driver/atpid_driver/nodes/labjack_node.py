# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The LabJack node: two lasers on a T7, published on sensors/laser; the source of the loop on the stand."""

import sys
from collections.abc import Mapping
from functools import partial
from typing import ClassVar

from atpid_common.nodes.node_main import run_node
from atpid_common.real_time import LOOP_PRIORITY
from atpid_driver.nodes.acquisition_node import AcquisitionNode


class LabJackNode(AcquisitionNode):
    """The acquisition node, used for the lasers."""

    NAME = "labjack_node"
    USUAL: ClassVar[Mapping[str, object]] = {
        "backend": "labjack",
        "topic": "sensors/laser",
        "in_loop": True,
        "spike": 0.2,
    }


main = partial(run_node, LabJackNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
