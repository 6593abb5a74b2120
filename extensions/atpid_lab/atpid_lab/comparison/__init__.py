# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two bags beside each other: traces and spectra overlaid, differences in a table."""
