# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Exit statuses and one-line errors of the command lines."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn

import pytest

from atpid_common.cli import GROUP, Command, Commands, guarded, is_among, run_commands, with_installed
from atpid_common.errors import AtpidError, InputError, NumericalError
from atpid_common.testing import install

COMMANDS = {
    "Measure": {"measure": ("measuring", "measure something"), "other": ("no_such_module", "do something else")},
    "Look": {"bag show": ("measuring:inner", "show a bag")},
}


def called(*words: str) -> int:
    return run_commands("package", "Text.", COMMANDS, words)


@pytest.fixture
def measuring(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command's module: `measure --times N` returns N."""
    module = SimpleNamespace(
        add_arguments=lambda parser: parser.add_argument("--times", type=int, default=0),
        run=lambda arguments: arguments.times,
        EXAMPLE="--times 3",
        inner=Command(lambda parser: None, lambda arguments: 5, ""),
    )
    monkeypatch.setitem(sys.modules, "measuring", module)


def fails(error: BaseException) -> Callable[..., int]:
    def run(*_: object) -> NoReturn:
        raise error

    return run


@pytest.mark.usefixtures("measuring")
def test_a_command_gets_its_arguments_and_gives_the_status() -> None:
    assert called("measure", "--times", "3") == 3
    assert called("bag", "show") == 5
    assert called("bag") == 2
    assert called("bag", "--help") == 0


@pytest.mark.usefixtures("measuring")
@pytest.mark.parametrize("given", [[], ["nothing"], ["measure", "--unknown"]])
def test_arguments_that_do_not_fit_are_bad_input(capsys: pytest.CaptureFixture[str], given: list[str]) -> None:
    assert called(*given) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("error: ")
    assert printed.count("\n") == 1
    assert " package " in printed
    assert "--help" in printed


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InputError("amplitude: -1"), 2, "error: amplitude: -1"),
        (NumericalError("diverged"), 3, "error: diverged"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (KeyboardInterrupt("closed"), 130, "closed"),
    ],
)
def test_errors_of_the_project_are_one_line(
    capsys: pytest.CaptureFixture[str], error: BaseException, status: int, line: str
) -> None:
    assert guarded(fails(error)) == status
    assert capsys.readouterr().err == f"{line}\n"


@pytest.mark.parametrize(
    "error", [ValueError("defect"), ZeroDivisionError("defect"), OSError("defect"), ImportError("defect", name="own")]
)
def test_other_errors_keep_their_traceback(error: Exception) -> None:
    with pytest.raises(type(error), match="defect"):
        guarded(fails(error))


@pytest.mark.parametrize(("module", "install"), [("labjack.ljm", "labjack-ljm"), ("pydantic", "pydantic>=2")])
def test_a_missing_library_names_what_to_install(module: str, install: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert guarded(fails(ImportError("none", name=module))) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("error: ")
    assert printed.endswith(f" '{install}'\n")
    assert printed.count("\n") == 1


def test_an_installed_package_adds_commands_and_replaces_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own: Commands = {"Read": {"look": ("own.look", "look at it")}}
    table = {"Read": {"look": ("others.look", "otherwise"), "count": ("others.count", "count it")}, "Draw": {}}
    install(tmp_path, monkeypatch, f"[{GROUP}]\nothers = others:COMMANDS\n", others=f"COMMANDS = {table!r}\n")
    found = with_installed(own)
    assert found["Read"] == {"look": ("own.look", "look at it"), "count": ("others.count", "count it")}
    assert "Draw" not in found
    assert is_among(found, ["count", "--all"])
    for module in ("missing", "broken"):
        install(tmp_path, monkeypatch, f"[{GROUP}]\nothers = {module}:COMMANDS\n", broken="raise ValueError")
        with pytest.raises(AtpidError, match=rf"others \({module}:COMMANDS .*: cannot be loaded: .*Error"):
            with_installed(own)
