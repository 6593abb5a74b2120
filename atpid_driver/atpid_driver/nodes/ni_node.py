# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The NI node: accelerometers on an NI-9230, published on sensors/accelerometer; recorded beside the loop."""

import sys
from collections.abc import Mapping
from functools import partial
from typing import ClassVar

from atpid_common.nodes.node_main import run_node
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import Frame
from atpid_driver.nodes.acquisition_node import AcquisitionNode


class NiNode(AcquisitionNode):
    """The acquisition node, used for the accelerometers."""

    NAME = "ni_node"
    USUAL: ClassVar[Mapping[str, object]] = {
        "backend": "nidaqmx",
        "topic": "sensors/accelerometer",
        "frame_id": Frame.BEAM,
    }


main = partial(run_node, NiNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
