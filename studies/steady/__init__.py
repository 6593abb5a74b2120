# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `simulate --steady` finds, beside a judge of its own."""
