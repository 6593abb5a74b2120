# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""All mutations."""

import in_excitation
import in_firmware
import in_link
import in_nodes
import in_permit
import in_rules

ROOMS = (in_firmware, in_link, in_rules, in_nodes, in_permit, in_excitation)
MUTATIONS = tuple(mutation for room in ROOMS for mutation in room.MUTATIONS)
