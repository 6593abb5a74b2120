# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frames of the motor protocol."""

from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.vocabulary import Mode
from atpid_driver.motor import protocol as p
from atpid_driver.motor.errors import ProtocolError
from atpid_driver.motor.faults import MotorFault


def test_check_sum_is_xmodem() -> None:
    assert p.crc16(b"123456789") == 0x31C3


def test_frame_reads_in_a_terminal() -> None:
    assert p.encode(1, "MOVE", 290000) == b"$1,MOVE,290000*4315\n"


words = st.sampled_from(p.COMMANDS)
numbers = st.integers(0, 10**9)


@given(st.integers(0, p.SEQUENCES - 1), words, st.lists(numbers, max_size=3))
def test_round_trip(sequence: int, word: str, arguments: list[int]) -> None:
    frame = p.decode(p.encode(sequence, word, *arguments))
    assert frame == p.Frame(sequence, word, tuple(map(str, arguments)))


@given(st.integers(0, p.SEQUENCES - 1), words, numbers, st.data())
def test_one_or_two_flipped_bits_are_always_refused(sequence: int, word: str, number: int, data: st.DataObject) -> None:
    good = p.encode(sequence, word, number).rstrip(b"\n")
    bits = data.draw(st.sets(st.integers(0, 8 * len(good) - 1), min_size=1, max_size=2))
    bad = bytearray(good)
    for bit in bits:
        bad[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ProtocolError):
        p.decode(bytes(bad))


@given(st.binary(max_size=120))
def test_noise_is_refused_by_name(noise: bytes) -> None:
    with pytest.raises(ProtocolError):
        p.decode(b"x" + noise)


@pytest.mark.parametrize(
    "line", [b"", b"$*0000", b"$1*2672", b"$1,ID", b"$01,ID*0000", b"$-1,ID*0000", b"$1,ID*abcd", b"$70000,ID*0000"]
)
def test_malformed_frames_are_refused(line: bytes) -> None:
    with pytest.raises(ProtocolError):
        p.decode(line)


def framed(body: str) -> p.Reply:
    return p.reply_of(p.decode(b"$%b*%04X\n" % (body.encode(), p.crc16(body.encode()))))


def test_state_reply_in_si() -> None:
    reply = framed("7,ST,4,1,0,290000,-,8123,1500,3,6")
    assert isinstance(reply, p.StateReply)
    assert (reply.mode, reply.homed, reply.faults, reply.height) == (Mode.MOVING, True, MotorFault(0), 0.29)
    assert isnan(reply.target)
    assert (reply.position_raw, reply.uptime, reply.rejected, reply.sequence) == (8123, 1.5, 3, 6)


def test_identity_reply_in_si() -> None:
    reply = framed("1,ID,ATPID-MOTOR,1.0.0,1,12,POWER,17000,1000000,300000,0")
    assert reply == p.IdentityReply("ATPID-MOTOR", "1.0.0", 1, 12, "POWER", 0.017, 1.0, 0.3, 0)


def test_refusal_in_words() -> None:
    assert str(framed("1,NO,RANGE")) == "height outside the firmware's soft limits"


@pytest.mark.parametrize("body", ["1,ST,9,1,0,1,1,1,1,1,1", "1,ST,4", "1,ID,x", "1,WHAT,1", "1,NO"])
def test_replies_that_are_none(body: str) -> None:
    with pytest.raises(ProtocolError):
        framed(body)


@pytest.mark.parametrize("sequence", [-1, p.SEQUENCES])
def test_sequence_outside_its_range(sequence: int) -> None:
    with pytest.raises(ProtocolError, match="must be 0 to 65535"):
        p.encode(sequence, "ID")
