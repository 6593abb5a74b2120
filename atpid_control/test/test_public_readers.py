# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag opens with public libraries alone: mcap with mcap-ros2-support, and rosbags."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exported import BAG

from atpid_control.runs.read import open_bag as messages_of

#: Reads a bag with nothing but a public library, and prints how many messages and the sum of one channel.
_READERS = {
    "mcap": """
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
reader = make_reader(open(sys.argv[1] + "/bag_0.mcap", "rb"), decoder_factories=[DecoderFactory()])
blocks = [message for _, _, _, message in reader.iter_decoded_messages(topics=["/sensors/laser"])]
""",
    "rosbags": """
from pathlib import Path
from rosbags.highlevel import AnyReader
with AnyReader([Path(sys.argv[1])]) as reader:
    chosen = [c for c in reader.connections if c.topic == "/sensors/laser"]
    blocks = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections=chosen)]
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("reader", list(_READERS))
def test_public_readers_open_the_bag_without_the_workspace(reader: str, tmp_path: Path) -> None:
    without_workspace = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    check = "import importlib.util, sys\nassert not importlib.util.find_spec('atpid_interfaces')\n"
    end = "print(len(blocks), sum(x for block in blocks for x in block.data[1::2]).hex())"
    command = [sys.executable, "-c", check + _READERS[reader] + end, str(BAG)]
    done = subprocess.run(command, cwd=tmp_path, env=without_workspace, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    total = 0.0
    for _, message in messages_of(BAG).messages("/sensors/laser"):
        for value in np.asarray(message.data)[1::2].tolist():
            total += value
    assert done.stdout.split() == ["160", total.hex()]
