# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor protocol to the byte: frames, replies, and which answer belongs to which request."""

from dataclasses import replace
from math import isnan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.vocabulary import Mode
from atpid_driver.motor import protocol as p
from atpid_driver.motor.ceiling_actuator import Limits
from atpid_driver.motor.faults import IdentityError, LimitsError, MotorFault, ProtocolError
from atpid_driver.motor.session import MotorSession, check_identity

IDENTITY = b"$1,ID,ATPID-MOTOR,1.0.0,1,1,POWER,17000,1000000,300000,0*C0EE\n"
STATE = b"$1,ST,1,0,0000,-,-,1,1,0,1*A52D\n"

words = st.sampled_from(p.COMMANDS)
sequences = st.integers(0, p.SEQUENCES - 1)
numbers = st.integers(0, 10**9)


def test_check_sum_is_xmodem() -> None:
    assert p.crc16(b"123456789") == 0x31C3
    assert p.encode(1, "MOVE", 290000) == b"$1,MOVE,290000*4315\n"


@given(sequences, words, st.lists(numbers, max_size=3))
def test_round_trip(sequence: int, word: str, arguments: list[int]) -> None:
    frame = p.decode(p.encode(sequence, word, *arguments))
    assert frame == p.Frame(sequence, word, tuple(map(str, arguments)))


@pytest.mark.parametrize("sequence", [-1, p.SEQUENCES])
def test_sequence_outside_its_range(sequence: int) -> None:
    with pytest.raises(ProtocolError, match=f"{sequence}.* 0 .*{p.SEQUENCES - 1}"):
        p.encode(sequence, "ID")


@given(sequences, words, numbers, st.data())
def test_one_or_two_flipped_bits_are_always_refused(sequence: int, word: str, number: int, data: st.DataObject) -> None:
    good = p.encode(sequence, word, number).rstrip(b"\n")
    bad = bytearray(good)
    for bit in data.draw(st.sets(st.integers(0, 8 * len(good) - 1), min_size=1, max_size=2)):
        bad[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ProtocolError):
        p.decode(bytes(bad))


@given(st.binary(max_size=120))
def test_noise_is_refused_by_name(noise: bytes) -> None:
    for line in (noise, b"$" + noise, b"$1,NO,OLD*" + noise):
        with pytest.raises(ProtocolError):
            p.decode(line)


def framed(body: str) -> p.Reply:
    return p.reply_of(p.decode(b"$%b*%04X\n" % (body.encode(), p.crc16(body.encode()))))


def test_replies_in_si() -> None:
    reply = framed("7,ST,4,1,8000,290000,-,8123,1500,3,6")
    assert isinstance(reply, p.StateReply)
    assert isnan(reply.target)
    expected = p.StateReply(Mode.MOVING, True, MotorFault.WATCHDOG, 0.29, 0.0, 8123, 1.5, 3, 6)
    assert replace(reply, target=0.0) == expected
    reply = framed("1,ID,ATPID-MOTOR,1.0.0,1,12,POWER,17000,1000000,300000,0")
    assert reply == p.IdentityReply("ATPID-MOTOR", "1.0.0", 1, 12, "POWER", 0.017, 1.0, 0.3, 0)
    assert framed("1,NO,RANGE") == p.Refusal("RANGE")
    assert str(p.Refusal("RANGE")) == p.REFUSALS["RANGE"]


NO_FRAMES = ["", "1", "1,", "01,NO,OLD", "-1,NO,OLD", "65536,NO,OLD"]
NO_REPLIES = ["1,ST,9,1,0,1,1,1,1,1,1", "1,ST,4", "1,ID,x", "1,WHAT,1", "1,NO"]


@pytest.mark.parametrize("body", NO_FRAMES + NO_REPLIES)
def test_replies_that_are_none(body: str) -> None:
    """Although their check sum is right."""
    with pytest.raises(ProtocolError):
        framed(body)


