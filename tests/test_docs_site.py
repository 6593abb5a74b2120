# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The site that `make docs` builds: without a warning, whole, and its search finds what is on it; the citation file."""

import functools
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
from documented import PAGES, ROOT

import atpid_control
import atpid_sim
from atpid_common.cli import Commands, full_parser
from atpid_control.cli import COMMANDS as ATPID
from studies.cli import COMMANDS as STUDIES
from studies.parameters import SECTIONS

SPHINX = ROOT / ".venv" / "docs"
INTERFACES = ROOT / "atpid_interfaces" / "atpid_interfaces"
#: What rosdoc2 replaces where ROS is not installed.
MOCKED = [
    "action_msgs", "atpid_interfaces", "builtin_interfaces", "diagnostic_msgs", "lifecycle_msgs", "rcl_interfaces",
    "rclpy", "rosgraph_msgs", "rosidl_runtime_py", "sensor_msgs", "std_msgs", "std_srvs",
]  # fmt: skip
#: Words looked for on the site, and a page that has to be among what is found.
SEARCHED = {"margin": "docs/selection", "LabJack": "docs/stand", "restitution": "docs/contact"}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built from nothing as `make docs` does; a warning ends the build."""
    if not (SPHINX / "sphinx").is_dir():
        pytest.skip("Sphinx is missing: make docs-packages")
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ndocs:")[2].partition("\n\n")[0]
    options = re.search(r"python -m sphinx (.*) out/docs/\$\$version", recipe)
    assert options is not None
    built = tmp_path_factory.mktemp("site") / "1.2.3"
    paths = os.pathsep.join([str(SPHINX), *filter(None, [os.environ.get("PYTHONPATH")])])
    given = {**os.environ, "PYTHONPATH": paths, "ATPID_DOCS_VERSION": built.name}
    command = [sys.executable, "-m", "sphinx", *options[1].split(), str(built)]
    done = subprocess.run(command, cwd=ROOT, env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return built


def text_of(page: Path) -> str:
    """Return the text of a page, without its tags."""
    text = page.read_text(encoding="utf-8").replace("<br />", "\n").replace("<br>", "\n")
    return html.unescape(re.sub(r"<[^>]+>", "", text))


def anchored(page: Path) -> set[str]:
    """Return the anchors of a page."""
    return set(re.findall(r' id="([^"]+)"', page.read_text(encoding="utf-8")))


def options_of(program: str, commands: Commands) -> dict[str, set[str]]:
    """Return the long options of each command, from its parser."""
    whole, found = full_parser(program, commands), {}
    for name in (name for group in commands.values() for name in group):
        parser = whole
        for word in name.split():
            (inner,) = (action.choices for action in parser._actions if isinstance(action.choices, dict))
            parser = inner[word]
        found[f"{program} {name}"] = {
            option for action in parser._actions for option in action.option_strings if option.startswith("--")
        } - {"--help"}
    return found


@pytest.mark.slow
def test_every_command_is_there_with_its_options(site: Path) -> None:
    text = text_of(site / "docs/commands.html")
    sections = dict(
        re.findall(r"\n((?:atpid|python -m studies) [a-z0-9 -]+)¶\n(.*?)(?=\n[^\n]+¶\n|\Z)", text, re.DOTALL)
    )
    expected = options_of("atpid", ATPID) | options_of("python -m studies", STUDIES)
    assert sections.keys() == expected.keys()
    assert {name: {o for o in options if o not in sections[name]} for name, options in expected.items()} == {
        name: set() for name in expected
    }
    print(f"{len(expected)} commands, {sum(map(len, expected.values()))} options")


@pytest.mark.slow
def test_every_message_is_there_with_its_fields(site: Path) -> None:
    text = text_of(site / "docs/messages.html")
    definitions = sorted(path for kind in ("msg", "srv", "action") for path in INTERFACES.glob(f"{kind}/*.{kind}"))
    assert [path.stem for path in definitions if f"\n{path.stem}¶" not in text] == []
    for path in definitions:
        section = text.partition(f"\n{path.stem}¶")[2].partition("¶\n")[0]
        fields = re.findall(r"^[\w/]+(?:\[\])?\s+(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert [field for field in fields if not re.search(rf"\b{field}\b", section)] == [], path.name
    print(f"{len(definitions)} definitions")


@pytest.mark.slow
def test_every_parameter_is_there(site: Path) -> None:
    text = text_of(site / "docs/parameters.html")
    declared = [row.name for table in SECTIONS.values() for row in table]
    assert [name for name in declared if f"\n{name}\n" not in text] == []
    print(f"{len(declared)} parameters")


@pytest.mark.slow
def test_every_public_function_is_there(site: Path) -> None:
    documented = {anchor.rpartition(".")[2] for anchor in anchored(site / "docs/python_api.html") if "." in anchor}
    public = {name for name in dir(atpid_sim) if name != "__version__"} | set(atpid_control.__all__)
    assert public - documented == set()
    print(f"{len(public)} functions and classes")


@pytest.mark.slow
def test_every_page_of_the_documentation_and_every_changelog_is_there(site: Path) -> None:
    written = [*PAGES, *ROOT.glob("docs/decisions/*.md"), *ROOT.glob("atpid_*/**/CHANGELOG.rst")]
    pages = [site / path.relative_to(ROOT).with_suffix(".html") for path in written]
    assert [page for page in pages if not page.is_file()] == []


@pytest.mark.slow
def test_every_link_and_anchor_of_the_site_leads_somewhere(site: Path) -> None:
    pages = {page.resolve(): anchored(page) for page in site.rglob("*.html")}
    broken = []
    for page in pages:
        body = page.read_text(encoding="utf-8").partition("<article")[2]
        for target in re.findall(r'(?:href|src)="([^"]+)"', body):
            parts = urlsplit(html.unescape(target))
            if parts.scheme:
                continue  # `test_an_external_link_is_an_address`
            place = (page.parent / parts.path).resolve() if parts.path else page
            if not place.exists() or (parts.fragment and place in pages and parts.fragment not in pages[place]):
                broken.append((page.name, target))
    assert broken == []


@pytest.mark.slow
def test_the_version_is_shown_beside_the_others(site: Path) -> None:
    assert "1.2.3" in (site.parent / "versions.js").read_text(encoding="utf-8")
    assert "1.2.3/README.html" in (site.parent / "index.html").read_text(encoding="utf-8")
    assert "<option>1.2.3</option>" in (site / "docs/stand.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_index_of_the_search_has_these_words(site: Path) -> None:
    index = json.loads((site / "searchindex.js").read_text(encoding="utf-8").partition("(")[2].rpartition(")")[0])
    for word, page in SEARCHED.items():
        found = set()
        for terms in (index["terms"], index["titleterms"]):
            for stem in (term for term in terms if word.lower().startswith(term) and len(term) > 5):
                found |= {terms[stem]} if isinstance(terms[stem], int) else set(terms[stem])
        assert page in {index["docnames"][number] for number in found}, word


@pytest.mark.slow
def test_a_browser_finds_these_words_and_shows_pages_on_any_screen(site: Path) -> None:
    seen = visited(site)
    for word, page in SEARCHED.items():
        assert any(f"{page}.html" in target for target in seen["found"][word]), word
    assert seen["wrong"] == {}


def visited(site: Path) -> dict[str, dict[str, list[str]]]:
    """Return what was seen with Chromium; skips the test where it is missing."""
    chromium = shutil.which("chromium")
    if chromium is None or importlib.util.find_spec("playwright") is None:
        pytest.skip("left out: a browser draws the page; Chromium or playwright is missing: sudo make browser")
    command = [sys.executable, str(ROOT / "tests/site_visit.py"), chromium, str(site), *SEARCHED]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=500.0)
    assert done.returncode == 0, done.stderr
    seen: dict[str, dict[str, list[str]]] = json.loads(done.stdout)
    return seen


@pytest.mark.slow
def test_the_modules_of_nodes_are_read_without_ros_as_rosdoc2_does() -> None:
    if not (SPHINX / "sphinx").is_dir():
        pytest.skip("Sphinx is missing: make docs-packages")
    program = f"""
