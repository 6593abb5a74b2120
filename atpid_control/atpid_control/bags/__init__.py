# SPDX-License-Identifier: Apache-2.0
"""Bags that `ros2 bag` reads, without rosbag2: recorded, verified, repaired, read and prepared for a replay."""

from atpid_control.bags.errors import BagError, TypeUnknownError
from atpid_control.bags.metadata import Qos, RunInfo, new_run
from atpid_control.bags.read import Bag, open_bag
from atpid_control.bags.recover import Recovered, recover, repair
from atpid_control.bags.verify import Verified, verify
from atpid_control.bags.writer import BagWriter, Split, check_new

__all__ = [
    "Bag", "BagError", "BagWriter", "Qos", "Recovered", "RunInfo", "Split", "TypeUnknownError", "Verified", "check_new",
    "new_run", "open_bag", "recover", "repair", "verify",
]  # fmt: skip
