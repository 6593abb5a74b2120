# SPDX-License-Identifier: Apache-2.0
"""The page's analysis: orders or decrement, and the spectra of support and beam (docs/reading.md)."""

from html import escape

import numpy as np

from atpid_control.analysis.analyse import Analysis, analyse
from atpid_control.analysis.rows import rows
from atpid_control.analysis.signals import AnalysisError, Signals
from atpid_control.report.run import Motion
from atpid_control.report.view import View


def signals_of(motion: Motion) -> Signals:
    """Return support and beam of a run, evenly sampled, NaN where a sample was lost."""
    rate = 1.0 / float(np.median(np.diff(motion.time))) if len(motion.time) > 1 else 1.0
    index = np.rint(motion.time * rate).astype(np.int64)  # a lost sample has no row in a run
    support, beam = np.full((2, int(index[-1]) + 1), np.nan)
    support[index], beam[index] = motion.support, motion.beam
    return Signals(rate, support, beam)


def analysis_of(view: View) -> Analysis | None:
    """Return the analysis of a run; None of one in which nothing moves, or which is too short."""
    try:
        return analyse(signals_of(view.run.motion))
    except AnalysisError:
        return None


def section(found: Analysis | None) -> str:
    """Return the results with what cannot be trusted, and the place of the chart."""
    if found is None:
        return ""
    lines = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows(found))
    doubts = "".join(f"<li>{escape(line)}</li>" for line in found.doubts)
    listed = f'<p class="note defaults">Not to be trusted:</p><ul class="note">{doubts}</ul>' if doubts else ""
    return (
        '<h2>Analysis</h2><figure><div class="chart" id="spectra" role="img" aria-label="Power spectral densities of '
        f'support and beam"></div></figure><dl>{lines}</dl>{listed}'
    )
