# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The extensions of this project beside the core: what each brings is found, and named where it is not installed."""

import json
import re
from importlib import metadata
from pathlib import Path

import pytest

from atpid_common.cli import GROUP
from atpid_common.testing import install
from atpid_control import cli
from atpid_control.stand.parameters import BenchError
from atpid_control.stand.parts import EXCITER, AddedPart, added_part, is_installed, table_of
from atpid_control.stand.parts import GROUP as NODES_GROUP


def brought(root: Path, name: str = "extensions") -> dict[str, str]:
    read: dict[str, str] = json.loads((root / f"atpid_control/atpid_control/data/{name}.json").read_text())
    return read


def test_the_core_has_the_package_of_every_command_of_an_extension(root: Path) -> None:
    names = {path.parent.name for path in root.glob("extensions/*/package.xml")}
    tables = {entry.name: entry.load() for entry in metadata.entry_points(group=GROUP) if entry.name in names}
    found = {name: package for package, table in tables.items() for group in table.values() for name in group}
    assert found == brought(root)


def test_a_command_that_is_not_installed_is_answered_with_its_package(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "commands", lambda: cli.COMMANDS)
    for name, package in brought(root).items():
        assert cli.main([*name.split(), "--help"]) == 2
        assert f"`atpid {name}` comes with the package {package}" in capsys.readouterr().err
    assert cli.main(["simulat"]) == 2
    assert "comes with" not in capsys.readouterr().err


def test_the_core_has_the_package_of_every_node_of_an_extension(root: Path) -> None:
    names = {path.parent.name for path in root.glob("extensions/*/package.xml")}
    parts = [added_part(name) for name in {entry.name for entry in metadata.entry_points(group=NODES_GROUP)}]
    assert {part.part.name: part.part.package for part in parts if part.part.package in names} == brought(root, "nodes")
    assert {row.name for row in table_of(EXCITER)} >= {"backend", "supervised", "highest_amplitude"}


def test_a_commanded_excitation_that_no_package_puts_out_is_answered_with_its_package(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    added_part.cache_clear()  # what raises is not kept
    monkeypatch.setattr("atpid_common.entry_points.entry_points", lambda group: ())
    scene = (root / "scenes/stand_realtime.yaml").read_text()
    commanded = "excitation: {commanded: true, amplitude: 0.01, frequency: 5.4}"
    (tmp_path / "scene.yaml").write_text(re.sub(r"^excitation:.*(\n .*)*", commanded, scene, flags=re.MULTILINE))
    (tmp_path / "excitation.yaml").write_text("/**/excitation_node: {ros__parameters: {backend: simulated}}")
    bench = ["bench", str(tmp_path / "scene.yaml"), "--out", str(tmp_path / "out")]
    stand = ["stand", bench[1], "--excitation-config", str(tmp_path / "excitation.yaml")]
    for words in (bench, [*bench, "--emulated-stand"], stand):
        assert cli.main(words) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{EXCITER} comes with the package {brought(root, 'nodes')[EXCITER]}" in line
    assert not (tmp_path / "out").exists()
    assert not is_installed(EXCITER)


def test_what_a_package_adds_has_to_be_a_part_and_one_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    added_part.cache_clear()
    with pytest.raises(BenchError, match="no installed package has pump_node"):
        added_part("pump_node")
    for entry, text in (
        ("valve_node = with_a_number:PART", rf"with_a_number:PART is a int: .*{AddedPart.__name__}"),
        (f"{EXCITER} = with_a_number:PART", "its name is taken"),
    ):
        install(tmp_path, monkeypatch, f"[{NODES_GROUP}]\n{entry}\n", with_a_number="PART = 1")
        with pytest.raises(BenchError, match=text):
            added_part(entry.partition(" ")[0])
