# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Height selection: one protocol, one small file a method, chosen by name from the registry."""

from atpid_control.selection.protocol import Excitation, HeightSelector, Options, Selection, SelectionError
from atpid_control.selection.registry import make_selector

__all__ = ["Excitation", "HeightSelector", "Options", "Selection", "SelectionError", "make_selector"]
