# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The site that `make docs` builds: without a warning, whole, and its search finds what is on it; the citation file."""

import html
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import yaml
from documented import OPTION, PAGES, ROOT, options

import atpid_control
import atpid_sim
from atpid_control.cli import COMMANDS as ATPID
from studies.cli import COMMANDS as STUDIES
from studies.parameters import SECTIONS

SPHINX = ROOT / ".venv" / "docs"
WRITTEN = [*PAGES, *ROOT.glob("docs/decisions/*.md")]
#: Words looked for on the site, and a page that has to be among what is found.
SEARCHED = {"margin": "docs/selection", "LabJack": "docs/stand", "restitution": "docs/contact"}


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


def sections(page: Path) -> dict[str, str]:
    """Return the text of a page below each heading, without tags."""
    text = re.sub(r"<br ?/?>", "\n", page.read_text(encoding="utf-8"))
    text = html.unescape(re.sub(r"<[^>]+>", "", text))
    return dict(re.findall(r"\n([^\n]+)¶\n(.*?)(?=\n[^\n]+¶\n|\Z)", text, re.DOTALL))


def anchored(page: Path) -> set[str]:
    """Return the anchors of a page."""
    return set(re.findall(r' id="([^"]+)"', page.read_text(encoding="utf-8")))


def test_every_command_is_there_with_its_options(site: Path) -> None:
    found = {name: set(OPTION.findall(text)) for name, text in sections(site / "docs/commands.html").items()}
    programs = {"atpid": ATPID, "python -m studies": STUDIES}
    expected = {
        f"{program} {name}": taken
        for program, commands in programs.items()
        for name, taken in options(commands).items()
        if any(name in group for group in commands.values())
    }
    assert expected.keys() == {name for name in found if name.startswith(("atpid ", "python -m studies "))}
    assert [name for name, taken in expected.items() if not taken <= found[name]] == []


def test_every_message_parameter_and_public_function_is_there(site: Path) -> None:
    shown = sections(site / "docs/messages.html")
    definitions = ROOT / "atpid_interfaces/atpid_interfaces"
    for path in (path for kind in ("msg", "srv", "action") for path in definitions.glob(f"{kind}/*.{kind}")):
        fields = re.findall(r"^[\w/]+(?:\[\])?\s+(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert {*fields} <= {*re.findall(r"\w+", shown[path.stem])}, path.name
    parameters = (site / "docs/parameters.html").read_text(encoding="utf-8")
    declared = [row.name for table in SECTIONS.values() for row in table]
    assert [name for name in declared if f">{name}<" not in parameters] == []
    documented = {anchor.rpartition(".")[2] for anchor in anchored(site / "docs/python_api.html") if "." in anchor}
    assert ({*dir(atpid_sim)} - {"__version__"}) | {*atpid_control.__all__} <= documented


def test_every_page_is_there_and_every_link_leads_somewhere(site: Path) -> None:
    written = [*WRITTEN, *ROOT.glob("atpid_*/**/CHANGELOG.rst")]
    expected = {site / path.relative_to(ROOT).with_suffix(".html") for path in written}
    pages = {page.resolve(): anchored(page) for page in site.rglob("*.html")}
    assert expected <= pages.keys()
    broken = []
    for page in pages:
        body = page.read_text(encoding="utf-8").partition("<article")[2]
        for target in re.findall(r'(?:href|src)="([^"]+)"', body):
            parts = urlsplit(html.unescape(target))
            place = (page.parent / parts.path).resolve() if parts.path else page
            missing = not place.exists() or (parts.fragment and parts.fragment not in pages.get(place, parts.fragment))
            if missing and not parts.scheme:
                broken.append((page.name, target))
    assert broken == []


def test_a_browser_finds_these_words_and_shows_pages_on_any_screen(site: Path) -> None:
    chromium = shutil.which("chromium")
    if chromium is None or importlib.util.find_spec("playwright") is None:
        pytest.skip("left out: a browser draws the page; Chromium or playwright is missing: sudo make browser")
    command = [sys.executable, str(ROOT / "tests/site_visit.py"), chromium, str(site), *SEARCHED]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    missing = [word for word, page in SEARCHED.items() if f"{page}.html" not in " ".join(seen["found"][word])]
    assert (missing, seen["wrong"]) == ([], {})


def test_an_external_link_is_an_address() -> None:
    links = [link for page in WRITTEN for link in re.findall(r"\]\((\w+:[^)\s]*)\)", page.read_text(encoding="utf-8"))]
    assert links
    assert [link for link in links if not re.fullmatch(r"https?://[\w.-]+\.\w+(/[^\s<>\"]*)?", link)] == []


def test_the_citation_names_this_version_and_the_thesis() -> None:
    # The keys that the Citation File Format 1.2.0 requires, of the file and of a reference.
    cited = yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), yaml.BaseLoader)
    assert {"message", "title", "authors"} <= cited.keys()
    assert (cited["cff-version"], cited["type"], cited["license"]) == ("1.2.0", "software", "Apache-2.0")
    released = re.search(r"^(\S+) \((\S+)\)$", (ROOT / "atpid_sim/CHANGELOG.rst").read_text(encoding="utf-8"), re.M)
    assert released is not None
    assert (cited["version"], cited["date-released"]) == released.groups()
    assert cited["version"] == atpid_sim.__version__
    (thesis,) = cited["references"]
    assert {"authors", "title", "type"} <= thesis.keys()
    assert thesis["title"] in (ROOT / "README.md").read_text(encoding="utf-8").replace("\n", " ")
