# SPDX-License-Identifier: Apache-2.0
"""Checks of the software: packages, workspace, ROS's environment."""

import importlib
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from atpid_common.middleware import CYCLONE_DDS, FAST_DDS, PROFILE, named_domain
from atpid_control.stand.doctor.findings import Finding, NotCheckedError, Subject, degraded, not_checked, right, wrong
from atpid_control.stand.domain import HIGHEST, is_quiet

#: Modules that the stand imports from other distributions, beside the vendors' (`devices`).
_NEEDED = ("numpy", "scipy", "numba", "yaml", "pydantic", "serial", "rich", "mcap", "zstandard", "rclpy")
#: And those of one use each.
_OPTIONAL = {"pyarrow": "export to Parquet (make parquet)", "tornado": "live page", "matplotlib": "pictures",
             "plotly": "reports", "foxglove": "Foxglove", "nidaqmx": "NI-9230", "labjack": "LabJack T7"}  # fmt: skip
_LOCKED = re.compile(r"^([A-Za-z0-9][\w.-]*)==([^\s;\\]+)\s*(?:;\s*(.*?))?\s*\\?$", re.MULTILINE)
_RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
_UP, _MULTICAST = 0x1, 0x1000  # of net/if.h


def packages(at: Subject) -> Iterator[Finding]:
    """Check that what the stand imports is there, in the versions of the lock."""
    for name in _NEEDED:
        if reason := _missing(name):
            yield wrong(reason, "make setup")
    for name, use in _OPTIONAL.items():
        if reason := _missing(name):
            yield not_checked(f"left out: {use}: {reason}")
    lock = workspace_of(at) / "requirements" / ("wheels.txt" if _of_wheels() else "sourced.txt")
    other = list(_others(lock))
    if other:
        yield degraded(f"not the versions of {lock.name}: {', '.join(other)}", "make setup")
    else:
        yield right(f"versions as in {lock.name}")


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
        if marker and not Marker(marker).evaluate():
            continue
        try:
            if (found := version(name)) != wanted:
                yield f"{name} {found} in place of {wanted}"
        except PackageNotFoundError:
            yield f"{name} {wanted} is missing"


def _of_wheels() -> bool:
    """Return whether ROS comes from its wheels."""
    try:
        return bool(version("ros-jazzy-rclpy"))
    except PackageNotFoundError:
        return False


def workspace_of(at: Subject) -> Path:
    """Return the folder ros2_ws of the workspace that is sourced. Raises NotCheckedError."""
    for prefix in at.environment.get("AMENT_PREFIX_PATH", "").split(":"):
        folder = Path(prefix).resolve()
        if folder.name == "atpid_control" and (folder.parents[1] / "machine.py").is_file():
            return folder.parents[1]
    raise NotCheckedError("no workspace of this repository is sourced")


def workspace(at: Subject) -> Iterator[Finding]:
    """Check that the workspace is sourced, built, not older than its sources, and the one whose code runs."""
    from atpid_control.stand.parts import NODES, devices_of

    for part in (*devices_of(at.options), *(NODES[name] for name in ("identifier_node", "recorder_node"))):
        _ = part.executable  # raises BenchError
    folder = workspace_of(at)
    sys.path.insert(0, str(folder))
    try:
        machine: Any = importlib.import_module("machine")
    finally:
        sys.path.remove(str(folder))
    built = set(machine.read_stamp(folder / "install/stamp").split())
    stale = [path.parent.name for path in sorted(folder.parent.glob("atpid_*/**/package.xml"))
             if machine.package_key(path.parent) not in built]  # fmt: skip
    if stale:
        yield degraded(f"older than its sources: {', '.join(stale)}", "make setup")
    else:
        yield right("sourced and built from these sources")
    if not Path(__file__).resolve().is_relative_to(folder.parent):
        yield degraded("code of another folder runs than that of the workspace", "take it out of PYTHONPATH")


