# SPDX-License-Identifier: Apache-2.0
"""The physics of the tuned particle impact damper: contact laws, steppers, height maps, and the plant node."""

from __future__ import annotations

from atpid_sim._kernel_cache import use_own_cache

use_own_cache()
