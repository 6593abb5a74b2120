# SPDX-License-Identifier: Apache-2.0
"""A reading of the ceiling as a message."""

from __future__ import annotations

from atpid_interfaces.msg import CeilingState
from std_msgs.msg import Header

from atpid_driver.motor import Reading, in_words


def state_of(reading: Reading, header: Header, *, handshake: bool) -> CeilingState:
    """Return the message of a reading; `handshake` marks an answer to the handshake."""
    return CeilingState(
        header=header,
        handshake=handshake,
        mode=int(reading.mode),
        homed=reading.homed,
        faults=int(reading.faults),
        fault=in_words(reading.faults),
        height=reading.height,
        target=reading.target,
        velocity=reading.velocity,
        speed=reading.speed,
        sequence=reading.sequence,
    )
