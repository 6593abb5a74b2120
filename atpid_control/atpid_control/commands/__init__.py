# SPDX-License-Identifier: Apache-2.0
"""The commands of `python -m atpid_control`, one module each: arguments, one call, what is printed."""
