# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation output of a stand: an extension of atpid_control."""
