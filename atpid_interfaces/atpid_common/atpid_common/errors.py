# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The errors that are reported to the user in one line instead of a traceback, and the hint at a mistyped word."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType

DONE, BROKEN_PIPE, BAD_INPUT, NUMERICAL_FAILURE, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses of commands and nodes. 1 after a broken pipe is what the Python documentation advises."""


#: Longest text of an error: what was given may be a whole file.
_LONGEST = 2000
#: Least similarity of two words [-]: below it a hint misleads, as from "foo" to "motor" (`difflib.get_close_matches`).
_LEAST = 0.6


def one_line(text: str) -> str:
    """Return a text as it is printed in one line: what a user gave may hold line breaks and control characters."""
    shown = text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 2 :]}"
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in shown)


def did_you_mean(given: str, allowed: Iterable[str], places: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return "; did you mean X?" with the word of `allowed` or `places` most like `given`, "" where none is like it.

    X is the word itself, of `places` what it stands for.
    """
    import difflib  # only where a word was wrong: commands start without it

    # a single character is like any short word that has it
    words = [*allowed, *places] if len(given) > 1 else []
    near = difflib.get_close_matches(given, words, n=1, cutoff=_LEAST)
    return f"; did you mean {places.get(near[0], near[0])}?" if near else ""


class AtpidError(Exception):
    """An error with a one-line text for the user and an exit status."""

    status = BAD_INPUT

    def __str__(self) -> str:
        """Return the text, in one line whatever it quotes."""
        return one_line(super().__str__())


class InputError(AtpidError, ValueError):
    """Bad input: the text states what was given, what is allowed and what to do."""


#: Libraries that a distribution of ROS does not bring, or only older ones of: what pip calls them, by module.
_AS_IMPORTED = "distributed h5py matplotlib mcap plotly pyarrow pyuff rosbags shtab xarray zstandard"
EXTRAS = {name: name for name in _AS_IMPORTED.split()}
EXTRAS |= {"foxglove": "foxglove-sdk", "grpc": "grpcio", "labjack": "labjack-ljm", "nidaqmx": "nidaqmx[grpc]"}
EXTRAS |= {"nptdms": "npTDMS", "pydantic": "pydantic>=2"}


@contextmanager
def extras(purpose: str = "", error: type[AtpidError] = InputError) -> Iterator[None]:
    """Raise `error` in one line, which names what to install, where a library of `EXTRAS` cannot be imported."""
    try:
        yield
    except ImportError as missing:
        module = (missing.name or "").partition(".")[0]
        if module not in EXTRAS:
            raise
        library = EXTRAS[module]
        text = f"{purpose}{': ' * bool(purpose)}needs {library}, which is not installed: pip install '{library}'"
        raise error(text) from None


def not_installed(package: str) -> str:
    """Return in words that a package of this project is missing, and how it is installed."""
    return f"the package {package}, which is not installed: colcon build --packages-select {package}, or `make setup`"


class NumericalError(AtpidError, ArithmeticError):
    """A computation that failed; its result does not exist or cannot be trusted."""

    status = NUMERICAL_FAILURE
