# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restitution, contact time and effective modulus of grain and wall from what was measured."""
