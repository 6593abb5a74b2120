# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The notice at the head of the project's files, as ament_copyright looks for it: its entry point is in setup.py."""

from types import SimpleNamespace
from typing import Final

_HEADER = "{copyright}\nSPDX-License-Identifier: Apache-2.0"
_TERMS = "Contributions are accepted under the same licence, as its section 5 says."
#: Two lines, copyright and SPDX identifier, in place of the thirteen of the licence's appendix.
SPDX: Final = SimpleNamespace(spdx="Apache-2.0", license_files=[], file_headers=[_HEADER], contributing_files=[_TERMS])
SPDX.name = "Apache License 2.0 by its SPDX identifier"
