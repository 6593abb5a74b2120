# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stand measured over many points by itself: plan, folder, judgement, run, page and model (docs/campaign.md)."""