import importlib, pkgutil, sys
sys.path.insert(0, {str(SPHINX)!r})
from sphinx.ext.autodoc.mock import mock
with mock({MOCKED!r}):
    for package in ("atpid_common", "atpid_sim", "atpid_driver", "atpid_control"):
        for each in pkgutil.iter_modules(importlib.import_module(f"{{package}}.nodes").__path__):
            importlib.import_module(f"{{package}}.nodes.{{each.name}}")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_an_external_link_is_an_address() -> None:
    texts = {page.name: page.read_text(encoding="utf-8") for page in [*PAGES, *ROOT.glob("docs/decisions/*.md")]}
    links = [(page, link) for page, text in texts.items() for link in re.findall(r"\]\((\w+:[^)\s]*)\)", text)]
    assert links != []
    wrong = [(page, link) for page, link in links if not re.fullmatch(r"https?://[\w.-]+\.\w+(/[^\s<>\"]*)?", link)]
    assert wrong == []


@functools.cache
def citation() -> dict[str, object]:
    read: dict[str, object] = yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), yaml.BaseLoader)
    return read


def test_the_citation_names_this_version_and_the_thesis() -> None:
    # The keys that the Citation File Format 1.2.0 requires, of the file and of a reference.
    cited = citation()
    assert {"cff-version", "message", "title", "authors"} <= cited.keys()
    assert (cited["cff-version"], cited["type"], cited["license"]) == ("1.2.0", "software", "Apache-2.0")
    assert cited["authors"] == [{"name": "ATPID contributors"}]
    released = re.search(r"^(\S+) \((\S+)\)$", (ROOT / "atpid_sim/CHANGELOG.rst").read_text(encoding="utf-8"), re.M)
    assert released is not None
    assert (cited["version"], cited["date-released"]) == released.groups()
    assert cited["version"] == atpid_sim.__version__
    assert isinstance(cited["references"], list)
    (thesis,) = cited["references"]
    assert {"authors", "title", "type"} <= thesis.keys()
    assert thesis["type"] == "thesis"
    assert thesis["title"] in (ROOT / "README.md").read_text(encoding="utf-8").replace("\n", " ")
