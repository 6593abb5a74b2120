# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What measures the project: not installed, run from the repository as `python -m studies NAME`."""
