# SPDX-License-Identifier: Apache-2.0
"""Quantities of the thesis as pure functions over series, simulated or recorded, and closed forms to compare with."""
