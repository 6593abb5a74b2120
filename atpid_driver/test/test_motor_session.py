# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Golden byte exchanges: what goes over the wire, to the byte, and which answer belongs to which request."""

from dataclasses import replace
from typing import Any

import pytest

from atpid_driver.motor.ceiling_actuator import Limits
from atpid_driver.motor.errors import IdentityError, LimitsError
from atpid_driver.motor.protocol import IdentityReply, Refusal, StateReply, crc16
from atpid_driver.motor.session import MotorSession, check_identity

LIMITS = Limits(0.017, 1.0, 0.3)
IDENTITY = b"$1,ID,ATPID-MOTOR,1.0.0,1,1,POWER,17000,1000000,300000,0*C0EE\n"
STATE = b"$1,ST,1,0,0000,-,-,1,1,0,1*A52D\n"


def test_the_frames_of_identifying_arming_homing_and_moving() -> None:
    session = MotorSession()
    words: tuple[tuple[Any, ...], ...] = (("ID",), ("ARM",), ("HOME",), ("MOVE", 290000))
    assert [session.begin(0.0, *words) for words in words] == [
        b"$1,ID*16EE\n",
        b"$2,ARM*EB38\n",
        b"$3,HOME*DBC1\n",
        b"$4,MOVE,290000*03DB\n",
    ]
    answers = [
        session.answer(line)
        for line in (
            IDENTITY,
            b"$2,ST,3,0,0000,-,-,5283,132,0,2*A899\n",
            b"$3,ST,2,0,0000,-,-,5287,142,0,3*A0BD\n",
            b"$4,NO,BUSY*6720\n",
        )
    ]
    assert [answer.request.word for answer in answers if answer] == ["ID", "ARM", "HOME", "MOVE"]
    assert session.unanswered is None
    assert [answer.outstanding for answer in answers if answer] == [False, False, False, True]
    assert answers[3] is not None
    assert answers[3].reply == Refusal("BUSY")


def test_a_repeated_request_has_the_same_bytes_and_gives_no_round_trip() -> None:
    session = MotorSession()
    first = session.begin(1.0, "BEAT")
    assert session.repeat(1.2) == first
    answer = session.answer(STATE)
    assert answer is not None
    assert isinstance(answer.reply, StateReply)
    assert (answer.request.repeated, answer.request.asked, session.repeated) == (True, 1.0, 1)


def test_an_answer_to_a_later_request_shows_that_earlier_ones_are_lost() -> None:
    session = MotorSession()
    for moment in (1.0, 2.0, 3.0):
        session.begin(moment, "BEAT")
    assert session.unanswered is not None
    assert session.unanswered.asked == 1.0
    assert session.answer(b"$2,NO,BUSY*" + b"%04X\n" % crc16(b"2,NO,BUSY")) is not None
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


GOOD = IdentityReply("ATPID-MOTOR", "1.4.2", 1, 3, "POWER", 0.017, 1.0, 0.3, 0)


def identity(**change: Any) -> IdentityReply:
    return replace(GOOD, **change)


def test_the_right_firmware() -> None:
    check_identity(GOOD, LIMITS)


@pytest.mark.parametrize(
    ("reply", "kind", "text"),
    [
        (identity(name="GRBL"), IdentityError, "'GRBL' answers, not ATPID-MOTOR"),
        (identity(version="2.0.0"), IdentityError, r"firmware 2\.0\.0 with protocol 1: this driver needs 1\.x"),
        (identity(protocol=2), IdentityError, "protocol 2"),
        (identity(lowest=0.02), LimitsError, r"the firmware allows 0\.02 to 1 m"),
        (identity(highest=0.9), LimitsError, r"the firmware allows 0\.017 to 0\.9 m"),
        (identity(speed=0.2), LimitsError, r"the firmware's is 0\.2 m/s"),
    ],
)
def test_the_wrong_firmware(reply: IdentityReply, kind: type[Exception], text: str) -> None:
    with pytest.raises(kind, match=text):
        check_identity(reply, LIMITS)
