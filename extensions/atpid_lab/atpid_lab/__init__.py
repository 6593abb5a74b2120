# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Analysis beyond spectra and orders, and files of other programs: modes, beam, contact, validation, traces."""
