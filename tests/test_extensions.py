# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The extensions of this project beside the core: what each brings is found, and named where it is not installed."""

import json
from importlib import metadata
from pathlib import Path

import pytest

from atpid_common.cli import GROUP
from atpid_control import cli


def brought(root: Path) -> dict[str, str]:
    read: dict[str, str] = json.loads((root / "atpid_control/atpid_control/data/extensions.json").read_text())
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
