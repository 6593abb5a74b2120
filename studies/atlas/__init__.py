# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The atlas: types of motion over amplitude, mass, frequency and height, and how far the cliff is."""
