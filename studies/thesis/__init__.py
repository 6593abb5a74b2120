# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The thesis side by side: studies as data (`data/`), what they measure, their rows, pictures and page."""
