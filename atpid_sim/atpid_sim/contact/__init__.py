# SPDX-License-Identifier: Apache-2.0
"""Contact laws: the force between grain and walls, one small file per law (docs/contact.md)."""

from __future__ import annotations

from atpid_sim.contact.registry import LAWS, Contact, contact_of, restitution_of

__all__ = ["LAWS", "Contact", "contact_of", "restitution_of"]
