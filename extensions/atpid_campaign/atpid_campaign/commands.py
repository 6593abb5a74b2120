# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package, as the entry point of the group `atpid.commands` gives them."""

from atpid_common.cli import Commands

_CAMPAIGN = "atpid_campaign.campaign.command"
COMMANDS: Commands = {
    "Run the nodes": {
        "first-run": ("atpid_campaign.first_run", "a stand's first measurement, step by step, beside what is expected"),
        "campaign": (_CAMPAIGN, "measure a stand over many points: amplitudes, frequencies, heights, grains"),
    },
    "Calibrate": {
        "calibrate campaign": (f"{_CAMPAIGN}:MODEL", "a stand's model from its campaign: mass, beam, restitution"),
    },
    "For this machine": {
        "doctor": ("atpid_campaign.doctor.command", "what would keep a stand from running, and how to mend it"),
    },
}
