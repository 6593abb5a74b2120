# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact laws: the force between grain and walls, one file per law (docs/contact.md)."""
