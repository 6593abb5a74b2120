# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ball in a container that moves, turns and rubs, in the plane: what the straight model leaves out."""
