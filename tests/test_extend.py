# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page docs/extend.md as a reader follows it: its package, typed, formatted, tested and used."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from documented import ROOT, blocks

from atpid_control.stand.domain import own_domain

PAGE = ROOT / "docs/extend.md"
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
#: Of another package, which the reader has already.
OTHERS = ("driver.py", "driver.yaml")
#: Lines of the package, its tests included.
MOST = 250


def typed(beginning: str) -> list[str]:
    """Return the command of the page that begins so."""
    (line,) = (line for line in re.findall(r"^    (.*)$", PAGE.read_text(), re.MULTILINE) if line.startswith(beginning))
    return shlex.split(line)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reader's folder, with the files of the page, and the package described."""
    made = tmp_path_factory.mktemp("reader")
    for place in ("bags", "scenes"):
        (made / place).symlink_to(ROOT / place)
    for file, text in FILE.findall(PAGE.read_text(encoding="utf-8")):
        (made / file).write_text(text, encoding="utf-8")
    run(DESCRIBE, made)
    return made


def environment(folder: Path, **variables: str) -> dict[str, str]:
    """Return an environment in which what is in the folder is installed, with kernels of its own."""
    places = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    cache = {"NUMBA_CACHE_DIR": str(folder / "cache")}
    return os.environ | cache | {"PYTHONPATH": os.pathsep.join(places)} | variables


def run(words: list[str], folder: Path, **variables: str) -> str:
    """Run a command to its end; return what it prints."""
    program = sys.executable if words[0] == "python" else words[0]
    given = environment(folder, **variables)
    done = subprocess.run([program, *words[1:]], cwd=folder, env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def first_message(started: list[list[str]], echo: list[str], folder: Path) -> Any:
    """Start programs, print the first message they publish and end them; return it."""
    processes = []
    with own_domain() as number:
        variables = {"ROS_DOMAIN_ID": str(number)}
        try:
            processes = [
                subprocess.Popen([sys.executable, *words[1:]], cwd=folder, env=environment(folder, **variables))
                for words in started
            ]
            printed = run(echo, folder, **variables)
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            statuses = [process.wait() for process in processes]
    assert statuses[-1] == 0  # of the project's node
    return yaml.safe_load(printed.removesuffix("---\n"))


def test_the_package_is_short_typed_and_formatted(folder: Path) -> None:
    code = sorted(str(path) for path in folder.glob("*.py") if path.name not in OTHERS)
    assert len(code) == 6
    assert sum(Path(file).read_text().count("\n") for file in [*code, str(folder / "pyproject.toml")]) < MOST
    run(["ruff", "format", "--check", "--no-cache", "--line-length", "120", *code], ROOT)
    run(["ruff", "check", "--no-cache", "--select", "E,F,I,UP,B", *code], ROOT)
    run(["mypy", "--cache-dir", str(folder / "mypy"), *code], ROOT)


def test_each_part_passes_the_contract_of_its_role(folder: Path) -> None:
    test = typed("python -m pytest")
    assert re.search(r"^\d+ passed", run([*test, "-p", "no:cacheprovider"], folder), re.MULTILINE)


def test_command_and_selector_are_found_and_used(folder: Path) -> None:
    assert re.fullmatch(r"0\.\d{4} m\n", run(typed("atpid largest"), folder))
    assert "largest" in run(["atpid", "--help"], folder)
    chosen = json.loads(run([*typed("atpid select"), "--json"], folder))
    assert (chosen["method"], chosen["height"]) == ("proportional", pytest.approx(0.017 + 18.0 * 0.03))


def test_a_scene_takes_the_contact_law(folder: Path) -> None:
    (scene,) = (text for text in blocks(PAGE, "yaml") if text.startswith("contact:"))
    given = yaml.safe_load(scene.replace("2.1e8", "2.1e+8"))["contact"]
    law, e = run(["python", "-c", RESTITUTION.replace("contact={}", f"contact={given}")], folder).split()
    assert law == "hunt_crossley"
    assert float(e) == pytest.approx(0.7484, abs=1e-4)  # root of 0.5 (1 + e) = ln(1.5 / (1 - 0.5 e))


def test_files_of_the_format_become_a_bag(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "one.pairs"
    path.write_text("".join(f"{0.002 * k:g} {1e-3 * (k % 7):g}\n" for k in range(500)))
    run(["atpid", "bag", "import", str(path), "--out", str(tmp_path / "bag")], folder)
    assert (tmp_path / "bag" / "metadata.yaml").is_file()


def test_samples_of_the_sensor_arrive(folder: Path) -> None:
    node = typed("python -m atpid_driver.nodes.acquisition_node --ros-args -r __node:=force")
    block = first_message([node], typed("atpid ros echo /sensors/force"), folder)
    assert (block["device"], block["channels"], block["units"]) == ("load-cell:4711", ["force"], ["N"])
    assert (block["rate"], len(block["data"]), block["dropped"]) == (500.0, 25, 0)
    index = [block["first_index"] + k for k in range(25)]
    assert block["data"] == pytest.approx([400.0 * abs(k / 500.0 % 1.0 - 0.5) for k in index])


def test_samples_of_a_driver_of_another_package_arrive(folder: Path) -> None:
    node = typed("python -m atpid_driver.nodes.acquisition_node --ros-args -r __node:=their_sensor")
    block = first_message([typed("python driver.py"), node], typed("atpid ros echo /sensors/accelerometer"), folder)
    assert (block["device"], block["units"]) == ("their/data:0", ["m/s^2", "m/s^2"])
    assert block["rate"] == pytest.approx(200.0, rel=0.02)
    assert max(map(abs, block["data"])) <= 98.1
    assert block["data"][0] == -block["data"][1]
