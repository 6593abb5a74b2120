# SPDX-License-Identifier: Apache-2.0
"""The nearest match of a mistyped word."""

from collections.abc import Iterable

#: Least similarity of the two words [-]: below it a hint misleads (`difflib.get_close_matches`).
_LEAST = 0.5


def did_you_mean(given: str, allowed: Iterable[str]) -> str:
    """Return "; did you mean X?" with the word of `allowed` most like `given`, "" where none is like it."""
    import difflib  # only where a word was wrong: commands start without it

    near = difflib.get_close_matches(given, list(allowed), n=1, cutoff=_LEAST)
    return f"; did you mean {near[0]}?" if near else ""
