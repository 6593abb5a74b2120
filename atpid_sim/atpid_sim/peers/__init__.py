# SPDX-License-Identifier: Apache-2.0
"""The methods others use, on the same right-hand side, for comparison only."""

from __future__ import annotations

from atpid_sim.peers.run import PEERS, PeerError, PeerResult, run_peer

__all__ = ["PEERS", "PeerError", "PeerResult", "run_peer"]
