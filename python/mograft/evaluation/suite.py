"""All measures of the grafts of one library, as numbers and as a JSON document."""

import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Self, TypeAlias

import numpy as np

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import BoolArray
from mograft._util.validate import as_integer
from mograft.body.mass import mass_model
from mograft.body.support_polygon import Support, support_polygons
from mograft.errors import InsufficientDataError
from mograft.evaluation.balance import (
    RULES,
    Balance,
    BalanceRow,
    BalanceSample,
    balance_row,
    dynamic_balance,
    static_balance,
)
from mograft.evaluation.detectability import Detectability, detectability
from mograft.evaluation.estimate import as_json
from mograft.evaluation.quality import Quality, quality
from mograft.evaluation.world_measures import has_base_legs
from mograft.evaluation.world_quality import WorldQuality, world_quality
from mograft.library.clusters import Progress
from mograft.library.library import Library
from mograft.motion.segments import Segments
from mograft.synthesis.graft import graft_many
from mograft.synthesis.graft_result import Graft

TOPICS = ("quality", "world", "detectability", "balance")
GRAFTS = "grafts"  # name of the grafts that `mograft.graft_many` makes
GraftMaker: TypeAlias = Callable[[Library, str, int, int], Sequence[Graft]]
"""Makes grafts, given the library, the name of the base, the number of grafts and a seed."""

BALANCE_MARGIN = 0.01  # margin of the second row of static balance, in skeleton heights

_MEASURES = {"static": static_balance, "dynamic": dynamic_balance}


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
        Balance for each method and rule, and for the recording.
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
        document: dict[str, Any] = {
            "schema": "mograft.evaluation/1",
            "mograft": VERSION,
            "parameters": dict(self.parameters),
            **_library_dict(self.library),
            "refused": dict(self.refusals),
        }
        results = {topic: getattr(self, topic) for topic in TOPICS}
        return document | {name: as_json(result) for name, result in results.items() if result}


