# SPDX-License-Identifier: Apache-2.0
"""Golden byte exchanges: what goes over the wire, to the byte, with nothing left over."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from motor_rigs import ScriptedPort

from atpid_driver.motor.ceiling_actuator import Limits, Mode
from atpid_driver.motor.errors import IdentityError, LimitsError, LinkError
from atpid_driver.motor.protocol import IdentityReply, Refusal, StateReply
from atpid_driver.motor.session import Session, SessionLostError, check_identity

LIMITS = Limits(0.017, 1.0, 0.3)
IDENTITY = b"$1,ID,ATPID-MOTOR,1.0.0,1,1,POWER,17000,1000000,300000,0*C0EE\n"
Script = list[tuple[bytes, bytes]]


@pytest.fixture
def session_over() -> Iterator[Callable[[Script], Session]]:
    """Return a function that makes sessions; at the end every scripted exchange must have taken place."""
    ports: list[ScriptedPort] = []

    def make(script: Script) -> Session:
        ports.append(ScriptedPort(script))
        return Session(ports[-1])

    yield make
    for port in ports:
        port.done()


def test_identify_arm_home_move(session_over: Callable[[Script], Session]) -> None:
    session = session_over(
        [
            (b"$1,ID*16EE\n", IDENTITY),
            (b"$2,ARM*EB38\n", b"$2,ST,3,0,0000,-,-,5283,132,0,2*A899\n"),
            (b"$3,HOME*DBC1\n", b"$3,ST,2,0,0000,-,-,5287,142,0,3*A0BD\n"),
            (b"$4,MOVE,290000*03DB\n", b"$4,NO,BUSY*6720\n"),
        ]
    )
    assert session.identify(1.0).version == "1.0.0"
    armed, homing = session.request("ARM"), session.request("HOME")
    assert isinstance(armed, StateReply)
    assert isinstance(homing, StateReply)
    assert (armed.mode, homing.mode) == (Mode.HOLDING, Mode.HOMING)
    assert session.request("MOVE", 290000) == Refusal("BUSY")


def test_a_lost_answer_is_asked_for_again_with_the_same_bytes(session_over: Callable[[Script], Session]) -> None:
    ask = b"$1,BEAT*B896\n"
    session = session_over([(ask, b""), (ask, b"$1,ST,1,0,0000,-,-,1,1,0,1*A52D\n")])
    assert isinstance(session.request("BEAT"), StateReply)
    assert session.repeated == 1


def test_garbled_and_foreign_answers_are_passed_over(session_over: Callable[[Script], Session]) -> None:
    answer = b"$1,ST,1,0,0000,-,-,1,1,0,1*0000\nnoise\n$9,NO,OLD*B46B\n$1,ST,1,0,0000,-,-,1,1,0,1*A52D\n"
    session = session_over([(b"$1,BEAT*B896\n", answer)])
    assert isinstance(session.request("BEAT"), StateReply)
    assert session.garbled == 2


@pytest.mark.slow
def test_silence_is_a_lost_link(session_over: Callable[[Script], Session]) -> None:
    ask = b"$1,BEAT*B896\n"
    session = session_over([(ask, b"")] * 8)
    with pytest.raises(LinkError, match=r"no answer to BEAT within 1 s"):
        session.request("BEAT")


def test_a_restarted_board_ends_the_session(session_over: Callable[[Script], Session]) -> None:
    session = session_over([(b"$1,BEAT*B896\n", b"$1,NO,SESSION*DC4D\n")])
    with pytest.raises(SessionLostError, match="restarted"):
        session.request("BEAT")


def test_identity_is_asked_for_until_the_bootloader_is_through(session_over: Callable[[Script], Session]) -> None:
    session = session_over(
        [(b"$1,ID*16EE\n", b""), (b"$2,ID*8D32\n", IDENTITY.replace(b"$1", b"$2").replace(b"C0EE", b"AFB1"))]
    )
    assert session.identify(2.0).boots == 1


def test_no_board(session_over: Callable[[Script], Session]) -> None:
    session = session_over([(b"$1,ID*16EE\n", b"")])
    with pytest.raises(LinkError, match="nothing answers as ATPID-MOTOR"):
        session.identify(0.1)


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
