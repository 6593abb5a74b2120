# SPDX-License-Identifier: Apache-2.0
"""The origin of a run: its id, the commit of the code, its configuration verbatim."""

import platform
import secrets
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, count
from pathlib import Path

from atpid_control.bags.errors import BagError

#: Names of the metadata records in the MCAP file.
RUN, RESULT = "atpid_run", "atpid_result"
#: Name of the attachment that holds the scene.
SCENE = "scene.yaml"


@dataclass(frozen=True)
class RunInfo:
    """What is written at the beginning of a bag, before any message."""

    id: str
    commit: str
    created: datetime
    facts: dict[str, str] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)  # attachments by name

    def record(self) -> dict[str, str]:
        """Return the metadata record, which metadata.yaml repeats as `custom_data`."""
        return {
            "run_id": self.id,
            "commit": self.commit,
            "created": self.created.isoformat(timespec="seconds"),
            **self.facts,
        }


def new_run(
    scene: Path | None = None, files: Iterable[Path] = (), run_id: str = "", commit: str = "", **facts: str
) -> RunInfo:
    """Return the description of a run that begins now; raise BagError for a file that cannot be read."""
    created = datetime.now(timezone.utc)
    attached: dict[str, bytes] = {}
    if scene is not None:
        attached[SCENE] = _read(scene)
        facts = {"scene": scene.name, **facts}
    for path in files:
        content = _read(path)
        if attached.get(path.name) != content:
            # numbered where a file of another folder already has the name
            names = chain([path.name], (f"{path.stem}-{number}{path.suffix}" for number in count(2)))
            attached[next(name for name in names if name not in attached)] = content
    identity = run_id or f"{created:%Y%m%dT%H%M%SZ}-{secrets.token_hex(3)}"
    machine = {"python": platform.python_version(), "machine": platform.machine()}
    return RunInfo(identity, commit or commit_of(Path(__file__)), created, {**facts, **machine}, attached)


def commit_of(path: Path) -> str:
    """Return `git describe` of the checkout `path` is in ("-dirty": with changes), else the installed version."""
    command = ["git", "-C", str(path.resolve().parent), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    with suppress(OSError, subprocess.TimeoutExpired):
        answer = subprocess.run(command, capture_output=True, text=True, timeout=10.0, check=False)
        if answer.returncode == 0:
            return answer.stdout.strip()
    try:
        return f"version {version('atpid_control')}"
    except PackageNotFoundError:
        return "unknown"


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise BagError(
            f"{path}: given as configuration to record, but cannot be read ({error.strerror}); give an existing file"
        ) from None