def middleware(at: Subject) -> Iterator[Finding]:
    """Check which middleware is used, on which network, with whom."""
    if (distribution := at.environment.get("ROS_DISTRO", "jazzy")) != "jazzy":
        yield wrong(f"ROS {distribution} is sourced", "use a shell in which it is not, or ROS 2 Jazzy")
    name = at.environment.get("RMW_IMPLEMENTATION") or FAST_DDS[0]
    prefixes = at.environment.get("AMENT_PREFIX_PATH", "").split(":")
    if not any((Path(prefix) / "share/ament_index/resource_index/packages" / name).exists() for prefix in prefixes):
        yield wrong(f"RMW_IMPLEMENTATION {name} is not installed", "unset RMW_IMPLEMENTATION, or install it")
    elif name not in (*FAST_DDS, CYCLONE_DDS):
        yield degraded(f"RMW_IMPLEMENTATION {name}: not tried with this stand", f"use {FAST_DDS[0]}")
    else:
        yield right(f"middleware {name}")
    yield from _network(at)
    domain = named_domain(at.environment) or 0  # raises DomainError
    if domain > HIGHEST:
        yield degraded(f"domain {domain}: its ports are among those that Linux gives to any program",
                       f"ROS_DOMAIN_ID of 0 to {HIGHEST}")  # fmt: skip
    if not is_quiet(domain):
        yield degraded(f"programs run in domain {domain} already", "end them, or set another ROS_DOMAIN_ID")
    if at.environment.get("ROS_SECURITY_ENABLE", "").lower() == "true":
        store = Path(at.environment.get("ROS_SECURITY_KEYSTORE", ""))
        found = f"security on, keys {'found' if (store / 'enclaves').is_dir() else 'not found'}"
        remedy = "set ROS_SECURITY_KEYSTORE (docs/security.md)"
        yield right(found) if (store / "enclaves").is_dir() else wrong(found, remedy)


def _network(at: Subject) -> Iterator[Finding]:
    """Check the range of discovery, and the interfaces it needs."""
    given = at.environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").upper()
    local = given in ("LOCALHOST", "OFF") or at.environment.get("ROS_LOCALHOST_ONLY") == "1"
    profile = at.environment.get("FASTRTPS_DEFAULT_PROFILES_FILE", str(PROFILE))
    if given not in _RANGES:
        yield wrong(f"ROS_AUTOMATIC_DISCOVERY_RANGE {given}; allowed: {', '.join(_RANGES)}", "export it as LOCALHOST")
    elif not Path(profile).is_file():
        yield wrong(f"{profile}, the profile of Fast DDS, is missing", "unset FASTRTPS_DEFAULT_PROFILES_FILE")
    elif not local and profile == str(PROFILE) and given != "SYSTEM_DEFAULT":
        weak = "; the wheels' Fast DDS lacks fixes of 2025" if _of_wheels() else ""
        yield degraded(f"range {given}: every computer of the network takes part{weak}",
                       "export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")  # fmt: skip
    else:
        yield right(f"range of discovery {given}")
    flags = {path.parent.name: int(path.read_text(), 16) for path in at.files("sys/class/net/*/flags")}
    if not flags.get("lo", 0) & _UP:
        yield wrong("the loopback interface is down: no node finds another", "sudo ip link set lo up")
    if not local and not any(flag & _UP and flag & _MULTICAST for name, flag in flags.items() if name != "lo"):
        yield degraded("no interface with multicast is up: nodes on other computers are not found",
                       "sudo ip link set IF up multicast on")  # fmt: skip


def nodes(at: Subject) -> Iterator[Finding]:
    """Check that no node of the stand runs already in this domain on this machine."""
    from atpid_common.claim import claimed

    running = []
    for name in ("motor_node", "labjack_node", "ni_node", "identifier_node", "selector_node", "recorder_node"):
        holder = claimed(f"{at.environment.get('ROS_DOMAIN_ID', '0')}/{name}")
        if holder is None:
            running.append(name)
        else:
            holder.close()
    if running:
        yield wrong(f"run already: {', '.join(running)}", "end them, or set another ROS_DOMAIN_ID")
    else:
        yield right("none of the stand's nodes runs yet")


def scene(at: Subject) -> Iterator[Finding]:
    """Check the scene."""
    found = at.read_scene()
    if found is None:
        yield not_checked("no scene was given")
        return
    found.refuse_faults("the stand")
    for line in found.warnings():
        yield degraded(line, "correct the scene")
    if not found.ceiling.controlled:
        yield degraded("its ceiling has no controller: the height stays", "ceiling: {controller: lookup, …}")
    yield right(f"valid: {found.frequency_hz:.3g} Hz closed" if found.frequency_hz else "valid")


def parameters(at: Subject) -> Iterator[Finding]:
    """Check the parameter files, and that levels are set at which the motor is switched off."""
    import math

    from atpid_control.supervision.limits import QUANTITIES

    levels = at.read_parameters()["supervisor_node"]
    at.parameters  # noqa: B018 - kept for other checks
    if all(math.isinf(levels.get(f"{name}_abort", math.inf)) for name in QUANTITIES):
        yield degraded("no abort level is set: however far the beam moves, the motor stays on",
                       "set those of your stand with --params-file (docs/graph.md, Levels)")  # fmt: skip
    else:
        yield right("read; an abort level is set")
