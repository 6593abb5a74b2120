# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Checks of the computer: rights, USB, clock, disk."""

import os
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from atpid_common.real_time import LOOP_PRIORITY, refusal
from atpid_control.stand.findings import Finding, Subject, judged

#: Memory that the stand's nodes take [bytes].
_NODES = 0.8e9
#: What a stand records: a reading [bytes], all other messages, not compressed [bytes/s].
_READING, _MESSAGES = 8.0, 40e3
#: What is written to measure the disk [bytes]; how much faster than the recording it has to be [-].
_PROBE, _FASTER = 8_000_000, 5.0
#: Room that is to be left for others [bytes].
_RESERVE = 5e8
#: A wall clock that was set meanwhile differs from the steady one by more [s].
_STEP = 0.005
_OLDEST = 1_700_000_000  # before this software was written [s since 1970]
#: Files that are there while a program keeps the wall clock.
_KEEPERS = {"systemd-timesyncd": "run/systemd/timesync/synchronized", "chrony": "run/chrony/chronyd.pid",
            "ntpd": "run/ntpd.pid"}  # fmt: skip


def real_time(at: Subject) -> Iterator[Finding]:
    """Check the rights to the loop's real-time priority and, where it is asked for, to locked memory."""
    reason, _, remedy = refusal(LOOP_PRIORITY).partition(": ")
    yield judged(reason or f"real-time priority {LOOP_PRIORITY} is allowed", remedy, degrades=bool(reason))
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if any(values.get("lock_memory") for values in at.parameters.values()):
        yield judged(f"memory that may be locked: {limit / 1e6:.0f} MB" if limit >= 0 else "any memory may be locked",
                     "memlock in /etc/security/limits.conf", degrades=0 <= limit < _NODES)  # fmt: skip


def usb(at: Subject) -> Iterator[Finding]:
    """Check how long USB serial chips hold short answers back, and who else opens ports."""
    for path, held in at.texts("sys/bus/usb-serial/devices/*/latency_timer"):
        yield judged(f"{path.parent.name} holds answers back for {held} ms",
                     f"echo 1 | sudo tee /{path.relative_to(at.root)}", degrades=int(held) > 1)  # fmt: skip
    runs = any(text == "ModemManager" for _, text in at.texts("proc/[0-9]*/comm"))
    yield judged(f"ModemManager {'runs: it writes to a board that is plugged in' if runs else 'does not run'}",
                 'ENV{ID_MM_DEVICE_IGNORE}="1" in the udev rule (docs/stand.md)', degrades=runs)  # fmt: skip


def clock(at: Subject) -> Iterator[Finding]:
    """Check that the wall clock is right, is kept so, and was not set since the checks began."""
    ahead = ((time.time_ns() - at.begun[0]) - (time.monotonic_ns() - at.begun[1])) * 1e-9
    if abs(ahead) > _STEP:
        yield judged(f"the wall clock was set by {ahead:+.3f} s during the checks", "wait until it is synchronised",
                     degrades=True)  # fmt: skip
    year, kept = time.gmtime(at.begun[0] / 1e9).tm_year, [name for name, path in _KEEPERS.items() if at.files(path)]
    yield judged(f"the wall clock shows {year}, kept by {', '.join(kept) or 'nothing'}",
                 "sudo timedatectl set-ntp true, or chrony", fails=at.begun[0] < 1e9 * _OLDEST,
                 degrades=not kept)  # fmt: skip


def disk(at: Subject) -> Iterator[Finding]:
    """Check that the folder of recordings can be written, has room for one, and is fast enough."""
    bag = (at.options.bag or Path("bag")).absolute()
    folder = next(path for path in bag.parents if path.exists())
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            free = shutil.disk_usage(folder).free
            begun, size = time.monotonic(), min(_PROBE, free // 2)
            file.write(bytes(size))
            os.fsync(file.fileno())
            speed = size / (time.monotonic() - begun)
    except OSError as error:
        yield judged(f"{bag} cannot be written: {error.strerror}", "give another --bag", fails=True)
        return
    rate = _MESSAGES + sum(
        values["rate"] * len(values["channels"]) * _READING for values in at.parameters.values() if "channels" in values
    )
    needed = rate * 3600.0 * at.options.hours
    text = f"{free / 1e9:.1f} GB free; {at.options.hours:g} h at {rate / 1e3:.0f} kB/s take up to {needed / 1e9:.2f} GB"
    yield judged(text, "make room, or give another --bag", fails=free < needed, degrades=free < needed + _RESERVE)
    text = f"the disk takes {speed / 1e6:.0f} MB/s; the recording {rate / 1e6:.2f}"
    yield judged(text, "record to a local disk", degrades=speed < _FASTER * rate)
