"""All measures of one library at once, as numbers and as a JSON document."""

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import BoolArray
from mograft.analysis.segmentation import Segments
from mograft.body.mass import mass_model
from mograft.errors import InsufficientDataError
from mograft.evaluation.balance import (
    RULES,
    Balance,
    BalanceRow,
    balance_row,
    dynamic_balance,
    static_balance,
    support,
)
from mograft.evaluation.baselines import Method, grafts_by, methods
from mograft.evaluation.enrichment import (
    Enrichment,
    Law,
    cluster_numbers,
    enrichment,
    moment_laws,
    sweep,
)
from mograft.evaluation.naturalness import Compatibility, compatibility
from mograft.evaluation.people import Judgement, Labels, judgement
from mograft.evaluation.quality import Quality, quality
from mograft.library.library import Library
from mograft.synthesis.graft_result import Graft

__all__ = ["TOPICS", "Evaluation", "evaluate"]

TOPICS = ("enrichment", "balance", "naturalness", "quality")
MARGIN = 0.01
"""Heights outside of the support that a second row of balance lets pass: how fine it cuts."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What was measured of a library.

    Attributes
    ----------
    library : Library
        The library.
    topics : tuple of str
        What was asked for, of `TOPICS`.
    counted : Enrichment or None
        Combinations by the library's configuration.
    swept : tuple of Enrichment
        Combinations for every reading of the threshold and scale.
    clusters : dict of int to dict of str to int
        Clusters of each joint group, by number of groups.
    laws : tuple of Law
        The laws of moments that the counts obey.
    balance : tuple of BalanceRow
        For each rule and way.
    naturalness : tuple of Compatibility
        For each grafted group.
    people : Judgement or None
        What labels say, if there are any.
    quality : tuple of Quality
        For each way.
    refused : dict of str to str
        Topics, or groups of one, that the data cannot support, and why.
    parameters : dict
        What the numbers depend on.
    """

    library: Library
    topics: tuple[str, ...]
    counted: Enrichment | None
    swept: tuple[Enrichment, ...]
    clusters: Mapping[int, Mapping[str, int]]
    laws: tuple[Law, ...]
    balance: tuple[BalanceRow, ...]
    naturalness: tuple[Compatibility, ...]
    people: Judgement | None
    quality: tuple[Quality, ...]
    refused: Mapping[str, str]
    parameters: Mapping[str, Any]

    def __repr__(self) -> str:
        refused = f", refused: {', '.join(self.refused)}" if self.refused else ""
        return f"Evaluation({', '.join(self.topics)} of {self.library!r}{refused})"

    def as_dict(self) -> dict[str, Any]:
        """Return all numbers, each with its sample size and interval, as JSON can hold them."""
        library = self.library
        known = mass_model(library.skeleton)
        found: dict[str, Any] = {
            "schema": "mograft.evaluation/1",
            "mograft": VERSION,
            "parameters": dict(self.parameters),
            "library": {
                "clips": [
                    {
                        "name": entry.name,
                        "file": library.file_name(index),
                        "frames": entry.n_frames,
                    }
                    for index, entry in enumerate(library.entries)
                ],
                "rate": library.rate,
                "segments": len(library.segments),
                "segments_with_faults": int((~library.is_donor).sum()),
                "groups": list(library.groups.names),
                "base_group": library.groups.base,
            },
            "body": {
                "model": known.model,
                "height": known.height,
                "height_from": known.height_from,
                "unmatched_joints": list(known.unmatched),
            },
            "refused": dict(self.refused),
        }
        if self.counted is not None:
            found["enrichment"] = {
                **self.counted.as_dict(),
                "clusters": {str(k): dict(own) for k, own in self.clusters.items()},
                "sweep": [own.as_dict() for own in self.swept],
                "laws": [vars(law) for law in self.laws],
            }
        if self.balance:
            found["balance"] = [row.as_dict() for row in self.balance]
        if self.naturalness:
            found["naturalness"] = [own.as_dict() for own in self.naturalness]
        if self.people is not None:
            found["people"] = self.people.as_dict()
        if self.quality:
            found["quality"] = [own.as_dict() for own in self.quality]
        return found


