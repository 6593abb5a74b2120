# SPDX-License-Identifier: Apache-2.0
"""What `simulate --steady` finds, beside a judge of its own."""
