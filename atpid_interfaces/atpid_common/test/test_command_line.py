# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Exit statuses and one-line errors of the command lines."""

import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import NoReturn

import pytest

from atpid_common.cli import Command, guarded, run_commands
from atpid_common.errors import InputError, NumericalError

COMMANDS = {
    "Measure": {"measure": ("measuring", "measure something"), "other": ("no_such_module", "do something else")},
    "Look": {"bag show": ("measuring:inner", "show a bag")},
}


@pytest.fixture
def measuring(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A command's module: `measure --times N` returns N."""
    module = SimpleNamespace(
        add_arguments=lambda parser: parser.add_argument("--times", type=int, default=0),
        run=lambda arguments: arguments.times,
        EXAMPLE="--times 3",
    )
    module.inner = Command(lambda parser: None, lambda arguments: 5, "")
    monkeypatch.setitem(sys.modules, "measuring", module)
    return module


def fails(error: BaseException) -> Callable[..., int]:
    def run(*_: object) -> NoReturn:
        raise error

    return run


def test_a_command_gets_its_arguments_and_gives_the_status(measuring: SimpleNamespace) -> None:
    assert run_commands("package", "Text.", COMMANDS, ["measure", "--times", "3"]) == 3


def test_a_command_of_a_group_is_an_object_of_a_module(measuring: SimpleNamespace) -> None:
    assert run_commands("package", "Text.", COMMANDS, ["bag", "show"]) == 5
    assert run_commands("package", "Text.", COMMANDS, ["bag"]) == 2
    assert run_commands("package", "Text.", COMMANDS, ["bag", "--help"]) == 0


def test_help_lists_the_commands_without_loading_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_commands("package", "Text.", COMMANDS, ["--help"]) == 0
    output = capsys.readouterr().out
    assert "measure something" in output
    assert "do something else" in output
    assert output.index("Measure:") < output.index("Look:") < output.index("bag show")


@pytest.mark.parametrize("given", [[], ["nothing"], ["measure", "--unknown"]])
def test_arguments_that_do_not_fit_are_bad_input(
    measuring: SimpleNamespace, capsys: pytest.CaptureFixture[str], given: list[str]
) -> None:
    assert run_commands("package", "Text.", COMMANDS, given) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("error: ")
    assert printed.count("\n") == 1
    assert "what it takes: package" in printed


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InputError("amplitude: given -1; allowed: above 0 m"), 2, "error: amplitude: given -1; allowed: above 0 m"),
        (NumericalError("no steady state"), 3, "error: no steady state"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (KeyboardInterrupt("the bag is closed"), 130, "the bag is closed"),
    ],
)
def test_errors_of_the_project_are_one_line(
    capsys: pytest.CaptureFixture[str], error: BaseException, status: int, line: str
) -> None:
    assert guarded(fails(error)) == status
    assert capsys.readouterr().err == f"{line}\n"


@pytest.mark.parametrize("error", [ValueError("a defect"), ZeroDivisionError("a defect"), OSError("a defect")])
def test_other_errors_keep_their_traceback(error: BaseException) -> None:
    with pytest.raises(type(error), match="a defect"):
        guarded(fails(error))


@pytest.mark.parametrize(("module", "install"), [("labjack.ljm", "labjack-ljm"), ("pydantic", "pydantic>=2")])
def test_a_library_that_is_missing_is_named_with_what_to_install(
    module: str, install: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def command() -> NoReturn:
        raise ImportError("none", name=module)

    assert guarded(command) == 2
    assert capsys.readouterr().err == f"error: needs {install}, which is not installed: pip install '{install}'\n"


def test_another_module_that_is_missing_is_a_defect() -> None:
    def command() -> NoReturn:
        raise ModuleNotFoundError("none", name="atpid_nothing")

    with pytest.raises(ModuleNotFoundError):
        guarded(command)
