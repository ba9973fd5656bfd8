"""Experiment 5.4 of the paper: the number of combinations, at the size of its tables."""

import numpy as np

import mograft as mg
from benches.evidence.section import Section, Table, join_words
from mograft.evaluation.enrichment import PAPER_TABLES, enrichment, moment_laws

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


def render(results):
    """The section."""
    table = [
        (f"paper, {name}", "", str(n), *(f"{numbers[k] / n:.1f}" for k in _GROUPS))
        for name, (_, n, numbers) in PAPER_TABLES.items()
    ]
    for name, rows in results.items():
        segments = np.mean(rows["segments"])
        for sigma, scale in _READINGS:
            for kind, title in _KINDS.items():
                values = np.array(rows[f"{sigma} {scale:g} {kind}"])
                cells = [_format(column) for column in values.T]
                label = f"eq. 14 {sigma}, factor {scale:g}, {title}"
                table.append((name, label, f"{segments:.0f}", *cells))
    failed = [
        f"{name}: {law.name}"
        for name, (_, n, numbers) in PAPER_TABLES.items()
        for law in moment_laws(n, numbers)
        if not law.holds
    ]
    conclusions = [*_two_groups_conclusion(results), *_covering_conclusion(results)]
    conclusions.append(
        f"{len(failed)} inequalities that hold for every single clustering fail for the numbers of "
        f"the paper ({failed[0]}, and others; B_K is the number of combinations for K groups). Its "
        "numbers cannot come from one clustering, even where each of them lies in the range of a "
        "row."
    )
    return Section(
        anchor=NAME,
        title="Experiment 5.4: how many combinations are there?",
        question="The paper counts the segments that can be composed from clusters (tables 1 and "
        "2). Are its numbers reproduced at its size?",
        data=f"From sources with more than {1.3 * N_SEGMENTS:.0f} segments, {N_DRAWS} random sets "
        f"of clips with about {N_SEGMENTS} segments (more where the clips are long); smaller "
        "sources "
        "once, as they are: these are not at the size of the paper. `Config.paper()`, which cuts "
        "other segments than the defaults; legs as the base group. Literal: eq. 14 as printed; "
        "rms: with the root mean square (`Config.sigma`).",
        measure="Combinations per segment for K groups, including the captured ones: the mean, "
        "and the range of 95 % of the draws; n is the number of draws. The draws share clips.",
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
            "That a row whose ranges contain the numbers of the paper is the computation of the "
            "paper: the ranges are wide, and one source of those at its size has such a row.",
        ),
        notes=(
            "In every clustering each further group multiplies the count by at least the factor of "
            "the group before (inequality of Cauchy and Schwarz). The rising factors of the rows "
            "are therefore no finding.",
        ),
    )


def _at_size(results):
    """Return the sources of several draws, which are at the size of the paper."""
    return {name: rows for name, rows in results.items() if len(rows["segments"]) > 1}


def _two_groups_conclusion(results):
    """Return the combinations of two groups with eq. 14 as printed, beside those of the paper."""
    factors = [numbers[2] / n for _, n, numbers in PAPER_TABLES.values()]
    cells = []
    for kind, title in _KINDS.items():
        listed = ", ".join(
            f"{name} {_format(np.array(rows[f'literal 1 {kind}'])[:, 0])}"
            for name, rows in _at_size(results).items()
        )
        cells.append(f"with {title}: {listed}")
    if _at_size(results):
        yield (
            "At the size of the paper, eq. 14 as printed, factor 1, combinations per segment of "
            f"two groups {'; '.join(cells)}. The paper has "
            f"{join_words([f'{own:.1f}' for own in factors])}."
        )


def _covering_conclusion(results):
    """Return which rows have ranges that contain the numbers of the paper."""
    covering, n_rows, by_printed = [], 0, {}
    for name, rows in _at_size(results).items():
        for sigma, scale in _READINGS:
            for kind, title in _KINDS.items():
                low, high = np.percentile(rows[f"{sigma} {scale:g} {kind}"], [2.5, 97.5], axis=0)
                inside = [
                    low[i] <= numbers[k] / n <= high[i]
                    for _, n, numbers in PAPER_TABLES.values()
                    for i, k in enumerate(_GROUPS)
                ]
                n_rows += 1
                if all(inside):
                    covering.append(f"`{name}`, eq. 14 {sigma}, factor {scale:g}, {title}")
                if (sigma, kind) == ("literal", "filtered"):
                    by_printed[name] = f"{name} {sum(inside)} of {len(inside)}"
    if n_rows:
        yield (
            "With eq. 14 as printed and eq. 19, the rule of the paper, the ranges contain "
            f"these of its eight numbers: {', '.join(by_printed.values())}. The "
            "rows at its size whose ranges contain all eight: "
            f"{len(covering)} of {n_rows}"
            + (f" ({'; '.join(covering)})" if covering else "")
            + ". Whether the numbers are reproduced therefore depends on the reading and on the "
            "recordings."
        )


def _format(values):
    mean = f"{values.mean():.1f}"
    if len(values) < 2:
        return f"{mean} (one set)"
    low, high = np.percentile(values, [2.5, 97.5])
    return f"{mean} ({low:.1f} to {high:.1f}), n = {len(values)}"
