# SPDX-License-Identifier: Apache-2.0
# Made by `python tests/message_stubs.py` from the definitions; a test compares.
