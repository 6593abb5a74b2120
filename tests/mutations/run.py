# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Makes each change of the list in a copy of the repository and runs the tests that must fail by it.

    python tests/mutations/run.py [--only PATTERN] [--jobs N] [--list]

Prints a line for each: the test that failed, SURVIVED, or why it could not be tried. First the tests run without a
change: what fails anyway shows nothing. Status 0: every change was seen; 1: one was not; 2: it could not be tried.
"""

import argparse
import fnmatch
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from mutation import ROOT, Mutation, MutationError, listed

from atpid_common.folders import cache_root
from atpid_driver.emulator import build_emulator, missing_tools

#: Folders of the packages that are found in a copy: those with share folders, and what all import.
PACKAGES = (
    *("atpid_control", "atpid_sim", "atpid_driver"),
    *sorted(f"extensions/{path.parent.name}" for path in ROOT.glob("extensions/*/package.xml")),
)
COMMON = "atpid_interfaces/atpid_common"
FIRMWARE = "atpid_driver/firmware/"
SURVIVED = "SURVIVED"


@dataclass(frozen=True)
class Outcome:
    """What became of a run of tests: the first that failed, what prevented the run; empty: nothing."""

    failed: str
    prevented: str
    seconds: float


class Tree:
    """A copy of the repository in which changes are made; packages are found in it and not in the workspace."""

    def __init__(self, folder: Path) -> None:
        """Copy what git has or would add."""
        self.folder = folder
        command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        found = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
        for name in filter(None, found.stdout.decode().split("\0")):
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)
        self._install(folder / "made")
        self._share_cache(folder / "made" / "cache")

    def _install(self, made: Path) -> None:
        """Let ROS find the packages' share folders here, and Python their entry points."""
        index = made / "share" / "ament_index" / "resource_index" / "packages"
        index.mkdir(parents=True)
        for place in (self.folder / package for package in PACKAGES):
            (index / place.name).touch()
            share = made / "share" / place.name
            share.mkdir()
            for name in ("config", "firmware", "launch", "package.xml"):
                if (place / name).exists():
                    (share / name).symlink_to(place / name)
            if place.parent.name == "extensions":  # the core has no entry points of its own that tests need
                describe = [sys.executable, "setup.py", "--quiet", "egg_info"]
                subprocess.run(describe, cwd=place, check=True, capture_output=True)

    def _share_cache(self, cache: Path) -> None:
        """Use what the user's cache has, and leave no mutated firmware there."""
        ours = cache / cache_root().name
        ours.mkdir(parents=True)
        for source, target in ((cache_root().parent, cache), (cache_root(), ours)):
            for entry in source.iterdir():
                if not entry.name.startswith("firmware-") and not (target / entry.name).exists():
                    (target / entry.name).symlink_to(entry)

    @property
    def environment(self) -> dict[str, str]:
        """The environment in which Python and ROS take the packages from here."""
        made = self.folder / "made"
        paths = [str(self.folder / package) for package in (*PACKAGES, COMMON)]
        return os.environ | {
            "PYTHONPATH": os.pathsep.join([*paths, os.environ.get("PYTHONPATH", "")]),
            "AMENT_PREFIX_PATH": os.pathsep.join([str(made), os.environ.get("AMENT_PREFIX_PATH", "")]),
            "XDG_CACHE_HOME": str(made / "cache"),
            "PYTHONDONTWRITEBYTECODE": "1",  # two changes of one size within a second would share the compiled file
        }

    @contextmanager
    def changed(self, mutation: Mutation) -> Iterator[None]:
        """Make a change for as long as this is open. Raises `MutationError` where it cannot be made."""
        path = self.folder / mutation.file
        text = path.read_text()
        path.write_text(mutation.applied(text))
        try:
            if mutation.file.startswith(FIRMWARE):
                self._build_firmware(mutation.name)
            yield
        finally:
            path.write_text(text)

    def _build_firmware(self, name: str) -> None:
        """Build it once for all tests: one that does not compile fails each of them and shows nothing."""
        build = [sys.executable, "-c", "from atpid_driver.emulator import build_firmware; build_firmware()"]
        done = subprocess.run(build, env=self.environment, cwd=self.folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise MutationError(f"{name}: it does not compile: {done.stderr.strip().splitlines()[-1]}")

    def test(self, names: Iterable[str], *more: str) -> Outcome:
        """Run these tests up to the first that fails."""
        words = ["-m", "pytest", "-q", "-x", "-c", "pyproject.toml", "-p", "no:cacheprovider", *more, *names]
        command = [sys.executable, *words]
        begun = time.monotonic()
        done = subprocess.run(
            command, env=self.environment, cwd=self.folder, capture_output=True, text=True, check=False
        )
        seconds = time.monotonic() - begun
        failed = re.findall(r"^(?:FAILED|ERROR) (\S+::.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
        if done.returncode == 1 and failed:
            return Outcome(failed[0], "", seconds)
        skipped = re.search(r"\d+ skipped", done.stdout)
        if done.returncode == 0 and not skipped:
            return Outcome("", "", seconds)
        lines = (done.stdout + done.stderr).strip().splitlines() or ["nothing printed"]
        why = next((line for line in lines if line.startswith(("ERROR", "SKIPPED", "E  "))), lines[-1])
        return Outcome("", f"pytest ended with status {done.returncode}: {why}", seconds)


def tried(tree: Tree, mutation: Mutation) -> Outcome:
    """Make a change, run its tests, take it back."""
    try:
        with tree.changed(mutation):
            return tree.test(mutation.tests, "--force-reruns", "0")  # one that waits in vain does so once
    except MutationError as error:
        return Outcome("", str(error), 0.0)


def broken_before(trees: Sequence[Tree], mutations: Sequence[Mutation]) -> list[str]:
    """Run the tests of these mutations without a change, a share in each tree; return what fails or prevents them."""
    by_file: dict[str, list[str]] = {}
    for name in dict.fromkeys(name for mutation in mutations for name in mutation.tests):
        by_file.setdefault(name.partition("::")[0], []).append(name)
    shares: list[list[str]] = [[] for _ in trees]
    for names in sorted(by_file.values(), key=len, reverse=True):
        min(shares, key=len).extend(names)
    with ThreadPoolExecutor(len(trees)) as pool:
        outcomes = list(
            pool.map(lambda tree, names: tree.test(names) if names else Outcome("", "", 0.0), trees, shares)
        )
    return [outcome.failed or outcome.prevented for outcome in outcomes if outcome.failed or outcome.prevented]


def run(mutations: Sequence[Mutation], jobs: int) -> int:
    """Try every one of these, print a table; return the exit status."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="atpid-mutations-") as folder:
        trees = [Tree(Path(folder) / str(number)) for number in range(jobs)]
        if before := broken_before(trees, mutations):
            print(f"error: fails without any change: {'; '.join(before)}; mend it first", file=sys.stderr)
            return 2
        print(f"without a change every test passes, {time.monotonic() - begun:.0f} s", flush=True)
        free: SimpleQueue[Tree] = SimpleQueue()
        for tree in trees:
            free.put(tree)

        def one(mutation: Mutation) -> Outcome:
            tree = free.get()
            try:
                return tried(tree, mutation)
            finally:
                free.put(tree)

        outcomes = []
        with ThreadPoolExecutor(jobs) as pool:
            for mutation, outcome in zip(mutations, pool.map(one, mutations), strict=True):
                outcomes.append(outcome)
                result = f"NOT TRIED: {outcome.prevented}" if outcome.prevented else outcome.failed or SURVIVED
                print(f"{mutation.name:44} {outcome.seconds:4.0f} s  {result}", flush=True)
    killed = sum(bool(outcome.failed) for outcome in outcomes)
    prevented = sum(bool(outcome.prevented) for outcome in outcomes)
    print(
        f"{len(outcomes)} mutations: {killed} seen, {len(outcomes) - killed - prevented} survived, "
        f"{prevented} not tried; {time.monotonic() - begun:.0f} s"
    )
    return 2 if prevented else int(killed < len(outcomes))


def main() -> int:
    """Read the arguments; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="*", help="names or files to try, with * and ?")
    parser.add_argument("--jobs", type=int, default=2, choices=range(1, 17), help="how many at once (default 2)")
    parser.add_argument("--list", action="store_true", help="print the list and try nothing")
    arguments = parser.parse_args()
    chosen = [m for m in listed() if any(fnmatch.fnmatch(name, arguments.only) for name in (m.name, m.file))]
    if not chosen:
        print(
            f"error: --only {arguments.only}: no mutation has such a name or file; --list names them", file=sys.stderr
        )
        return 2
    if arguments.list:
        for mutation in chosen:
            print(f"{mutation.name:44} {mutation.file}: {mutation.why}")
        return 0
    if missing := missing_tools():
        print(f"error: the firmware's tests need {', '.join(missing)}: sudo make avr-tools", file=sys.stderr)
        return 2
    build_emulator()
    return run(chosen, min(arguments.jobs, len(chosen)))


if __name__ == "__main__":
    sys.exit(main())
