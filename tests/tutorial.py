# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tutorial, typed: `python tests/tutorial.py` makes its pictures again (`make figures`)."""

import io
import os
import re
import shutil
import subprocess
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from documented import ROOT, code

from atpid_control.cli import main

PAGE = ROOT / "docs/tutorial.md"
#: The pictures of the page, and which file of the reader's each is.
PICTURES = {"tutorial_run.png": "out/run.png", "tutorial_bench.png": "out/my_beam/overview.png"}


def blocks(language: str) -> list[str]:
    """Return what stands in the page's fences of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def typed() -> list[str]:
    """Return the page's commands of `atpid`, in its order."""
    return [line for line in code(PAGE) if line.startswith("atpid ")]


def type_all(folder: Path) -> dict[str, str]:
    """Type the whole tutorial in `folder`; return what each command printed. Raises AssertionError where one fails."""
    for name in ("scenes", "bags"):
        (folder / name).symlink_to(ROOT / name)
    (scene,) = blocks("yaml")
    (folder / "my_beam.yaml").write_text(scene, encoding="utf-8")
    first, *others = typed()
    done = subprocess.run(first.split(), cwd=folder, capture_output=True, text=True, check=False, timeout=300.0)
    assert done.returncode == 0, f"{first}\n{done.stdout}{done.stderr}"
    return {first: done.stdout + done.stderr} | {command: _typed_here(command, folder) for command in others}


def _typed_here(command: str, folder: Path) -> str:
    """Run a command in this process, which loads the libraries once; return what it printed."""
    here, printed = Path.cwd(), io.StringIO()
    os.chdir(folder)
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            status = main(command.split()[1:])
    finally:
        os.chdir(here)
    assert status == 0, f"{command}\n{printed.getvalue()}"
    return printed.getvalue()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="atpid-tutorial-") as made:
        type_all(Path(made))
        for picture, file in PICTURES.items():
            shutil.copy(Path(made) / file, ROOT / "docs/figures" / picture)
