"""All measures of the grafts of one library, as numbers and as a JSON document."""

import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.validate import as_integer
from mograft.body.mass import mass_model
from mograft.errors import InsufficientDataError
from mograft.evaluation.balance import BALANCES, BalancedBase, BalanceRow, balance_row
from mograft.evaluation.detectability import Detectability, detectability
from mograft.evaluation.estimate import as_json
from mograft.evaluation.quality import Quality, quality
from mograft.evaluation.world_measures import WorldQuality, world_quality
from mograft.library.clusters import Progress
from mograft.library.library import Library
from mograft.synthesis.graft import graft_many
from mograft.synthesis.graft_result import Graft

TOPICS = ("quality", "world", "detectability", "balance")
GRAFTS = "grafts"  # name of the grafts that `mograft.graft_many` makes
GraftMaker: TypeAlias = Callable[[Library, str, int, int], Sequence[Graft]]
"""Makes grafts, given the library, the name of the base, the number of grafts and a seed."""

_MEASURES: dict[str, Callable[[str, Sequence[Sequence[Graft]], int], object]] = {
    "quality": quality,
    "world": world_quality,
    "detectability": detectability,
}


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Measures of the grafts of a library.

    Attributes
    ----------
    library : Library
        The library whose clips were the bases.
    topics : tuple of str
        Requested topics, a selection of `TOPICS`.
    quality : tuple of Quality
        Quality for each method.
    world : tuple of WorldQuality
        World-space measures for each method, with novelty and variety.
    detectability : tuple of Detectability
        Detectability for each method, with null comparisons.
    balance : tuple of BalanceRow
        Static and dynamic balance for each method, and for the recording.
    refusals : dict of str to str
        Reasons why a topic, a part of a topic or a method could not be measured, by its name.
    parameters : dict
        Parameters and versions on which the numbers depend.
    """

    library: Library
    topics: tuple[str, ...]
    quality: tuple[Quality, ...]
    world: tuple[WorldQuality, ...]
    detectability: tuple[Detectability, ...]
    balance: tuple[BalanceRow, ...]
    refusals: Mapping[str, str]
    parameters: Mapping[str, Any]

    def __repr__(self) -> str:
        refusals = f", not measured: {', '.join(self.refusals)}" if self.refusals else ""
        return f"Evaluation({', '.join(self.topics)} of {self.library!r}{refusals})"

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON with all numbers, sample sizes and intervals."""
        library, model = self.library, mass_model(self.library.skeleton)
        clips = [
            {"name": entry.name, "file": library.file_name(index), "frames": entry.n_frames}
            for index, entry in enumerate(library.entries)
        ]
        recordings = {"clips": clips, "rate": library.rate, "segments": len(library.segments)}
        recordings["segments_with_faults"] = int((~library.is_donor).sum())
        recordings |= {"groups": list(library.groups.names), "base_group": library.groups.base}
        body = {"model": model.model, "height": model.height, "height_from": model.height_from}
        body["unmatched_joints"] = list(model.unmatched)
        document: dict[str, Any] = {"schema": "mograft.evaluation/1", "mograft": VERSION}
        document |= {"parameters": dict(self.parameters), "library": recordings, "body": body}
        document["refused"] = dict(self.refusals)
        results = {topic: getattr(self, topic) for topic in TOPICS}
        return document | {name: as_json(result) for name, result in results.items() if result}