def evaluate(
    library: Library,
    topics: Sequence[str] = TOPICS,
    *,
    ways: Sequence[Method] | None = None,
    runs: int = 10,
    bases: int = 4,
    labels: Labels | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Evaluation:
    """Measure what a library gives, and how its grafts compare with chance and with rules.

    Parameters
    ----------
    library : Library
        The library.
    topics : sequence of str
        Of "enrichment", "balance", "naturalness" and "quality".
    ways : sequence of Method, optional
        Ways to choose donors. Default: `mograft.evaluation.methods` of the library.
    runs : int
        Motions made on each base and by each way, for balance and quality.
    bases : int
        Clips that they are made on, at most; evenly among those of the library.
    labels : Labels, optional
        What a person said, for naturalness.
    seed : int
        Of all that is left to chance.
    progress : callable, optional
        Called with a stage's name, what is done of it and the whole.

    Returns
    -------
    Evaluation
        What the data cannot support is in its `refused`, with the reason.

    Raises
    ------
    ImportError
        If a package of the extra ``evaluate`` is needed and absent.
    ValueError
        If a topic is none, or `runs` or `bases` is below 1.

    Examples
    --------
    >>> from mograft import Library
    >>> from mograft.dancer import dance
    >>> found = evaluate(Library.build(dance(strides=1).motion), ["enrichment"])
    >>> found.counted.segments == len(found.library.segments)
    True
    """
    unknown = [topic for topic in topics if topic not in TOPICS]
    if unknown or not topics:
        got = ", ".join(unknown) or "none"
        raise ValueError(f"topics must be of {', '.join(TOPICS)}, got {got}")
    for name, value in (("runs", runs), ("bases", bases)):
        if value < 1:
            raise ValueError(f"{name} must be 1 or more, got {value}")
    chosen = methods(library) if ways is None else tuple(ways)
    refused: dict[str, str] = {}
    counted: Enrichment | None = None
    swept: tuple[Enrichment, ...] = ()
    laws: tuple[Law, ...] = ()
    clusters: dict[int, dict[str, int]] = {}
    if "enrichment" in topics:
        counted, swept = enrichment(library), sweep(library)
        clusters = cluster_numbers(library)
        laws = moment_laws(counted.segments, {c.groups: c.unfiltered for c in counted.counts})
    rows: list[BalanceRow] = []
    qualities: list[Quality] = []
    names = _bases(library, bases)
    if {"balance", "quality"} & set(topics):
        rows, qualities = _made(
            library, chosen, names, topics, runs, seed, refused, progress or (lambda *_: None)
        )
    found: list[Compatibility] = []
    people = None
    if "naturalness" in topics:
        # What only the making of a motion depends on changes nothing of who goes with whom.
        choosing = [way for way in chosen if not way.changes]
        for group in library.groups.names:
            if group == library.groups.base:
                continue
            try:
                found.append(compatibility(library, group, choosing, seed=seed, progress=progress))
            except InsufficientDataError as error:
                refused[f"naturalness of {group}"] = str(error)
        if labels is not None:
            try:
                people = judgement(library, labels, choosing, seed=seed)
            except InsufficientDataError as error:
                refused["labels"] = str(error)
    parameters = {
        "seed": seed,
        "runs": runs,
        "bases": names,
        "ways": [way.name for way in chosen],
        "confidence": 0.95,
        "config": library.config.as_dict(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    return Evaluation(
        library,
        tuple(topics),
        counted,
        swept,
        clusters,
        laws,
        tuple(rows),
        tuple(found),
        people,
        tuple(qualities),
        refused,
        parameters,
    )


def _bases(library: Library, most: int) -> list[str]:
    """Return names of clips, evenly among those of the library."""
    n = len(library.entries)
    picked = np.unique(np.linspace(0, n - 1, min(most, n)).round().astype(int))
    return [library.entries[at].name for at in picked.tolist()]


def _made(
    library: Library,
    ways: Sequence[Method],
    names: Sequence[str],
    topics: Sequence[str],
    runs: int,
    seed: int,
    refused: dict[str, str],
    progress: Progress,
) -> tuple[list[BalanceRow], list[Quality]]:
    """Make motions by every way and measure them, one way after the other."""
    index = {entry.name: at for at, entry in enumerate(library.entries)}
    clips = [library.clips[index[name]] for name in names]
    scenarios = [library.segments.of_clip(index[name]) for name in names]
    cuts = [Segments(library.segments.start[own], library.segments.stop[own]) for own in scenarios]
    measures = {"static": static_balance, "dynamic": dynamic_balance}
    grounds, own_balance = [], {}
    judges = "balance" in topics
    if judges:
        try:
            grounds = [support(clip) for clip in clips]
            for kind, measure in measures.items():
                own_balance[kind] = [
                    measure(clip, on=ground) for clip, ground in zip(clips, grounds, strict=True)
                ]
        except InsufficientDataError as error:
            refused["balance"], judges = str(error), False
    rows: list[BalanceRow] = []
    qualities: list[Quality] = []
    if judges:
        still = [np.ones((1, len(cut)), bool) for cut in cuts]
        alone = {kind: [[one] for one in several] for kind, several in own_balance.items()}
        rows += _rows("recording", own_balance, alone, still, cuts, refused)
    for place, way in enumerate(ways):
        progress("grafting", place, len(ways))
        try:
            made = [list(grafts_by(way, library, name, runs, seed=seed)) for name in names]
        except InsufficientDataError as error:
            refused[way.name] = str(error)
            continue
        if judges:
            # The donors may allow fewer different motions than are wanted.
            fewest = min(map(len, made))
            after: dict[str, list[list[Balance]]] = {kind: [] for kind in measures}
            for grafts, ground in zip(made, grounds, strict=True):
                for kind, measure in measures.items():
                    after[kind].append(
                        [
                            measure(
                                graft.motion,
                                # Feet that were moved stand elsewhere.
                                on=ground if graft.feet is None else None,
                                like=graft.base,
                            )
                            for graft in grafts[:fewest]
                        ]
                    )
            changed = [
                np.stack([_changed(graft, len(cut)) for graft in grafts[:fewest]])
                for grafts, cut in zip(made, cuts, strict=True)
            ]
            rows += _rows(way.name, own_balance, after, changed, cuts, refused)
        if "quality" in topics:
            try:
                qualities.append(quality(way.name, made, seed))
            except InsufficientDataError as error:
                refused["quality"] = str(error)
    progress("grafting", len(ways), len(ways))
    return rows, qualities


def _changed(graft: Graft, n: int) -> BoolArray:
    """Tell which segments have an exchanged part."""
    own = np.array([not s.is_own for s in graft.substitutions])
    return np.asarray(own.reshape(-1, n).any(axis=0), bool)


def _rows(
    name: str,
    original: Mapping[str, Sequence[Balance]],
    made: Mapping[str, Sequence[Sequence[Balance]]],
    changed: Sequence[BoolArray],
    cuts: Sequence[Segments],
    refused: dict[str, str],
) -> list[BalanceRow]:
    rows = []
    for kind, own in original.items():
        for rule in RULES:
            for margin in (0.0, MARGIN) if (kind, rule) == ("static", "all") else (0.0,):
                try:
                    rows.append(balance_row(name, own, made[kind], changed, cuts, rule, margin))
                except InsufficientDataError as error:
                    refused[f"{kind} balance"] = str(error)
    return rows
