# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random whole requests to the real firmware, as many as a second of the board takes; its ceiling keeps its limits."""

import argparse
import random
import tempfile
import time
from dataclasses import dataclass, field
from math import isnan
from pathlib import Path

from atpid_common.arguments import MOST_SEED, real, whole
from atpid_common.errors import DONE
from atpid_driver.emulator.client import SteppedHost
from atpid_driver.emulator.emulator import Emulator, EmulatorError
from atpid_driver.motor.errors import ProtocolError
from atpid_driver.motor.protocol import SEQUENCES, IdentityReply, StateReply, decode, encode, reply_of

#: Requests sent together; a thousand fill a second of the line. For how long the board runs after them [s].
BATCH, PAUSE = 25, 0.01
#: How far a ceiling may be beyond its limits: SOFT_MARGIN_UM, and where homing looks for its switch [m].
MARGIN, HOMING = 0.004, 0.021
#: Of the speed, for the times at which two states were read.
TOLERANCE = 1.02
#: How often each is requested.
_WORDS = {"MOVE": 300, "BEAT": 100, "STATE": 30, "LOOKUP": 10, "ARM": 10, "STOP": 5, "HOME": 1, "DISARM": 1}
_ODD = (0, 1, 16_999, 17_000, 1_000_000, 1_000_001, 99_999_999, 2**31, 2**32 - 1)
#: Arguments of the example in the help.
EXAMPLE = "--requests 1000"


@dataclass
class StormResult:
    """What a storm showed: requests, states among the answers, heights reached [m], fastest [m/s], wall time [s]."""

    requests: int = 0
    states: int = 0
    lowest: float = 1e9
    highest: float = 0.0
    fastest: float = 0.0
    travelled: float = 0.0
    wall: float = 0.0
    rest: bytes = field(default=b"", repr=False)


def storm(emulator: Emulator, seconds: float, most: int, seed: int) -> StormResult:
    """Home the motor, then make random requests for `seconds` of wall time or `most` requests.

    Numbers are of any size, sequences go back, are repeated and leap. Raises EmulatorError where a target or the
    ceiling is outside its limits, or too fast.
    """
    rng, host, result, begun = random.Random(seed), SteppedHost(emulator), StormResult(), time.monotonic()
    host.make_ready()
    identity = host.request("ID")
    assert isinstance(identity, IdentityReply)
    before = emulator.state()
    while result.requests < most and time.monotonic() - begun < seconds:
        _answers(host, rng, identity, result)
        now = emulator.state()
        height, passed = now.height_um * 1e-6, (now.ms - before.ms) * 1e-3
        result.lowest, result.highest = min(result.lowest, height), max(result.highest, height)
        result.fastest = max(result.fastest, (now.travel_um - before.travel_um) * 1e-6 / passed)
        result.travelled += (now.travel_um - before.travel_um) * 1e-6
        before = now
        if not identity.lowest - MARGIN <= height <= identity.highest + HOMING:
            raise EmulatorError(f"after {result.requests} requests the ceiling is at {height:.4f} m")
        if result.fastest > TOLERANCE * identity.speed:
            raise EmulatorError(f"after {result.requests} requests the ceiling moved at {result.fastest:.4f} m/s")
    result.wall = time.monotonic() - begun
    return result


def _answers(host: SteppedHost, rng: random.Random, identity: IdentityReply, result: StormResult) -> None:
    """Make a batch of requests and judge the targets in the answers."""
    host.emulator.send(b"".join(_request(host, rng) for _ in range(BATCH)))
    host.emulator.drain(PAUSE)
    *whole, result.rest = (result.rest + host.emulator.received()).split(b"\n")  # the last answer may be on its way
    for line in whole:
        try:
            reply = reply_of(decode(line))
        except ProtocolError as error:
            raise EmulatorError(f"after {result.requests} requests an answer is none: {error}") from None
        if isinstance(reply, StateReply):
            result.states += 1
            if not isnan(reply.target) and not identity.lowest <= reply.target <= identity.highest:
                raise EmulatorError(f"after {result.requests} requests the target is {reply.target:g} m")
    result.requests += BATCH


def _request(host: SteppedHost, rng: random.Random) -> bytes:
    (word,), kind = rng.choices(list(_WORDS), list(_WORDS.values())), rng.random()
    if kind < 0.8:
        host.sequence = (host.sequence + 1) % SEQUENCES
        sequence = host.sequence
    else:
        sequence = (host.sequence - rng.randrange(40_000)) % SEQUENCES if kind < 0.9 else host.sequence
    numbers = (rng.choice(_ODD) if rng.random() < 0.2 else rng.randrange(1_100_000),)
    return encode(sequence, word, *(numbers if word in ("MOVE", "LOOKUP") else ()))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    parser.add_argument("--requests", type=whole(1, 10**9), default=1_000_000, metavar="N", help="default 1000000")
    parser.add_argument("--seconds", type=real(0.1, 1e6, "s"), default=60.0, metavar="S", help="at most; default 60")
    parser.add_argument("--seed", type=whole(0, MOST_SEED), default=1, metavar="N", help="default 1")


def run(arguments: argparse.Namespace) -> int:
    """Make random requests; return 0. Raises EmulatorError for what breaks a limit."""
    with tempfile.TemporaryDirectory() as folder, Emulator(Path(folder) / "board", height=0.98) as emulator:
        print(storm(emulator, arguments.seconds, arguments.requests, arguments.seed))
    return DONE
