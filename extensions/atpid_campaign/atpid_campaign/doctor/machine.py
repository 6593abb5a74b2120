# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Checks of the machine: packages, workspace, ROS's environment, scene, parameters; rights, USB, clock, disk."""

import importlib
import os
import resource
import runpy
import shutil
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from atpid_common.middleware import CYCLONE_DDS, FAST_DDS, PROFILE, named_domain
from atpid_common.real_time import LOOP_PRIORITY, refusal
from atpid_control.stand.domain import HIGHEST, is_quiet
from atpid_control.stand.findings import Finding, NotCheckedError, Subject, judged

#: Modules that the stand imports from other distributions, beside the vendors' (`devices`); the lock has others.
_NEEDED = ("numpy", "scipy", "numba", "yaml", "pydantic", "serial", "rich", "mcap", "zstandard", "rclpy")
_RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
_UP, _MULTICAST = 0x1, 0x1000  # of net/if.h


def packages(_: Subject) -> Iterator[Finding]:
    """Check that what the stand imports is there, in the versions of the lock."""
    from packaging.requirements import Requirement

    for name in _NEEDED:
        try:
            importlib.import_module(name)
        except Exception as error:  # noqa: BLE001 - of a broken package, which may fail in any way
            yield judged(f"{name}: {type(error).__name__}: {error}", "make setup", fails=True)
    lock = _workspace() / "requirements" / ("wheels.txt" if _of_wheels() else "sourced.txt")
    other = []
    for line in (Requirement(line.strip(" \\")) for line in lock.read_text().splitlines() if line[:1].isalnum()):
        found, wanted = _version(line.name), str(line.specifier).removeprefix("==")
        if found != wanted and (line.marker is None or line.marker.evaluate()):
            other.append(f"{line.name} {found or 'missing'} in place of {wanted}")
    yield judged(f"versions of {lock.name}, but for: {', '.join(other) or 'none'}", "make setup", degrades=bool(other))


def _version(name: str) -> str:
    """Return the version of a distribution that is installed, else ""."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _of_wheels() -> bool:
    """Return whether ROS comes from its wheels."""
    return bool(_version("ros-jazzy-rclpy"))


def _workspace() -> Path:
    """Return the folder ros2_ws of the workspace that is sourced. Raises BenchError, NotCheckedError."""
    from atpid_control.stand.parts import NODES

    folder = NODES["identifier_node"].executable.parents[4].resolve()
    if not (folder / "machine.py").is_file():
        raise NotCheckedError("the workspace that is sourced is none of this repository")
    return folder


def workspace(at: Subject) -> Iterator[Finding]:
    """Check that the workspace is sourced, built, not older than its sources, and the one whose code runs."""
    from atpid_control.stand.parts import devices_of

    for part in devices_of(at.options):
        _ = part.executable  # raises BenchError
    missing = [name for name in ("env", "setpriv") if shutil.which(name) is None]
    if missing:
        text = f"{', '.join(missing)} not on the path: no node can be started"
        yield judged(text, "sudo apt install util-linux", fails=True)
    folder = _workspace()
    machine = runpy.run_path(str(folder / "machine.py"))  # of set-up, whose keys these are
    built = set(machine["read_stamp"](folder / "install/stamp").split())
    manifests = (path for place in ("atpid_*", "extensions") for path in folder.parent.glob(f"{place}/**/package.xml"))
    sources = [path.parent for path in sorted(manifests)]
    stale = [path.name for path in sources if machine["package_key"](path) not in built]
    yield judged(f"sourced; older than its sources: {', '.join(stale) or 'none'}", "make setup", degrades=bool(stale))
    if not Path(__file__).resolve().is_relative_to(folder.parent):
        text = "code of another folder runs than that of the workspace"
        yield judged(text, "take it out of PYTHONPATH", degrades=True)


def middleware(at: Subject) -> Iterator[Finding]:
    """Check which middleware is used, on which network, with whom."""
    from ament_index_python import has_resource

    given = os.environ.get
    if (distribution := given("ROS_DISTRO", "jazzy")) != "jazzy":
        yield judged(f"ROS {distribution} is sourced", "use a shell in which it is not, or ROS 2 Jazzy", fails=True)
    name = given("RMW_IMPLEMENTATION") or FAST_DDS[0]
    there, known = bool(has_resource("packages", name)), name in (*FAST_DDS, CYCLONE_DDS)
    text = f"middleware {name} is {'' if there else 'not '}installed"
    yield judged(text, "unset RMW_IMPLEMENTATION", fails=not there, degrades=not known)
    yield from _network(at)
    domain = named_domain() or 0  # raises DomainError
    quiet = is_quiet(domain)
    mend = f"end them, or set ROS_DOMAIN_ID to another of 0 to {HIGHEST}: Linux gives away the ports above"
    text = f"domain {domain}{'' if quiet else ', in which programs run already'}"
    yield judged(text, mend, degrades=domain > HIGHEST or not quiet)
    if given("ROS_SECURITY_ENABLE", "").lower() == "true":
        keys = (Path(given("ROS_SECURITY_KEYSTORE", "")) / "enclaves").is_dir()
        text = f"security on, keys {'' if keys else 'not '}found"
        yield judged(text, "ROS_SECURITY_KEYSTORE (docs/security.md)", fails=not keys)


def _network(at: Subject) -> Iterator[Finding]:
    """Check the range of discovery, and the interfaces it needs."""
    given = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").upper()
    profile = os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE", str(PROFILE))
    local = given in ("LOCALHOST", "OFF") or os.environ.get("ROS_LOCALHOST_ONLY") == "1"
    if not Path(profile).is_file():
        text = f"{profile}, the profile of Fast DDS, is missing"
        yield judged(text, "unset FASTRTPS_DEFAULT_PROFILES_FILE", fails=True)
    wide = given == "SUBNET" and not local
    weak = " to every computer of the network" + ", with wheels that lack fixes of 2025" * _of_wheels()
    mend = f"ROS_AUTOMATIC_DISCOVERY_RANGE: LOCALHOST; of {', '.join(_RANGES)}"
    yield judged(f"range of discovery {given}{weak * wide}", mend, fails=given not in _RANGES, degrades=wide)
    flags = {path.parent.name: int(text, 16) for path, text in at.texts("sys/class/net/*/flags")}
    if not flags.get("lo", 0) & _UP:
        yield judged("the loopback interface is down: no node finds another", "sudo ip link set lo up", fails=True)
    if not local and not any(flag & _UP and flag & _MULTICAST for name, flag in flags.items() if name != "lo"):
        text = "no interface with multicast is up: nodes on other computers are not found"
        yield judged(text, "sudo ip link set IF up multicast on", degrades=True)


def nodes(at: Subject) -> Iterator[Finding]:
    """Check that no node of the stand runs already."""
    found = at.running()
    text = f"run already: {', '.join(found) or 'none'}"
    yield judged(text, "end them, or set another ROS_DOMAIN_ID", fails=bool(found))


def scene(at: Subject) -> Iterator[Finding]:
    """Check the scene, and the height map that is given for it."""
    from atpid_control.selection.map_cache import map_of_run

    at.scene.refuse_faults("the stand")
    for line in at.scene.warnings():
        yield judged(line, "correct the scene", degrades=True)
    moved = "" if at.scene.ceiling.controlled else "; its ceiling has no controller: the height stays"
    text = f"valid, {at.scene.natural_frequency_hz:.3g} Hz closed{moved}"
    yield judged(text, "ceiling: {controller: lookup, …}", degrades=bool(moved))
    if at.options.map:
        method = at.given.get("selector_node", {}).get("method", "")
        map_of_run(at.scene, at.options.map, method)  # raises InputError: no map, or of another system
        yield judged(f"{at.options.map} is a map of it")


def parameters(at: Subject) -> Iterator[Finding]:
    """Check the parameter files, and that levels are set at which the motor is switched off."""
    from atpid_control.supervision.limits import QUANTITIES

    levels = at.parameters["supervisor_node"]
    found = [name for name in QUANTITIES if levels.get(f"{name}_abort", float("inf")) < float("inf")]
    text = f"abort levels: {', '.join(found) or 'none: however far the beam moves, the motor stays on'}"
    yield judged(text, "set those of your stand with --params-file (docs/graph.md, Levels)", degrades=not found)


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
_KEEPERS = {
    "systemd-timesyncd": "run/systemd/timesync/synchronized",
    "chrony": "run/chrony/chronyd.pid",
    "ntpd": "run/ntpd.pid",
}


def real_time(at: Subject) -> Iterator[Finding]:
    """Check the rights to the loop's real-time priority and, where it is asked for, to locked memory."""
    reason, _, remedy = refusal(LOOP_PRIORITY).partition(": ")
    yield judged(reason or f"real-time priority {LOOP_PRIORITY} is allowed", remedy, degrades=bool(reason))
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if any(values.get("lock_memory") for values in at.parameters.values()):
        text = f"memory that may be locked: {limit / 1e6:.0f} MB" if limit >= 0 else "any memory may be locked"
        yield judged(text, "memlock in /etc/security/limits.conf", degrades=0 <= limit < _NODES)


