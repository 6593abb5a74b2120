# SPDX-License-Identifier: Apache-2.0
"""Figures of the documentation, one module each, made by `python -m atpid_control figures NAME --out DIR`."""
