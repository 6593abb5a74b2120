# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reports of recorded runs: stages, tables, pictures and one page (docs/recording.md)."""
