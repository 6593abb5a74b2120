# SPDX-License-Identifier: Apache-2.0
"""Studies and demonstrations; nothing in production imports them."""