def usb(at: Subject) -> Iterator[Finding]:
    """Check how long USB serial chips hold short answers back, and who else opens ports."""
    for path, held in at.texts("sys/bus/usb-serial/devices/*/latency_timer"):
        mend = f"echo 1 | sudo tee /{path.relative_to(at.root)}"
        yield judged(f"{path.parent.name} holds answers back for {held} ms", mend, degrades=int(held) > 1)
    runs = any(text == "ModemManager" for _, text in at.texts("proc/[0-9]*/comm"))
    text = f"ModemManager {'runs: it writes to a board that is plugged in' if runs else 'does not run'}"
    yield judged(text, 'ENV{ID_MM_DEVICE_IGNORE}="1" in the udev rule (docs/stand.md)', degrades=runs)


def clock(at: Subject) -> Iterator[Finding]:
    """Check that the wall clock is right, is kept so, and was not set since the checks began."""
    ahead = ((time.time_ns() - at.begun[0]) - (time.monotonic_ns() - at.begun[1])) * 1e-9
    if abs(ahead) > _STEP:
        text = f"the wall clock was set by {ahead:+.3f} s during the checks"
        yield judged(text, "wait until it is synchronised", degrades=True)
    year, kept = time.gmtime(at.begun[0] / 1e9).tm_year, [name for name, path in _KEEPERS.items() if at.files(path)]
    text, old = f"the wall clock shows {year}, kept by {', '.join(kept) or 'nothing'}", at.begun[0] < 1e9 * _OLDEST
    yield judged(text, "sudo timedatectl set-ntp true, or chrony", fails=old, degrades=not kept)


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
    sampled = [values for values in at.parameters.values() if "channels" in values]
    rate = _MESSAGES + sum(values["rate"] * len(values["channels"]) * _READING for values in sampled)
    needed = rate * 3600.0 * at.options.hours
    text = f"{free / 1e9:.1f} GB free; {at.options.hours:g} h at {rate / 1e3:.0f} kB/s take up to {needed / 1e9:.2f} GB"
    yield judged(text, "make room, or give another --bag", fails=free < needed, degrades=free < needed + _RESERVE)
    text = f"the disk takes {speed / 1e6:.0f} MB/s; the recording {rate / 1e6:.2f}"
    yield judged(text, "record to a local disk", degrades=speed < _FASTER * rate)
