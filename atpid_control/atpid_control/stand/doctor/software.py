# SPDX-License-Identifier: Apache-2.0
"""Checks of the software: packages, workspace, ROS's environment, scene and parameters."""

import importlib
import re
import shutil
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from atpid_common.claim import claimed
from atpid_common.middleware import CYCLONE_DDS, FAST_DDS, PROFILE, named_domain
from atpid_control.stand.doctor.findings import Finding, NotCheckedError, Subject, Verdict, judged
from atpid_control.stand.domain import HIGHEST, is_quiet

#: Modules that the stand imports from other distributions, beside the vendors' (`devices`); and those of one use each.
_NEEDED = ("numpy", "scipy", "numba", "yaml", "pydantic", "serial", "rich", "mcap", "zstandard", "rclpy")
_OPTIONAL = {"pyarrow": "export to Parquet (make parquet)", "tornado": "live page", "matplotlib": "pictures",
             "plotly": "reports", "foxglove": "Foxglove"}  # fmt: skip
_LOCKED = re.compile(r"^([A-Za-z0-9][\w.-]*)==([^\s;\\]+)\s*(?:;\s*(.*?))?\s*\\?$", re.MULTILINE)
_RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
_UP, _MULTICAST = 0x1, 0x1000  # of net/if.h
_STARTED = ("motor_node", "labjack_node", "ni_node", "identifier_node", "selector_node", "recorder_node")


def packages(at: Subject) -> Iterator[Finding]:
    """Check that what the stand imports is there, in the versions of the lock."""
    missing = {name: reason for name in (*_NEEDED, *_OPTIONAL) if (reason := _missing(name))}
    for name, reason in missing.items():
        if name in _NEEDED:
            yield judged(reason, "make setup", fails=True)
        else:
            yield Finding(Verdict.NOT_CHECKED, f"left out: {_OPTIONAL[name]}: {reason}")
    lock = workspace_of(at) / "requirements" / ("wheels.txt" if _of_wheels() else "sourced.txt")
    other = list(_others(lock))
    yield judged(f"versions of {lock.name}, but for: {', '.join(other) or 'none'}", "make setup", degrades=bool(other))


def _missing(name: str) -> str:
    """Return why a module cannot be imported; "" where it can."""
    try:
        importlib.import_module(name)
    except Exception as error:  # noqa: BLE001 - of a broken package, which may fail in any way
        return f"{name}: {type(error).__name__}: {error}"
    return ""


def _others(lock: Path) -> Iterator[str]:
    """Yield the packages that are installed in another version than the lock's, or not at all."""
    from packaging.markers import Marker

    for name, wanted, marker in _LOCKED.findall(lock.read_text()):
        if not marker or Marker(marker).evaluate():
            found = _version(name)
            if found != wanted:
                yield f"{name} {found or 'missing'} in place of {wanted}"


