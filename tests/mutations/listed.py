# SPDX-License-Identifier: Apache-2.0
"""All mutations."""

import in_firmware
import in_link
import in_nodes
import in_rules

MUTATIONS = (*in_firmware.MUTATIONS, *in_link.MUTATIONS, *in_rules.MUTATIONS, *in_nodes.MUTATIONS)
