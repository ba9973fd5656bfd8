"""Experiment 5.4 of the paper: the number of combinations, at the size of its tables."""

import numpy as np

import mograft as mg
from benches.evidence.section import Section, Table
from mograft.evaluation.enrichment import PAPER_TABLES, enrichment, moment_laws

NAME = "counts"
SOURCES = ("salsa A", "salsa B", "perfume", "indian", "basketball", "locomotion", "everyday")
N_DRAWS = 20
N_SEGMENTS = 900
_READINGS = (("literal", 1.0), ("rms", 1.0), ("rms", 0.75))
_GROUPS = (2, 3, 4, 5)


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


def render(results):
    """The section."""
    table = [
        (f"paper, {name}", "", str(n), *(f"{numbers[k] / n:.1f}" for k in _GROUPS))
        for name, (_, n, numbers) in PAPER_TABLES.items()
    ]
    for name, rows in results.items():
        segments = np.mean(rows["segments"])
        for sigma, scale in _READINGS:
            for kind, title in (("unfiltered", "no length limit"), ("filtered", "eq. 19")):
                values = np.array(rows[f"{sigma} {scale:g} {kind}"])
                cells = [_format(column) for column in values.T]
                label = f"eq. 14 {sigma}, factor {scale:g}, {title}"
                table.append((name, label, f"{segments:.0f}", *cells))
    literal = {
        kind: [float(np.mean(rows[f"literal 1 {kind}"], axis=0)[0]) for rows in results.values()]
        for kind in ("unfiltered", "filtered")
    }
    factors = [numbers[2] / n for _, n, numbers in PAPER_TABLES.values()]
    failed = [
        f"{name}: {law.name}"
        for name, (_, n, numbers) in PAPER_TABLES.items()
        for law in moment_laws(n, numbers)
        if not law.holds
    ]
    conclusions = []
    if results:
        low, high = min(literal["filtered"]), max(literal["filtered"])
        conclusions.append(
            f"The numbers of the paper are not reproduced. With eq. 14 as printed and eq. 19, two "
            f"groups give {low:.1f} to {high:.1f} combinations per segment; the paper has "
            f"{min(factors):.1f} and {max(factors):.1f}. Without eq. 19 the range is "
            f"{min(literal['unfiltered']):.1f} to {max(literal['unfiltered']):.1f}."
        )
    conclusions.append(
        f"{len(failed)} inequalities that hold for every single clustering fail for the numbers of "
        f"the paper ({failed[0]}, and others). They cannot come from one clustering."
    )
    return Section(
        anchor=NAME,
        title="Experiment 5.4: how many combinations are there?",
        question="The paper counts the segments that can be composed from clusters (tables 1 and "
        "2). Are its numbers reproduced at its size?",
        data=f"From sources with more than {1.3 * N_SEGMENTS:.0f} segments, {N_DRAWS} random sets "
        f"of clips with about {N_SEGMENTS} segments; smaller sources once, as they are. "
        "`Config.paper()`, legs as the base group.",
        measure="Combinations per segment for K groups, including the captured ones: the mean, "
        "and the range of 95 % of the draws.",
        null="A library in which every segment is a cluster has 1 combination per segment for "
        "every K.",
        tables=(
            Table(
                ("recordings", "threshold", "segments", *(f"K = {k}" for k in _GROUPS)),
                tuple(table),
            ),
        ),
        conclusions=tuple(conclusions),
        limits=(
            "That more combinations are better: counts do not measure quality.",
            "That each further group multiplies the count by a larger factor is no finding. The "
            "inequality of Cauchy and Schwarz guarantees it for every clustering.",
        ),
    )


def _format(values):
    mean = f"{values.mean():.1f}"
    if len(values) < 2:
        return f"{mean} (one set)"
    low, high = np.percentile(values, [2.5, 97.5])
    return f"{mean} ({low:.1f} to {high:.1f}), n = {len(values)}"
