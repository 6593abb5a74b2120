# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What packages add by entry points, for every group alike: what cannot be used is refused in one line."""

import sys
from pathlib import Path

import pytest

from atpid_common.entry_points import installed, loaded
from atpid_common.errors import InputError
from atpid_common.testing import install

GROUP = "atpid.of_tests"


@pytest.mark.parametrize(
    ("entries", "text", "line"),
    [
        ("own = added:X\nown = another:X", "", r"\(another:X of of_a_test 1\.0\), .*atpid\.of_tests: .* by added:X;"),
        ("built = added:X", "", "built .* taken by what is built in;"),
        ("own = added:X", "", "own .* AttributeError: "),
        ("own = added:X", "import no_such_module_here", "own .* ModuleNotFoundError: .*'no_such_module_here'"),
        ("own = added:X", "raise ValueError('two\\nlines')", "own .* ValueError: two lines;"),
        ("own = added:X", "X = 1", "own .*: lacks name, read;"),
    ],
)
def test_what_cannot_be_used_is_one_line_of_the_callers_error(
    entries: str, text: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "added", raising=False)
    install(tmp_path, monkeypatch, f"[{GROUP}]\n{entries}\n", added=text)
    with pytest.raises(InputError, match=rf"^[^\n]*{line}[^\n]*$"):
        loaded(installed(GROUP, ["built"], InputError)["own"], ["name", "read"], InputError)
