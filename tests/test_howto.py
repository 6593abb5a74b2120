# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pages docs/howto_*.md as a reader follows them: their files, their tests, and what then runs."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from documented import ROOT, blocks

from atpid_control.stand.domain import own_domain

#: A block of code, and the last file named before it.
FILE = re.compile(r"`([\w.]+\.(?:py|toml|yaml))`(?:(?!```).)*?^```\w+\n(.*?)^```", re.DOTALL | re.MULTILINE)
#: Describes a package as pip does that installs it.
DESCRIBE = ["python", "-c", "from setuptools import setup; setup()", "-q", "egg_info"]
RESTITUTION = """
from atpid_sim.kernel_inputs import contact_of, restitution_of
from atpid_sim.scene import load_scene
scene = load_scene("scenes/standard.yaml").with_(contact={})
print(scene.contact.law, restitution_of(contact_of(scene), 1.0, 0.03))
"""


def page(name: str) -> Path:
    return ROOT / f"docs/howto_{name}.md"


def typed(name: str) -> list[list[str]]:
    """Return the commands of a page."""
    lines = re.findall(r"^    ((?:python|atpid) .*)$", page(name).read_text(encoding="utf-8"), re.MULTILINE)
    return [shlex.split(line) for line in lines]


def write_files(name: str, folder: Path) -> set[str]:
    """Write the files of a page to the reader's folder; return their names."""
    found = dict(FILE.findall(page(name).read_text(encoding="utf-8")))
    for file, text in found.items():
        (folder / file).write_text(text, encoding="utf-8")
    return set(found)


def environment(first: Path, **variables: str) -> dict[str, str]:
    """Return an environment in which what is in a folder is imported before anything else."""
    places = [str(first), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(places)} | variables


def run(words: list[str], folder: Path, variables: dict[str, str]) -> str:
    """Run a command to its end; return what it prints."""
    program = sys.executable if words[0] == "python" else words[0]
    done = subprocess.run([program, *words[1:]], cwd=folder, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def first_message(started: list[list[str]], echo: list[str], folder: Path) -> Any:
    """Start programs, print the first message they publish and end them; return it."""
    processes = []
    with own_domain() as number:
        variables = environment(folder, ROS_DOMAIN_ID=str(number))
        try:
            processes = [subprocess.Popen(words, cwd=folder, env=variables) for words in started]
            printed = run(echo, folder, variables)
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            statuses = [process.wait() for process in processes]
    assert statuses[-1] == 0  # of the project's node
    return yaml.safe_load(printed.removesuffix("---\n"))


def test_a_contact_law_passes_the_general_tests_and_a_scene_takes_it(tmp_path: Path) -> None:
    """In a copy of the package: one file, one line, its test."""
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    shutil.copytree(ROOT / "atpid_sim", tmp_path / "atpid_sim", ignore=shutil.ignore_patterns("__pycache__"))
    (file,), (line,), (scene,) = (blocks(page("contact_law"), language) for language in ("py", "text", "yaml"))
    contact = tmp_path / "atpid_sim/atpid_sim/contact"
    (contact / "hunt_crossley.py").write_text(file, encoding="utf-8")
    laws = (contact / "laws.py").read_text(encoding="utf-8")
    before, last, after = laws.partition('    "walton_braun",\n')
    (contact / "laws.py").write_text(before + last + line + after, encoding="utf-8")
    variables = environment(tmp_path / "atpid_sim", NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    (test,) = typed("contact_law")
    assert re.search(r"^6 passed", run([*test, "-p", "no:cacheprovider"], tmp_path, variables), re.MULTILINE)
    given = yaml.safe_load(scene.replace("2.1e8", "2.1e+8"))["contact"]
    program = RESTITUTION.replace("contact={}", f"contact={given}")
    law, e = run(["python", "-c", program], tmp_path, variables).split()
    assert law == "hunt_crossley"
    assert float(e) == pytest.approx(0.7484, abs=1e-4)  # root of 0.5 (1 + e) = ln(1.5 / (1 - 0.5 e))


def test_a_selector_in_a_package_of_its_own_is_found_and_used(tmp_path: Path) -> None:
    write_files("selector", tmp_path)
    variables = environment(tmp_path)
    run(DESCRIBE, tmp_path, variables)
    test, select, bench = typed("selector")
    assert "1 passed" in run([*test, "-p", "no:cacheprovider"], tmp_path, variables)
    chosen = json.loads(run([*select, "--json"], tmp_path, variables))
    assert (chosen["method"], chosen["height"]) == ("proportional", pytest.approx(0.017 + 18.0 * 0.015))
    run(bench, tmp_path, variables)
    (stage,) = json.loads((tmp_path / "out/proportional/summary.json").read_text())["stages"]
    assert stage["height"] == pytest.approx(chosen["height"], rel=0.01)
    assert stage["efficiency"] > 0.7


def test_samples_of_a_driver_of_another_package_arrive(tmp_path: Path) -> None:
    assert write_files("driver", tmp_path) == {"driver.py", "driver.yaml"}
    driver, node, echo = typed("driver")
    block = first_message([driver, node], echo, tmp_path)
    assert (block["device"], block["units"]) == ("their/data:0", ["m/s^2", "m/s^2"])
    assert block["rate"] == pytest.approx(200.0, rel=0.02)
    assert max(map(abs, block["data"])) <= 98.1
    assert block["data"][0] == -block["data"][1]


def test_a_sensor_passes_the_contract_and_its_samples_arrive(tmp_path: Path) -> None:
    files = {"load_cell.py", "pyproject.toml", "test_load_cell.py", "force.yaml", "node.yaml"}
    assert write_files("sensor", tmp_path) == files
    test, _, node, echo = typed("sensor")
    assert "7 passed" in run([*test, "-p", "no:cacheprovider"], tmp_path, environment(tmp_path))
    run(DESCRIBE, tmp_path, environment(tmp_path))  # in place of the page's installation
    block = first_message([node], echo, tmp_path)
    assert (block["device"], block["channels"], block["units"]) == ("load-cell:4711", ["force"], ["N"])
    assert (block["rate"], len(block["data"]), block["dropped"]) == (500.0, 25, 0)
    index = [block["first_index"] + k for k in range(25)]
    assert block["data"] == pytest.approx([400.0 * abs(k / 500.0 % 1.0 - 0.5) for k in index])
