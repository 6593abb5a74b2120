# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motions of a scene over many heights, along branches, and by where a run starts."""
