# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The nodes of a stand, made in one process: what runs them in lockstep, and the policy made of them."""
