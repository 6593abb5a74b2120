# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contact laws: one module of this folder each. A law's number is its place in this list."""

from importlib import import_module
from types import ModuleType

NAMES = (
    "impact",
    "linear",
    "hertz",
    "lee_herrmann",
    "kuwabara_kono",
    "tsuji",
    "walton_braun",
)

LAWS: tuple[ModuleType, ...] = tuple(import_module(f"atpid_sim.contact.{name}") for name in NAMES)
IMPACT = NAMES.index("impact")
#: By number: whether the force depends on the deepest overlap of the contact.
HYSTERETIC: tuple[bool, ...] = tuple(getattr(law, "HYSTERETIC", False) for law in LAWS)
