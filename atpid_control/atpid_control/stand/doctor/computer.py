# SPDX-License-Identifier: Apache-2.0
"""Checks of the computer: processor, memory, rights, clock, disk, USB."""

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from atpid_common.folders import cache_root
from atpid_common.real_time import LOOP_PRIORITY, refusal
from atpid_control.stand.doctor.findings import Finding, Subject, degraded, not_checked, right, wrong

#: Memory that the stand's nodes take, and that they need beside others [bytes].
_NODES, _ENOUGH = 0.8e9, 2e9
#: What a stand records [bytes/s]: each reading, and messages besides (4 kB/s at 50 states a second), not compressed.
_READING, _MESSAGES = 8.0, 40e3
#: What is written to measure the disk [bytes]; how much faster than the recording it has to be [-].
_PROBE, _FASTER = 8_000_000, 5.0
#: Room that is to be left for others [bytes].
_RESERVE = 5e8
#: A wall clock that was set meanwhile differs from the steady one by more [s].
_STEP = 0.005
_OLDEST = 1_700_000_000  # before this software was written [s since 1970]


def processor(at: Subject) -> Iterator[Finding]:
    """Check load and frequency of the processors."""
    cores = len(os.sched_getaffinity(0))
    load = float(at.text("proc/loadavg").partition(" ")[0] or "nan")
    busy = f"load {load:g} on {cores} cores"
    yield degraded(busy, "end other programs before a run") if load > cores else right(busy)
    if cores < 2:
        yield degraded("1 core: nodes wait for each other", "use a computer with at least 2")
    found = {path.read_text().strip() for path in at.files("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor")}
    if not found:
        yield not_checked("frequency governor: the kernel shows none")
    elif found == {"performance"}:
        yield right("frequency governor performance")
    else:
        yield degraded(f"frequency governor {', '.join(sorted(found))}: wakes up late",
                       "sudo cpupower frequency-set -g performance")  # fmt: skip


def memory(at: Subject) -> Iterator[Finding]:
    """Check memory and shared memory."""
    lines = dict(line.split(":", 1) for line in at.text("proc/meminfo").splitlines())
    free = float(lines.get("MemAvailable", "nan").split()[0]) * 1024.0
    text = f"{free / 1e9:.1f} GB of memory free; the nodes take {_NODES / 1e9:g}"
    remedy = "end other programs"
    yield wrong(text, remedy) if free < _NODES else degraded(text, remedy) if free < _ENOUGH else right(text)
    shared = at.root / "dev/shm"
    if not shared.is_dir() or not os.access(shared, os.W_OK):
        yield degraded("no shared memory to write to: no emulated devices", "sudo mount -t tmpfs tmpfs /dev/shm")


def real_time(at: Subject) -> Iterator[Finding]:
    """Check the rights to real-time priority and locked memory."""
    given = at.options.params_file and at.parameters["supervisor_node"].get("real_time_priority")
    priority = LOOP_PRIORITY if given is None else int(given)
    if refused := refusal(priority):
        reason, _, remedy = refused.partition(": ")
        yield degraded(f"{reason}; other programs may delay the loop", remedy)
    else:
        yield right(f"real-time priority {priority} is allowed")


def usb(at: Subject) -> Iterator[Finding]:
    """Check how long USB serial chips hold short answers back, and who else opens ports."""
    timers = at.files("sys/bus/usb-serial/devices/*/latency_timer")
    for path in timers:
        if (late := int(path.read_text())) > 1:
            yield degraded(f"{path.parent.name} holds answers back for {late} ms",
                           f"echo 1 | sudo tee /{path.relative_to(at.root)}")  # fmt: skip
    if not any(int(path.read_text()) > 1 for path in timers):
        yield right(f"{len(timers)} serial chips with a latency timer, none above 1 ms")
    if any(path.read_text().strip() == "ModemManager" for path in at.files("proc/[0-9]*/comm")):
        yield degraded("ModemManager runs: it talks to a board that is plugged in",
                       'ENV{ID_MM_DEVICE_IGNORE}="1" in the udev rule (docs/stand.md)')  # fmt: skip


