# SPDX-License-Identifier: Apache-2.0
"""The ceiling's motor: one protocol (`CeilingActuator`), two backends (a simulated ceiling, a serial port)."""
