# SPDX-License-Identifier: Apache-2.0
"""The worst case over a box of uncertain quantities: its corners, random points inside, the systems there."""

from atpid_sim.robust.box import adverse, corners, inside, with_beam, with_restitution
from atpid_sim.robust.worst_case import Response, lowest_best

__all__ = ["Response", "adverse", "corners", "inside", "lowest_best", "with_beam", "with_restitution"]
