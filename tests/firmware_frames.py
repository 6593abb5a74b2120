# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frames for the real firmware on the emulated board: damaged ones, for which nothing may move, and random requests."""

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from math import isnan

from atpid_common.vocabulary import Mode
from atpid_driver.emulator import Emulator
from atpid_driver.emulator.emulator import SteppedHost
from atpid_driver.motor.faults import ProtocolError
from atpid_driver.motor.protocol import COMMANDS, SEQUENCES, IdentityReply, StateReply, decode, encode, reply_of

FRAMES_A_BEAT = 150  # about 0.1 s at 250 kbaud
#: Requests sent together; a thousand fill a second of the line. For how long the board runs after them [s].
BATCH, PAUSE = 25, 0.01
#: How far a ceiling may be beyond its limits: SOFT_MARGIN_UM, and where homing looks for its switch [m].
MARGIN, HOMING = 0.004, 0.021
#: Of the speed, for the times at which two states were read.
TOLERANCE = 1.02
#: How often each is requested.
_WORDS = {"MOVE": 300, "BEAT": 100, "STATE": 30, "LOOKUP": 10, "ARM": 10, "STOP": 5, "HOME": 1, "DISARM": 1}
_ODD = (0, 1, 16_999, 17_000, 1_000_000, 1_000_001, 99_999_999, 2**31, 2**32 - 1)


def _flip(frame: bytearray, rng: random.Random) -> bytes:
    for _ in range(rng.randint(1, 4)):
        frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
    return bytes(frame)


def _truncate(frame: bytearray, rng: random.Random) -> bytes:
    return bytes(frame[: rng.randrange(1, len(frame) - 1)])


def _overwrite(frame: bytearray, rng: random.Random) -> bytes:
    start = rng.randrange(len(frame))
    return bytes(frame[:start]) + rng.randbytes(rng.randint(1, 12)) + bytes(frame[start + 1 :])


def _drop(frame: bytearray, rng: random.Random) -> bytes:
    del frame[rng.randrange(len(frame))]
    return bytes(frame)


def _digit(frame: bytearray, rng: random.Random) -> bytes:
    """Change a digit, the most dangerous corruption: another height of the same form."""
    digits = [i for i, byte in enumerate(frame) if 48 <= byte <= 57]
    frame[rng.choice(digits)] = rng.randrange(48, 58)
    return bytes(frame)


def _noise(_frame: bytearray, rng: random.Random) -> bytes:
    return b"$" + rng.randbytes(rng.randint(1, 40))


DAMAGES: tuple[Callable[[bytearray, random.Random], bytes], ...] = (_flip, _truncate, _overwrite, _drop, _digit, _noise)


def harmful(newest: Callable[[], int], rng: random.Random) -> Iterator[bytes]:
    """Yield frames that must not be carried out: damaged ones, and whole ones that were carried out before.

    `newest` returns the last sequence carried out; a damaged frame has a newer one.
    """
    while True:
        if rng.random() < 0.2:
            old = (newest() - rng.randrange(1, 1000)) % SEQUENCES
            yield encode(old, "MOVE", rng.randrange(17_000, 1_000_000))
            continue
        word = rng.choice((*COMMANDS, "MOVE", "MOVE", "MOVE"))
        arguments = (rng.randrange(17_000, 1_000_000),) if word == "MOVE" else ()
        whole = encode((newest() + rng.randrange(1, 1000)) % SEQUENCES, word, *arguments)
        damaged = rng.choice(DAMAGES)(bytearray(whole), rng)
        if not any(_whole(part) for part in damaged.split(b"$")):
            yield damaged


def _whole(part: bytes) -> bool:
    """Whether a piece between two dollars is a good frame after all, as one changed digit into itself is."""
    try:
        decode(b"$" + part.split(b"\n")[0])
    except ProtocolError:
        return False
    return True


def fuzz(emulator: Emulator, frames: int, seed: int) -> int:
    """Send harmful frames with good heartbeats between to a homed motor, which stays; return how many were refused."""
    rng, host = random.Random(seed), SteppedHost(emulator)
    host.make_ready()
    host.beat(0.5)
    before, first = emulator.state(), host.state()
    sent = rejected = 0
    while sent < frames:
        batch = list(islice(harmful(lambda: host.sequence, rng), min(FRAMES_A_BEAT, frames - sent)))
        sent += len(batch)
        emulator.send(b"".join(batch) + b"\n")
        emulator.drain(0.01)
        emulator.received()
        state = host.request("BEAT")
        assert isinstance(state, StateReply)
        assert (state.mode, state.faults) == (Mode.HOLDING, 0), f"after {sent} frames"
        rejected += (state.rejected - first.rejected - rejected) % SEQUENCES
    after = emulator.state()
    assert (after.travel_um, after.switched, after.resets) == (before.travel_um, before.switched, before.resets)
    return rejected


@dataclass
class Storm:
    """Random requests to a homed motor, whose targets, heights and speed are judged."""

    host: SteppedHost
    rng: random.Random
    identity: IdentityReply
    states: int = 0  # among the answers
    rest: bytes = b""

    def batch(self) -> None:
        """Make some requests: numbers of any size; sequences go back, are repeated and leap."""
        emulator = self.host.emulator
        before = emulator.state()
        emulator.send(b"".join(self._request() for _ in range(BATCH)))
        emulator.drain(PAUSE)
        *whole, self.rest = (self.rest + emulator.received()).split(b"\n")  # the last answer may be on its way
        low, high = self.identity.lowest, self.identity.highest
        for line in whole:
            reply = reply_of(decode(line))
            if isinstance(reply, StateReply):
                self.states += 1
                assert isnan(reply.target) or low <= reply.target <= high
        now = emulator.state()
        assert low - MARGIN <= now.height_um * 1e-6 <= high + HOMING
        assert (now.travel_um - before.travel_um) * 1e-3 <= TOLERANCE * self.identity.speed * (now.ms - before.ms)

    def _request(self) -> bytes:
        host, rng = self.host, self.rng
        (word,), kind = rng.choices(list(_WORDS), list(_WORDS.values())), rng.random()
        if kind < 0.8:
            host.sequence = (host.sequence + 1) % SEQUENCES
            sequence = host.sequence
        else:
            sequence = (host.sequence - rng.randrange(40_000)) % SEQUENCES if kind < 0.9 else host.sequence
        numbers = (rng.choice(_ODD) if rng.random() < 0.2 else rng.randrange(1_100_000),)
        return encode(sequence, word, *(numbers if word in ("MOVE", "LOOKUP") else ()))


def storm(emulator: Emulator, requests: int, seed: int) -> int:
    """Home the motor and make random requests; return how many states were among the answers."""
    host = SteppedHost(emulator)
    host.make_ready()
    identity = host.request("ID")
    assert isinstance(identity, IdentityReply)
    made = Storm(host, random.Random(seed), identity)
    for _ in range(requests // BATCH):
        made.batch()
    return made.states