def _version(name: str) -> str:
    """Return the version of a distribution that is installed, else ""."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _of_wheels() -> bool:
    """Return whether ROS comes from its wheels."""
    return bool(_version("ros-jazzy-rclpy"))


def workspace_of(at: Subject) -> Path:
    """Return the folder ros2_ws of the workspace that is sourced. Raises NotCheckedError."""
    for prefix in _prefixes(at):
        folder = prefix.resolve()
        if folder.name == "atpid_control" and (folder.parents[1] / "machine.py").is_file():
            return folder.parents[1]
    raise NotCheckedError("no workspace of this repository is sourced")


def _prefixes(at: Subject) -> list[Path]:
    return [Path(prefix) for prefix in at.environment.get("AMENT_PREFIX_PATH", "").split(":")]


def workspace(at: Subject) -> Iterator[Finding]:
    """Check that the workspace is sourced, built, not older than its sources, and the one whose code runs."""
    from atpid_control.stand.parts import NODES, devices_of

    for part in (*devices_of(at.options), NODES["identifier_node"]):
        _ = part.executable  # raises BenchError
    missing = [name for name in ("env", "setpriv") if shutil.which(name, path=at.environment.get("PATH")) is None]
    if missing:
        yield judged(f"{', '.join(missing)} not on the path: no node can be started", "sudo apt install util-linux",
                     fails=True)  # fmt: skip
    folder = workspace_of(at)
    sys.path.insert(0, str(folder))
    try:
        machine: Any = importlib.import_module("machine")  # of set-up, whose keys these are
    finally:
        sys.path.remove(str(folder))
    built = set(machine.read_stamp(folder / "install/stamp").split())
    sources = [path.parent for path in sorted(folder.parent.glob("atpid_*/**/package.xml"))]
    stale = [path.name for path in sources if machine.package_key(path) not in built]
    yield judged(f"sourced; older than its sources: {', '.join(stale) or 'none'}", "make setup", degrades=bool(stale))
    if not Path(__file__).resolve().is_relative_to(folder.parent):
        yield judged("code of another folder runs than that of the workspace", "take it out of PYTHONPATH",
                     degrades=True)  # fmt: skip


def middleware(at: Subject) -> Iterator[Finding]:
    """Check which middleware is used, on which network, with whom."""
    given = at.environment.get
    if (distribution := given("ROS_DISTRO", "jazzy")) != "jazzy":
        yield judged(f"ROS {distribution} is sourced", "use a shell in which it is not, or ROS 2 Jazzy", fails=True)
    name = given("RMW_IMPLEMENTATION") or FAST_DDS[0]
    there = any((prefix / "share/ament_index/resource_index/packages" / name).exists() for prefix in _prefixes(at))
    yield judged(f"middleware {name} is {'' if there else 'not '}installed", "unset RMW_IMPLEMENTATION",
                 fails=not there, degrades=name not in (*FAST_DDS, CYCLONE_DDS))  # fmt: skip
    yield from _network(at)
    domain = named_domain(at.environment) or 0  # raises DomainError
    quiet = is_quiet(domain)
    yield judged(f"domain {domain}{'' if quiet else ', in which programs run already'}",
                 f"end them, or set ROS_DOMAIN_ID to another of 0 to {HIGHEST}: Linux gives away the ports above",
                 degrades=domain > HIGHEST or not quiet)  # fmt: skip
    if given("ROS_SECURITY_ENABLE", "").lower() == "true":
        keys = (Path(given("ROS_SECURITY_KEYSTORE", "")) / "enclaves").is_dir()
        yield judged(f"security on, keys {'' if keys else 'not '}found", "ROS_SECURITY_KEYSTORE (docs/security.md)",
                     fails=not keys)  # fmt: skip


def _network(at: Subject) -> Iterator[Finding]:
    """Check the range of discovery, and the interfaces it needs."""
    given = at.environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").upper()
    profile = at.environment.get("FASTRTPS_DEFAULT_PROFILES_FILE", str(PROFILE))
    local = given in ("LOCALHOST", "OFF") or at.environment.get("ROS_LOCALHOST_ONLY") == "1"
    if not Path(profile).is_file():
        yield judged(f"{profile}, the profile of Fast DDS, is missing", "unset FASTRTPS_DEFAULT_PROFILES_FILE",
                     fails=True)  # fmt: skip
    weak = " to every computer of the network" + ", with wheels that lack fixes of 2025" * _of_wheels()
    yield judged(f"range of discovery {given}{weak * (given == 'SUBNET' and not local)}",
                 f"ROS_AUTOMATIC_DISCOVERY_RANGE: LOCALHOST; of {', '.join(_RANGES)}", fails=given not in _RANGES,
                 degrades=given == "SUBNET" and not local)  # fmt: skip
    flags = {path.parent.name: int(path.read_text(), 16) for path in at.files("sys/class/net/*/flags")}
    if not flags.get("lo", 0) & _UP:
        yield judged("the loopback interface is down: no node finds another", "sudo ip link set lo up", fails=True)
    if not local and not any(flag & _UP and flag & _MULTICAST for name, flag in flags.items() if name != "lo"):
        yield judged("no interface with multicast is up: nodes on other computers are not found",
                     "sudo ip link set IF up multicast on", degrades=True)  # fmt: skip


def nodes(at: Subject) -> Iterator[Finding]:
    """Check that no node of the stand runs already in this domain on this machine."""
    holders = {name: claimed(f"{at.environment.get('ROS_DOMAIN_ID', '0')}/{name}") for name in _STARTED}
    for holder in filter(None, holders.values()):
        holder.close()
    running = [name for name, holder in holders.items() if holder is None]
    yield judged(f"run already: {', '.join(running) or 'none'}", "end them, or set another ROS_DOMAIN_ID",
                 fails=bool(running))  # fmt: skip


def scene(at: Subject) -> Iterator[Finding]:
    """Check the scene."""
    found = at.read_scene()
    if found is None:
        yield Finding(Verdict.NOT_CHECKED, "no scene was given")
        return
    found.refuse_faults("the stand")
    for line in found.warnings():
        yield judged(line, "correct the scene", degrades=True)
    moved = "" if found.ceiling.controlled else "; its ceiling has no controller: the height stays"
    yield judged(f"valid, {found.natural_frequency_hz:.3g} Hz closed{moved}", "ceiling: {controller: lookup, …}",
                 degrades=bool(moved))  # fmt: skip


def parameters(at: Subject) -> Iterator[Finding]:
    """Check the parameter files, and that levels are set at which the motor is switched off."""
    from atpid_control.supervision.limits import QUANTITIES

    levels = at.read_parameters()["supervisor_node"]
    found = [name for name in QUANTITIES if levels.get(f"{name}_abort", float("inf")) < float("inf")]
    yield judged(f"abort levels: {', '.join(found) or 'none: however far the beam moves, the motor stays on'}",
                 "set those of your stand with --params-file (docs/graph.md, Levels)", degrades=not found)  # fmt: skip
