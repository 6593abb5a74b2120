# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The licences of all that is installed as a table, and whether each fits the Apache License 2.0 (docs/security.md)."""

import re
import sys
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path

#: Licence by what metadata calls it: the first expression found.
NAMES = (
    (r"apache.*llvm", "Apache-2.0 WITH LLVM-exception"),
    (r"apache", "Apache-2.0"),
    (r"mozilla|mpl", "MPL-2.0"),
    (r"bsd|enthought", "BSD"),
    (r"\bpsf\b|python software foundation|matplotlib", "PSF-2.0"),
    (r"\bmit\b|any-osi", "MIT"),
    (r"zlib", "Zlib"),
    (r"\bisc\b", "ISC"),
)
#: Those whose metadata do not say it, or say it in several ways; from the text of the licence that comes with each.
STATED = {
    "axe-playwright-python": "MIT",  # with axe-core inside, MPL-2.0
    "apsw": "any OSI-approved",
    "cycler": "BSD",
    "docutils": "public domain, BSD; GPL for one Emacs file",
    "empy": "LGPL-2.1-or-later",
    "kiwisolver": "BSD",
    "ros-fastcdr": "Apache-2.0",
    "ros-fastrtps": "Apache-2.0",
    "nptdms": "LGPL-3.0-only",
    "setuptools": "MIT",
}
#: What may be used, changed and distributed with work under the Apache License 2.0; MPL-2.0 asks for the source
#: of its own files.
COMPATIBLE = {
    "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD", "ISC", "MIT", "MPL-2.0", "PSF-2.0", "Zlib",
    "any OSI-approved",
}  # fmt: skip
#: What is not distributed with the packages, and runs without being imported by them or where the user installed it:
#: what each does here.
TOOLS = {
    "docutils": "reads metadata while packages are built; the Emacs file is not used",
    "empy": "fills templates while the messages are built",
    "nptdms": "reads TDMS for `atpid bag import`, after `make import`",
}


def stated(one: Distribution) -> Iterator[str]:
    """Yield what a distribution's metadata call its licence, the most exact first."""
    yield one.metadata.get("License-Expression") or ""
    yield from (c.rpartition("::")[2] for c in one.metadata.get_all("Classifier") or [] if c.startswith("License"))
    yield ((one.metadata.get("License") or "").strip().splitlines() or [""])[0]
    name = one.metadata["Name"].replace("-", "_")
    for package in (name, name.removeprefix("ros_"), name.removeprefix("ros_jazzy_")):
        manifest = Path(sys.prefix) / "share" / package / "package.xml"
        if manifest.is_file():
            yield from (element.text or "" for element in ElementTree.parse(manifest).iter("license"))


def licence(one: Distribution) -> str:
    """Return the licence in short; empty: unknown."""
    name = one.metadata["Name"].lower()
    if name in STATED:
        return STATED[name]
    for text in stated(one):
        for pattern, short in NAMES:
            if re.search(pattern, text.lower()):
                return short
    return ""


def found() -> dict[str, set[str]]:
    """Return the names of all distributions installed, by licence, without those of this project.

    A package of ROS counts once, by its wheel, whose name begins with `ros-`.
    """
    groups = defaultdict(set)
    here = [one for one in distributions() if str(one.locate_file("")).startswith(sys.prefix)]
    every = {one.metadata["Name"]: one for one in here}
    for name, one in every.items():
        in_wheel = f"ros-{name.replace('_', '-')}" in every or name == "ament_cmake_test"
        if not name.startswith("atpid") and not in_wheel:
            groups[licence(one)].add(name)
    return dict(groups)


def problems(groups: dict[str, set[str]]) -> list[str]:
    """Return a line for each distribution whose licence does not fit, or is not known."""
    return [
        f"{name}: {short or 'no licence known'}"
        for short, names in groups.items()
        for name in sorted(names)
        if short not in COMPATIBLE and name.lower() not in TOOLS
    ]


def main() -> int:
    """Print the table, and what does not fit; return 1 where something does not."""
    groups = found()
    print("| licence | how many | what |\n| --- | --- | --- |")
    for short, names in sorted(groups.items(), key=lambda group: -len(group[1])):
        listed = sorted(names, key=str.lower)
        ros = [name for name in listed if name.startswith("ros-")]
        rest = [name for name in listed if not name.startswith("ros-")]
        text = ", ".join(rest + ([f"{len(ros)} wheels of ROS 2 (`ros-…`)"] if ros else []))
        print(f"| {short or 'unknown'} | {len(names)} | {text} |")
    for line in problems(groups):
        print(line, file=sys.stderr)
    return int(bool(problems(groups)))


if __name__ == "__main__":
    sys.exit(main())
