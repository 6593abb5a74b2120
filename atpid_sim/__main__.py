# SPDX-License-Identifier: Apache-2.0
"""What `python -m atpid_sim` finds in the repository's folder where the package itself is not on Python's path."""

import sys

print("atpid_sim is not on Python's path: '. ros2_ws/activate' first ('make setup' before, once)", file=sys.stderr)
sys.exit(2)
