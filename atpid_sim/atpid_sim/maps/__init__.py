# SPDX-License-Identifier: Apache-2.0
"""Height maps: the best ceiling height over support amplitude and grain mass (thesis section 4.2, Fig. 3.25)."""
