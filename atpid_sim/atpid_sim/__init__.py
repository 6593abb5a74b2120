# SPDX-License-Identifier: Apache-2.0
"""The physics of the Adaptive Tuned Particle Impact Damper: contact laws, steppers, height maps, and the simulated plant node."""
