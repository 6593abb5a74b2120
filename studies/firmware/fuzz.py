# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Corrupted, truncated and duplicated frames for an armed and homed motor, which must not move for any of them."""

import argparse
import random
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from atpid_common.arguments import MOST_SEED, whole
from atpid_common.errors import DONE
from atpid_common.vocabulary import Mode
from atpid_driver.emulator.client import SteppedHost
from atpid_driver.emulator.emulator import Emulator
from atpid_driver.motor.errors import ProtocolError
from atpid_driver.motor.protocol import COMMANDS, SEQUENCES, StateReply, decode, encode
from atpid_sim.display import counting

MOVED = 3  # exit status where the motor moved
FRAMES_A_BEAT = 150  # about 0.1 s at 250 kbaud
#: Arguments of the example in the help.
EXAMPLE = "--frames 1000"


@dataclass(frozen=True, slots=True)
class FuzzResult:
    """Frames sent and refused, moves and restarts (must be 0), simulated and wall time [s]."""

    frames: int
    rejected: int
    moved_um: float
    switched: int
    resets: int
    simulated: float
    wall: float


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


def fuzz(emulator: Emulator, frames: int, seed: int, progress: Callable[[int], None] = lambda _: None) -> FuzzResult:
    """Home the motor, send `frames` harmful frames with good heartbeats between, and check that it stays where it is.

    Raises `ProtocolError` if the board leaves its state or stops answering.
    """
    rng, host, began = random.Random(seed), SteppedHost(emulator), time.monotonic()
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
        if not isinstance(state, StateReply) or state.mode is not Mode.HOLDING or state.faults:
            raise ProtocolError(f"after {sent} frames the state is {state}")
        rejected += (state.rejected - first.rejected - rejected) % SEQUENCES
        progress(sent)
    after = emulator.state()
    return FuzzResult(
        frames=sent,
        rejected=rejected,
        moved_um=after.travel_um - before.travel_um,
        switched=after.switched - before.switched,
        resets=after.resets - before.resets,
        simulated=(after.ms - before.ms) * 1e-3,
        wall=time.monotonic() - began,
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    parser.add_argument("--frames", type=whole(1, 10**9), default=1_000_000, metavar="N", help="default 1000000")
    parser.add_argument("--seed", type=whole(0, MOST_SEED), default=1, metavar="N", help="default 1")


def run(arguments: argparse.Namespace) -> int:
    """Send harmful frames; return 0, or 3 where the motor moved."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Emulator(Path(folder) / "board", height=0.98) as emulator,
        counting("frames", arguments.frames) as count,
    ):
        result = fuzz(emulator, arguments.frames, arguments.seed, count)
    print(result)
    return MOVED if result.moved_um or result.switched or result.resets else DONE
