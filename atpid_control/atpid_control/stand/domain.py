# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS domain of the bench's own, so that two benches, or a bench and a stand, exchange no messages."""

import os
import socket
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from itertools import count

from atpid_common.middleware import HIGHEST_DOMAIN, claimed
from atpid_control.stand.parameters import BenchError

#: Domains whose ports lie below Linux's ephemeral range, without 0, the default.
LOWEST, HIGHEST = 1, 101
# DDS: port of the domain's multicast and of its first participant (RTPS 2.5, section 9.6.2.3)
_BASE, _GAIN, _FIRST_UNICAST = 7400, 250, 10
_turn = count()


@contextmanager
def own_domain(requested: int | None = None, environment: MutableMapping[str, str] = os.environ) -> Iterator[int]:
    """Claim a free domain, or the `requested` one, and set it in `environment`, with discovery on this machine only.

    The range chosen by the user (ROS_AUTOMATIC_DISCOVERY_RANGE) stays. Raises BenchError where none is free.
    """
    domain, holder = _claim(requested)
    before = {key: environment.get(key) for key in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE")}
    environment["ROS_DOMAIN_ID"] = str(domain)
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        yield domain
    finally:
        holder.close()
        for key, value in before.items():
            if value is None:
                environment.pop(key, None)
            else:
                environment[key] = value


def _claim(requested: int | None) -> tuple[int, socket.socket]:
    if requested is not None and not 0 <= requested <= HIGHEST_DOMAIN:
        raise BenchError(f"--domain: given {requested}; allowed: 0 to {HIGHEST_DOMAIN}")
    # starting from the process id, benches started together try different domains first; and no process takes a
    # domain twice in a row, for discovery may list nodes of the run before for some seconds
    span = HIGHEST - LOWEST + 1
    start = os.getpid() + next(_turn)
    candidates = [requested] if requested is not None else [LOWEST + (start + k) % span for k in range(span)]
    for domain in candidates:
        # held for the whole run: another bench may look between this check of the ports and the first node
        holder = claimed(f"bench/domain/{domain}")
        if holder is not None:
            if requested is not None or is_quiet(domain):
                return domain, holder
            holder.close()
    if requested is not None:
        raise BenchError(f"ROS domain {requested}: another bench is running there; name another one with --domain")
    raise BenchError(
        f"no free ROS domain between {LOWEST} and {HIGHEST}: stop other ROS programs, or name one with --domain"
    )


def is_quiet(domain: int) -> bool:
    """Whether no DDS participant on this machine has opened the domain's ports."""
    base = _BASE + _GAIN * domain
    for port in (base, base + _FIRST_UNICAST):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                return False
    return True
