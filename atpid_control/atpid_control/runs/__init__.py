# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a bag, this project's or another's, to what is in it: read, checked, recovered, and a run as arrays."""
