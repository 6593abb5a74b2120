# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Methods of selection and passive dampers on the same scenes: efficiency, time, robustness."""