def test_the_frames_of_identifying_arming_homing_and_moving() -> None:
    session = MotorSession()
    requests: tuple[tuple[Any, ...], ...] = (("ID",), ("ARM",), ("HOME",), ("MOVE", 290000))
    assert [session.begin(0.0, *request) for request in requests] == [
        b"$1,ID*16EE\n",
        b"$2,ARM*EB38\n",
        b"$3,HOME*DBC1\n",
        b"$4,MOVE,290000*03DB\n",
    ]
    lines = [IDENTITY, b"$2,ST,3,0,0000,-,-,5283,132,0,2*A899\n", b"$3,ST,2,0,0000,-,-,5287,142,0,3*A0BD\n"]
    answers = [session.answer(line) for line in (*lines, b"$4,NO,BUSY*6720\n")]
    seen = [(answer.request.word, answer.outstanding) for answer in answers if answer]
    assert seen == [("ID", False), ("ARM", False), ("HOME", False), ("MOVE", True)]
    assert session.unanswered is None
    assert answers[3] is not None
    assert answers[3].reply == p.Refusal("BUSY")


def test_a_repeated_request_has_the_same_bytes_and_gives_no_round_trip() -> None:
    session = MotorSession()
    first = session.begin(1.0, "BEAT")
    assert session.repeat(1.2) == first
    answer = session.answer(STATE)
    assert answer is not None
    assert isinstance(answer.reply, p.StateReply)
    assert (answer.request.repeated, answer.request.asked, session.repeated) == (True, 1.0, 1)


def test_an_answer_to_a_later_request_shows_that_earlier_ones_are_lost() -> None:
    session = MotorSession()
    for moment in (1.0, 2.0, 3.0):
        session.begin(moment, "BEAT")
    assert session.unanswered is not None
    assert session.unanswered.asked == 1.0
    assert session.answer(p.encode(2, "NO", "BUSY")) is not None
    assert session.unanswered.asked == 3.0


def test_an_answer_is_taken_once() -> None:
    """A line that is stuck at its last answer answers nothing."""
    session = MotorSession()
    session.begin(0.0, "BEAT")
    assert session.answer(STATE) is not None
    session.begin(0.1, "BEAT")
    assert session.answer(STATE) is None


@pytest.mark.parametrize("line", [STATE.replace(b"A52D", b"0000"), b"noise\n", b"$9,NO,OLD*B46B\n", b""])
def test_garbled_and_foreign_answers_are_passed_over(line: bytes) -> None:
    session = MotorSession()
    session.begin(0.0, "BEAT")
    assert session.answer(line) is None
    assert session.garbled == (1 if line and b"OLD" not in line else 0)
    assert session.answer(STATE) is not None


@pytest.mark.parametrize(
    ("first", "second", "taken"), [(1, 1, True), (1, 2, True), (2, 1, False), (65535, 1, True), (0, 40000, False)]
)
def test_the_order_of_two_requests(first: int, second: int, taken: bool) -> None:
    session = MotorSession()
    session.begin(0.0, "BEAT")
    assert session.request is not None
    earlier, later = (replace(session.request, sequence=sequence) for sequence in (first, second))
    assert earlier.not_after(later) is taken


@pytest.mark.parametrize(
    ("change", "kind", "text"),
    [
        ({}, None, ""),
        ({"name": "GRBL"}, IdentityError, "'GRBL'.*ATPID-MOTOR"),
        ({"version": "2.0.0"}, IdentityError, r"2\.0\.0.*1\.x"),
        ({"protocol": 2}, IdentityError, "protocol 2.*protocol 1"),
        ({"lowest": 0.02}, LimitsError, r"0\.017 to 1 m.*0\.02 to 1 m"),
        ({"highest": 0.9}, LimitsError, r"0\.017 to 1 m.*0\.017 to 0\.9 m"),
        ({"speed": 0.2}, LimitsError, r"0\.3 m/s.*0\.2 m/s"),
    ],
)
def test_the_wrong_firmware(change: dict[str, Any], kind: type[Exception] | None, text: str) -> None:
    reply = replace(p.IdentityReply("ATPID-MOTOR", "1.4.2", 1, 3, "POWER", 0.017, 1.0, 0.3, 0), **change)
    limits = Limits(0.017, 1.0, 0.3)
    if kind is None:
        check_identity(reply, limits)
        return
    with pytest.raises(kind, match=text):
        check_identity(reply, limits)
