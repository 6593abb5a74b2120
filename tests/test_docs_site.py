# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The site that `make docs` builds: without a warning, of which a broken link is one, and whole."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from documented import PAGES, ROOT

import atpid_control
import atpid_sim
from atpid_control.cli import commands as installed
from studies.parameters import SECTIONS

SPHINX = ROOT / ".venv" / "docs"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built from nothing as `make docs` does; a warning ends the build."""
    if not (SPHINX / "sphinx").is_dir():
        pytest.skip("Sphinx is missing: make docs-packages")
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ndocs:")[2].partition("\n\n")[0]
    given = re.search(r"python -m sphinx (.*) out/docs/\$\$version", recipe)
    assert given is not None
    built = tmp_path_factory.mktemp("site") / "1.2.3"
    paths = os.pathsep.join([str(SPHINX), *filter(None, [os.environ.get("PYTHONPATH")])])
    variables = {**os.environ, "PYTHONPATH": paths, "ATPID_DOCS_VERSION": built.name}
    command = [sys.executable, "-m", "sphinx", *given[1].split(), str(built)]
    done = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return built


def test_every_page_command_parameter_and_function_is_there(site: Path) -> None:
    changes = [*ROOT.glob("atpid_*/**/CHANGELOG.rst"), *ROOT.glob("extensions/*/CHANGELOG.rst")]
    written = [*PAGES, *ROOT.glob("docs/decisions/*.md"), *changes]
    expected = {site / path.relative_to(ROOT).with_suffix(".html") for path in written}
    assert expected <= {*site.rglob("*.html")}
    shown = (site / "docs/commands.html").read_text() + (site / "docs/parameters.html").read_text()
    named = [name for group in installed().values() for name in group]
    named += [row.name for table in SECTIONS.values() for row in table]
    assert [name for name in named if name not in shown] == []
    documented = set(re.findall(r' id="[^"]+\.([^".]+)"', (site / "docs/python_api.html").read_text()))
    assert ({*dir(atpid_sim)} - {"__version__"}) | {*atpid_control.__all__} <= documented
