# SPDX-License-Identifier: Apache-2.0
"""The methods others use, on the same right-hand side, for comparison only."""

from __future__ import annotations

from atpid_sim import kernel_cache as kernel_cache
from atpid_sim.peers.methods import PEERS
from atpid_sim.peers.run import PeerResult, run_peer
from atpid_sim.peers.task import PeerError

__all__ = ["PEERS", "PeerError", "PeerResult", "run_peer"]
