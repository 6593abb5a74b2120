# SPDX-License-Identifier: Apache-2.0
"""The atlas: which motion lives where in amplitude, mass, frequency and height, and how far the cliff is."""
