# SPDX-License-Identifier: Apache-2.0
"""The physics of the tuned particle impact damper: contact laws, steppers, height maps, and the plant node."""
