# SPDX-License-Identifier: Apache-2.0
"""What the documentation shows: comparisons, figures, and the loop without the graph over many seeds."""
