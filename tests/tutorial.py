# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tutorial, typed: `python tests/tutorial.py` makes its pictures again (`make figures`)."""

import io
import os
import shutil
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from documented import ROOT, blocks, code

from atpid_control.cli import main

PAGE = ROOT / "docs/tutorial.md"
#: The pictures of the page, and which file of the reader's each is.
PICTURES = {"tutorial_run.png": "out/run.png", "tutorial_bench.png": "out/my_beam/overview.png"}


def type_all(folder: Path) -> dict[str, str]:
    """Type the tutorial's commands in `folder`; return what each printed. Raises AssertionError where one fails."""
    for name in ("scenes", "bags"):
        (folder / name).symlink_to(ROOT / name)
    (scene,) = blocks(PAGE, "yaml")
    (folder / "my_beam.yaml").write_text(scene, encoding="utf-8")
    typed, here = {}, Path.cwd()
    os.chdir(folder)
    try:
        for command in (line for line in code(PAGE) if line.startswith("atpid ")):
            printed = io.StringIO()
            with redirect_stdout(printed), redirect_stderr(printed):
                status = main(command.split()[1:])
            typed[command] = printed.getvalue()
            assert status == 0, f"{command}\n{typed[command]}"
    finally:
        os.chdir(here)
    return typed


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="atpid-tutorial-") as made:
        type_all(Path(made))
        for picture, file in PICTURES.items():
            shutil.copy(Path(made) / file, ROOT / "docs/figures" / picture)
