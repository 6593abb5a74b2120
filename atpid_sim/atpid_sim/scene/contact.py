# SPDX-License-Identifier: Apache-2.0
"""The contact block of a scene: one variant per law, as the laws' files describe their keys."""

from __future__ import annotations

import functools
import operator
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Discriminator, Tag

from atpid_sim.contact.laws import LAWS, NAMES
from atpid_sim.contact.spec import ContactSpec


def _law(value: Any) -> str | None:
    law = value.get("law") if isinstance(value, Mapping) else getattr(value, "law", None)
    return f"<{law}>" if law in NAMES else None


_SPECS = [Annotated[law.Spec, Tag(f"<{name}>")] for name, law in zip(NAMES, LAWS, strict=True)]

if TYPE_CHECKING:
    ContactBlock = ContactSpec
else:
    ContactBlock = Annotated[
        functools.reduce(operator.or_, _SPECS),
        Discriminator(_law, custom_error_type="no_law", custom_error_message=f"law: one of {', '.join(NAMES)}"),
    ]
