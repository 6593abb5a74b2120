# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Import all that packages import, also within functions, so that Python keeps its bytecode: `bytecode.py PACKAGE ...`.

Where PYTHONDONTWRITEBYTECODE is set, as in many containers, or `.venv` cannot be written later, each start of a program
would otherwise compile what it imports, which takes longer than most of its work.
"""

import ast
import importlib
import sys
import warnings
from contextlib import suppress
from pathlib import Path


def imported_by(package: Path) -> set[str]:
    """Return the names of the modules of a package's folder, and of all that they import."""
    found = set()
    for path in package.glob(f"{package.name}/**/*.py"):
        found.add(".".join(path.relative_to(package).with_suffix("").parts).removesuffix(".__init__"))
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module)
    return {name for name in found if not name.endswith("__main__")}


def main() -> None:
    """Import it; what is not installed, or fails while it is imported, does not end the set-up."""
    warnings.simplefilter("ignore")
    for name in sorted(set().union(*(imported_by(Path(folder)) for folder in sys.argv[1:]))):
        with suppress(Exception):
            importlib.import_module(name)


if __name__ == "__main__":
    main()
