# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The steps of docs/howto_contact_law.md, in a copy of the package: one file, one line, its test."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from documented import ROOT

_PAGE = (ROOT / "docs/howto_contact_law.md").read_text(encoding="utf-8")
_SCENE = """
from atpid_sim.kernel_inputs import contact_of, restitution_of
from atpid_sim.scene import load_scene
scene = load_scene("scenes/standard.yaml").with_(contact={})
print(scene.contact.law, restitution_of(contact_of(scene), 1.0, 0.03))
"""


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", _PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with the law of the page."""
    place = tmp_path_factory.mktemp("law")
    (place / "scenes").symlink_to(ROOT / "scenes")
    shutil.copytree(ROOT / "atpid_sim", place / "atpid_sim", ignore=shutil.ignore_patterns("__pycache__"))
    (file,), (line,) = blocks("py"), blocks("text")
    contact = place / "atpid_sim/atpid_sim/contact"
    (contact / "hunt_crossley.py").write_text(file, encoding="utf-8")
    laws = (contact / "laws.py").read_text(encoding="utf-8")
    last = '    "walton_braun",\n'
    assert last in laws
    (contact / "laws.py").write_text(laws.replace(last, last + line), encoding="utf-8")
    return place


def run(copy: Path, *words: str) -> str:
    """Run Python with the copy in place of the package; return what it prints."""
    places = [str(copy / "atpid_sim"), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places), "NUMBA_CACHE_DIR": str(copy / "cache")}
    done = subprocess.run(
        [sys.executable, *words], cwd=copy, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_law_passes_the_general_tests(copy: Path) -> None:
    (command,) = re.findall(r"^    python (-m pytest .*)$", _PAGE, re.MULTILINE)
    printed = run(copy, *command.split(), "-p", "no:cacheprovider")
    assert re.search(r"^7 passed", printed, re.MULTILINE), printed


@pytest.mark.slow
def test_a_scene_takes_the_law(copy: Path) -> None:
    (block,) = blocks("yaml")
    given = yaml.safe_load(block.replace("2.1e8", "2.1e+8"))["contact"]
    law, e = run(copy, "-c", _SCENE.replace("contact={}", f"contact={given}")).split()
    assert law == "hunt_crossley"
    assert float(e) == pytest.approx(0.7484, abs=1e-4)  # root of 0.5 (1 + e) = ln(1.5 / (1 - 0.5 e))