def evaluate(
    library: Library,
    topics: Sequence[str] = TOPICS,
    *,
    methods: Mapping[str, GraftMaker] | None = None,
    runs: int = 6,
    bases: int = 4,
    seed: int = 0,
    progress: Progress | None = None,
) -> Evaluation:
    """Make grafts of clips of a library, and measure them.

    Parameters
    ----------
    library : Library
        Library whose clips are bases and donors.
    topics : sequence of str
        Topics to measure. Default: "quality", "world", "detectability" and "balance".
    methods : dict of str to callable, optional
        Functions that make the grafts, by the name of the method in the results. They are called
        with the library, the name of the base, the number of grafts and the seed. Default:
        `mograft.graft_many` with the configuration of the library, as "grafts".
    runs : int
        Number of grafts for each base and method; intervals need five or more in all.
    bases : int
        Maximum number of clips that serve as base. They are evenly spaced in the library.
    seed : int
        Seed of all random choices.
    progress : callable, optional
        Called with the name of the stage, the number of finished steps and the number of steps.

    Returns
    -------
    Evaluation
        The measures; `Evaluation.refusals` has the reasons why some could not be computed.

    Raises
    ------
    ImportError
        If a package of the extra ``evaluate`` is required and not installed.
    ValueError
        If a topic is unknown, there is none, or `runs` or `bases` is not an integer of at least 1.

    Examples
    --------
    >>> from mograft import Library
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> found = evaluate(library, ["balance"], runs=1)
    >>> {row.method for row in found.balance} == {"recording", "grafts"}
    True
    """
    unknown = [topic for topic in topics if topic not in TOPICS]
    if unknown or not topics:
        given = ", ".join(unknown) or "none"
        raise ValueError(f"`topics` must be among {', '.join(TOPICS)}, got {given}")
    runs, n_bases = as_integer("runs", runs, 1), as_integer("bases", bases, 1)
    n_clips = len(library.entries)
    clips = np.unique(np.linspace(0, n_clips - 1, min(n_bases, n_clips)).round().astype(int))
    base_names = [library.entries[clip].name for clip in clips.tolist()]
    made = {GRAFTS: _graft_many} if methods is None else methods
    report: Progress = (lambda *_: None) if progress is None else progress
    found: dict[str, list[Any]] = {topic: [] for topic in TOPICS}
    refusals: dict[str, str] = {}
    bases_with_balance: list[BalancedBase] = []
    if "balance" in topics:
        with _recorded_refusal(refusals, "balance"):
            bases_with_balance = [BalancedBase.of(library, clip) for clip in clips.tolist()]
            recorded = [None] * len(bases_with_balance)
            found["balance"] += _balance_rows("recording", bases_with_balance, recorded, refusals)
    for name, make in made.items():
        with _recorded_refusal(refusals, name):
            grafts = []
            for position, base in enumerate(base_names):
                report("grafting", position, len(base_names))
                grafts.append(list(make(library, base, runs, seed)))
            for position, topic in enumerate(topics):
                report(f"measuring {topic}", position, len(topics))
                with _recorded_refusal(refusals, topic if name == GRAFTS else f"{topic} of {name}"):
                    if topic in _MEASURES:
                        found[topic].append(_MEASURES[topic](name, grafts, seed))
            # The donors may allow fewer different grafts of a base than requested.
            count = min(map(len, grafts))
            several = [own[:count] for own in grafts]
            found["balance"] += _balance_rows(name, bases_with_balance, several, refusals)
    report("measuring", 1, 1)
    parameters = {"seed": seed, "runs": runs, "bases": base_names, "ways": list(made)}
    parameters |= {"confidence": 0.95, "config": library.config.as_dict()}
    parameters |= {"python": platform.python_version(), "numpy": np.__version__}
    return Evaluation(
        library=library,
        topics=tuple(topics),
        refusals=refusals,
        parameters=parameters,
        **{topic: tuple(rows) for topic, rows in found.items()},
    )


def _graft_many(library: Library, base: str, runs: int, seed: int) -> Sequence[Graft]:
    return graft_many(library, base, runs, seed=seed)


@contextmanager
def _recorded_refusal(refusals: dict[str, str], topic: str) -> Iterator[None]:
    """Store the message of an InsufficientDataError of the ``with`` block in `refusals[topic]`."""
    try:
        yield
    except InsufficientDataError as error:
        refusals[topic] = str(error)


def _balance_rows(
    method: str,
    bases: Sequence[BalancedBase],
    grafts: Sequence[Sequence[Graft] | None],
    refusals: dict[str, str],
) -> list[BalanceRow]:
    """Return how well one method keeps balance, by kind; None in `grafts` is a recorded base."""
    rows = []
    for kind in BALANCES if bases else ():
        samples = [base.sample(kind, own) for base, own in zip(bases, grafts, strict=True)]
        with _recorded_refusal(refusals, f"{kind} balance"):
            rows.append(balance_row(kind, method, samples))
    return rows
