# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stubs have the fields of the messages as rosidl makes them, so that mypy finds a misspelt one."""

import pytest
from atpid_interfaces import action, msg, srv
from message_stubs import STUBS, stubs


@pytest.mark.parametrize("name", stubs())
def test_a_stub_file_is_what_the_script_writes(name: str) -> None:
    assert (STUBS / name).read_text() == stubs()[name], "make it anew: python tests/message_stubs.py"


def test_they_have_the_classes_and_fields_of_the_messages() -> None:
    made = stubs()
    for kind, module, parts in (
        ("msg", msg, ("",)), ("srv", srv, ("Request", "Response")), ("action", action, ("Goal", "Result", "Feedback")),
    ):  # fmt: skip
        blocks = made[f"{kind}.pyi"].split("\nclass ")[1:]
        assert len(blocks) >= 1
        for block in blocks:
            owner = getattr(module, block.partition(":")[0])
            for part in parts:
                fields = (getattr(owner, part) if part else owner).get_fields_and_field_types()
                head = f"class {part}:" if part else block
                (line,) = [line for line in block[block.index(head) :].splitlines() if "def __init__" in line][:1]
                named = [word.partition(":")[0] for word in line.partition("(self, *, ")[2].split(" = ...")[:-1]]
                assert [name.lstrip(", ") for name in named] == list(fields)
