# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a run to what people and other programs read: page, pictures, tables, traces, the live page."""
