# SPDX-License-Identifier: Apache-2.0
"""The bench: one scene through the whole node graph, in lockstep or in real time, to a bag, a summary and a report."""