def _library_dict(library: Library) -> dict[str, Any]:
    """Return the description of a library and of its skeleton for JSON."""
    model = mass_model(library.skeleton)
    return {
        "library": {
            "clips": [
                {"name": entry.name, "file": library.file_name(index), "frames": entry.n_frames}
                for index, entry in enumerate(library.entries)
            ],
            "rate": library.rate,
            "segments": len(library.segments),
            "segments_with_faults": int((~library.is_donor).sum()),
            "groups": list(library.groups.names),
            "base_group": library.groups.base,
        },
        "body": {
            "model": model.model,
            "height": model.height,
            "height_from": model.height_from,
            "unmatched_joints": list(model.unmatched),
        },
    }


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
    runs, bases = as_integer("runs", runs, 1), as_integer("bases", bases, 1)
    refusals: dict[str, str] = {}
    base_names = _select_bases(library, bases)
    made = {GRAFTS: _graft_many} if methods is None else methods
    making = _Grafting(library, made, base_names, runs, seed)
    measured = making.measure(topics, refusals, progress)
    return Evaluation(
        library=library,
        topics=tuple(topics),
        quality=tuple(measured.quality),
        world=tuple(measured.world),
        detectability=tuple(measured.detectability),
        balance=tuple(measured.balance),
        refusals=refusals,
        parameters={
            "seed": seed,
            "runs": runs,
            "bases": base_names,
            "ways": list(made),
            "confidence": 0.95,
            "config": library.config.as_dict(),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
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


def _select_bases(library: Library, max_count: int) -> list[str]:
    """Return the names of evenly spaced clips."""
    n = len(library.entries)
    indices = np.unique(np.linspace(0, n - 1, min(max_count, n)).round().astype(int))
    return [library.entries[index].name for index in indices.tolist()]


@dataclass(frozen=True, eq=False)
class _Grafting:
    """The parameters of grafts: their methods, bases, number per base and method, and seed."""

    library: Library
    methods: Mapping[str, GraftMaker]
    base_names: list[str]
    runs: int
    seed: int

    def measure(
        self, topics: Sequence[str], refusals: dict[str, str], progress: Progress | None
    ) -> "_Measured":
        """Compute the grafts of one method after the other, and measure them for `topics`.

        If a topic, a part of a topic or a whole method cannot be measured, the reason is stored in
        `refusals` by its name.
        """
        bases = None
        found = _Measured()
        if "balance" in topics:
            with _recorded_refusal(refusals, "balance"):
                bases = _Bases.of(self.library, self.base_names)
                found.balance.extend(
                    _balance_rows("recording", bases.recording_samples(), refusals)
                )
        for name, make in self.methods.items():
            with _recorded_refusal(refusals, name):
                grafts = self._grafts(make, progress)
                for position, topic in enumerate(topics):
                    if progress is not None:
                        progress(f"measuring {topic}", position, len(topics))
                    place = topic if name == GRAFTS else f"{topic} of {name}"
                    with _recorded_refusal(refusals, place):
                        self._measure_topic(found, topic, name, grafts)
                if bases is not None:
                    found.balance.extend(bases.rows(name, grafts, refusals))
        if progress is not None:
            progress("measuring", 1, 1)
        return found

    def _measure_topic(
        self, found: "_Measured", topic: str, name: str, grafts: Sequence[Sequence[Graft]]
    ) -> None:
        """Add the measures of the grafts of one method to `found`; those of balance are apart."""
        if topic == "quality":
            found.quality.append(quality(name, grafts, self.seed))
        elif topic == "world":
            found.world.append(world_quality(name, grafts, self.seed))
        elif topic == "detectability":
            found.detectability.append(detectability(name, grafts, self.seed))

    def _grafts(self, make: GraftMaker, progress: Progress | None) -> list[list[Graft]]:
        """Return the grafts of each base."""
        grafts: list[list[Graft]] = []
        for position, base in enumerate(self.base_names):
            if progress is not None:
                progress("grafting", position, len(self.base_names))
            grafts.append(list(make(self.library, base, self.runs, self.seed)))
        return grafts


@dataclass(frozen=True)
class _Measured:
    """Measures of all methods, by topic."""

    balance: list[BalanceRow] = field(default_factory=list)
    quality: list[Quality] = field(default_factory=list)
    world: list[WorldQuality] = field(default_factory=list)
    detectability: list[Detectability] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Bases:
    """Bases with their segments, support polygons, and static and dynamic balance."""

    cuts: list[Segments]
    supports: list[Support]
    balances: dict[str, list[Balance]]

    @classmethod
    def of(cls, library: Library, names: Sequence[str]) -> Self:
        index = {entry.name: clip for clip, entry in enumerate(library.entries)}
        motions = [library.clips[index[name]] for name in names]
        segments = library.segments
        cuts = [segments[segments.of_clip(index[name])] for name in names]
        supports = [support_polygons(motion) for motion in motions]
        pairs = list(zip(motions, supports, strict=True))
        balances = {
            kind: [measure(motion, support=support) for motion, support in pairs]
            for kind, measure in _MEASURES.items()
        }
        return cls(cuts, supports, balances)

    def recording_samples(self) -> dict[str, BalanceSample]:
        """Return the static and dynamic balance of the bases; the only graft of each is itself."""
        changed = [np.ones((1, len(cut)), bool) for cut in self.cuts]
        return {
            kind: BalanceSample(original, [[balance] for balance in original], changed, self.cuts)
            for kind, original in self.balances.items()
        }

    def rows(
        self, method: str, grafts: Sequence[Sequence[Graft]], refusals: dict[str, str]
    ) -> list[BalanceRow]:
        """Return the balance of the grafts of one method, by kind, rule and margin."""
        return _balance_rows(method, self.graft_samples(grafts), refusals)

    def graft_samples(self, grafts: Sequence[Sequence[Graft]]) -> dict[str, BalanceSample]:
        """Return the static and dynamic balance of the bases and their grafts."""
        # The donors may allow fewer different grafts of a base than requested.
        count = min(map(len, grafts))
        grafts = [several[:count] for several in grafts]
        changed = [
            np.stack([_changed_segments(graft, len(cut)) for graft in several])
            for several, cut in zip(grafts, self.cuts, strict=True)
        ]
        samples = {}
        for kind, measure in _MEASURES.items():
            balances = [
                [
                    measure(
                        graft.motion,
                        support=support if has_base_legs(graft) else None,
                        floor_reference=graft.base,
                    )
                    for graft in several
                ]
                for several, support in zip(grafts, self.supports, strict=True)
            ]
            samples[kind] = BalanceSample(self.balances[kind], balances, changed, self.cuts)
        return samples


def _changed_segments(graft: Graft, n_segments: int) -> BoolArray:
    """Return which segments have an exchanged part in at least one group, shape (n_segments,)."""
    is_exchanged = np.array([not s.is_own for s in graft.substitutions])
    return np.asarray(is_exchanged.reshape(-1, n_segments).any(axis=0), bool)


def _balance_rows(
    method: str, samples: Mapping[str, BalanceSample], refusals: dict[str, str]
) -> list[BalanceRow]:
    """Return the results of `balance_row` for one method and all kinds, rules and margins."""
    rows = []
    for kind, sample in samples.items():
        for rule in RULES:
            margins = (0.0, BALANCE_MARGIN) if (kind, rule) == ("static", "all") else (0.0,)
            for margin in margins:
                with _recorded_refusal(refusals, f"{kind} balance"):
                    rows.append(balance_row(method, sample, rule, margin))
    return rows