def clock(at: Subject) -> Iterator[Finding]:
    """Check that the wall clock is right, is kept so, and was not set since the checks began."""
    wall, steady = time.time_ns() - at.begun[0], time.monotonic_ns() - at.begun[1]
    if abs(wall - steady) > 1e9 * _STEP:
        yield degraded(f"the wall clock was set by {(wall - steady) / 1e9:+.3f} s during the checks",
                       "wait until it is synchronised before a run")  # fmt: skip
    if at.begun[0] < 1e9 * _OLDEST:
        yield wrong(f"the wall clock shows {time.strftime('%Y', time.gmtime(at.begun[0] / 1e9))}", "set it: sudo date")
    keepers = {"systemd-timesyncd": "run/systemd/timesync/synchronized", "chrony": "run/chrony/chronyd.pid",
               "ntpd": "run/ntpd.pid", "ptp4l": "run/ptp4l"}  # fmt: skip
    kept = [name for name, path in keepers.items() if (at.root / path).exists()]
    if kept:
        yield right(f"the wall clock is kept by {', '.join(kept)}")
    else:
        yield degraded("nothing synchronises the wall clock: stamps of two computers differ",
                       "sudo timedatectl set-ntp true, or chrony")  # fmt: skip


def disk(at: Subject) -> Iterator[Finding]:
    """Check that the folder of recordings can be written, has room for one, and is fast enough."""
    folder = (at.options.bag.absolute().parent if at.options.bag else Path.cwd()).resolve()
    while not folder.exists():
        folder = folder.parent
    shown = at.options.bag or "the folder of the recording"
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            free = shutil.disk_usage(folder).free
            begun = time.monotonic()
            for _ in range(8):
                file.write(bytes(min(_PROBE, free // 2) // 8))
            os.fsync(file.fileno())
            speed = min(_PROBE, free // 2) / (time.monotonic() - begun)
    except OSError as error:
        yield wrong(f"{shown} cannot be written: {error.strerror}", "give another --bag")
        return
    rate = _MESSAGES + sum(
        values["rate"] * len(values["channels"]) * _READING
        for node, values in at.parameters.items() if node in ("labjack_node", "ni_node")
    )  # fmt: skip
    needed = rate * 3600.0 * at.options.hours
    text = f"{free / 1e9:.1f} GB free; {at.options.hours:g} h at {rate / 1e3:.0f} kB/s take up to {needed / 1e9:.2f} GB"
    remedy = "make room, or give another --bag"
    yield wrong(text, remedy) if free < needed else degraded(text, remedy) if free < needed + _RESERVE else right(text)
    text = f"the disk takes {speed / 1e6:.0f} MB/s; the recording {rate / 1e6:.2f}"
    yield degraded(text, "record to a local disk") if speed < _FASTER * rate else right(text)


def programs(at: Subject) -> Iterator[Finding]:
    """Check the programs that nodes are started with."""
    search = at.environment.get("PATH", os.defpath)
    missing = [name for name in ("env", "setpriv") if shutil.which(name, path=search) is None]
    if missing:
        yield wrong(f"{', '.join(missing)} not on the path: no node can be started", "sudo apt install util-linux")
    else:
        yield right("env and setpriv are there")


def kernels(at: Subject) -> Iterator[Finding]:
    """Check that compiled kernels can be kept, and are there for this processor."""
    folder = Path(at.environment.get("NUMBA_CACHE_DIR") or cache_root())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        yield degraded(f"the cache of compiled kernels cannot be written ({error.strerror}): every node compiles them",
                       "make ~/.cache/atpid writable, or set NUMBA_CACHE_DIR")  # fmt: skip
        return
    from atpid_sim.engine.row_loop import integrate

    known = {key[1][1] for key in integrate._cache._cache_file._load_index()}
    own = integrate.targetctx.codegen().magic_tuple()[1]
    remedy = "run a scene once: atpid bench scenes/thesis_4_3.yaml"
    if own in known:
        yield right(f"compiled for this processor ({own})")
    elif known:
        yield degraded(f"compiled for {', '.join(sorted(known))}, this processor is {own}: a minute at the first run",
                       remedy)  # fmt: skip
    else:
        yield degraded("not compiled: a minute at the first run", remedy)


def python(_at: Subject) -> Iterator[Finding]:
    """Check the interpreter."""
    version = ".".join(map(str, sys.version_info[:3]))
    if (3, 10) <= sys.version_info[:2] <= (3, 13) and sys.platform == "linux":
        yield right(f"Python {version}")
    else:
        yield wrong(
            f"Python {version} on {sys.platform}; needed: 3.10 to 3.13 on Linux", "PYTHON=python3.12 make setup"
        )
