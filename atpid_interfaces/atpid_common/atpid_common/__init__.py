# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the packages share: errors, command line, cache folder and, in `nodes`, the plumbing of ROS 2 nodes."""
