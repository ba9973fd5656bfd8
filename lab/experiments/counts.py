"""Experiment 5.4 of the paper: the number of combinations, at the size of its tables.

From large sources, 20 random sets of clips with about 900 segments; smaller sources once, as they
are. Combinations per segment for K groups, including the captured ones: the mean, and the range of
95 % of the draws. Literal: eq. 14 as printed; rms: with the root mean square (`Config.sigma`).
In every clustering each further group multiplies the count by at least the factor of the group
before (Cauchy and Schwarz); `lab.donors.enrichment.moment_laws` shows that the numbers of the paper
violate this.
"""

import numpy as np

import mograft as mg
from lab.donors.enrichment import PAPER_TABLES, enrichment
from lab.experiments.tables import Table

NAME = "counts"
SOURCES = ("salsa A", "salsa B", "perfume", "indian", "basketball", "locomotion", "everyday")
N_DRAWS = 20
N_SEGMENTS = 900
_READINGS = (("literal", 1.0), ("rms", 1.0), ("rms", 0.75))
_GROUPS = (2, 3, 4, 5)
_KINDS = {"unfiltered": "no length limit", "filtered": "eq. 19"}


def measure(recordings, *, is_quick):
    """Combinations per segment in random sets of clips, for each reading of eq. 14."""
    rng = np.random.default_rng(0)
    paper = recordings.build(mg.Config.paper())
    sizes = np.bincount(paper.segments.clip, minlength=len(paper.clips))
    is_large = len(paper.segments) > 1.3 * N_SEGMENTS
    n_draws = 1 if not is_large else 3 if is_quick else N_DRAWS
    rows = {}
    for _ in range(n_draws):
        order = rng.permutation(len(sizes))
        n_clips = int(np.searchsorted(np.cumsum(sizes[order]), N_SEGMENTS)) + 1
        clips = sorted(order[:n_clips].tolist()) if is_large else range(len(sizes))
        drawn = type(recordings)(recordings.name, tuple(recordings.motions[i] for i in clips))
        library = drawn.build(mg.Config.paper())
        for sigma, scale in _READINGS:
            config = mg.Config.paper(sigma=sigma, sigma_scale=scale)
            found = enrichment(library.relabelled(config))
            for kind in ("unfiltered", "filtered"):
                values = [getattr(count, kind) / found.segments for count in found.counts]
                rows.setdefault(f"{sigma} {scale:g} {kind}", []).append(values)
        rows.setdefault("segments", []).append([len(library.segments)])
    return rows


def tables(results):
    """Combinations per segment, those of the paper first."""
    rows = [
        (f"paper, {name}", "", str(n), *(f"{numbers[k] / n:.1f}" for k in _GROUPS))
        for name, (_, n, numbers) in PAPER_TABLES.items()
    ]
    for name, found in results.items():
        segments = np.mean(found["segments"])
        for sigma, scale in _READINGS:
            for kind, title in _KINDS.items():
                values = np.array(found[f"{sigma} {scale:g} {kind}"])
                cells = [_format(column) for column in values.T]
                label = f"eq. 14 {sigma}, factor {scale:g}, {title}"
                rows.append((name, label, f"{segments:.0f}", *cells))
    head = ("recordings", "threshold", "segments", *(f"K = {k}" for k in _GROUPS))
    return {"combinations": Table(head, rows)}


def _format(values):
    mean = f"{values.mean():.1f}"
    if len(values) < 2:
        return f"{mean} (one set)"
    low, high = np.percentile(values, [2.5, 97.5])
    return f"{mean} ({low:.1f} to {high:.1f}), n = {len(values)}"
