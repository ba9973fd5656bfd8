"""Naturalness as people see it: pieces to label, and what their labels say (paper, 5.3).

A person labels pieces with random donors; a classifier learns from some of the labels and is
tested on the others; then it judges the donors of each way. The paper chose the classifier's
parameters on the labels that it was tested on and took what it said as it was; here they are
chosen on the labels that it learns from, and its errors are allowed for.
"""

import csv
import hashlib
import math
import os
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.contacts import Ground
from mograft.body.mass import mass_model
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation._extra import needed
from mograft.evaluation.balance import facing
from mograft.evaluation.baselines import Captured, Method, RandomLength, grafts_by, methods
from mograft.evaluation.estimate import Estimate, rogan_gladen
from mograft.evaluation.naturalness import (
    _by_segment,
    _classifier,
    _donors_drawn,
    _partners,
    _reduced,
    _searched,
    _split,
    _within,
    part_features,
)
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft
from mograft.viewing.page import Page, assemble_page, embed_json

__all__ = [
    "COLUMNS",
    "Item",
    "Judgement",
    "Labels",
    "Verdict",
    "judgement",
    "label_items",
    "label_page",
    "read_labels",
]

COLUMNS = ("clip", "first", "last", "group", "donor_clip", "donor_first", "donor_last")
"""Columns of a table of labels that say which piece was judged; `label` and `seconds` follow."""

FEWEST, FEWEST_OF_A_KIND = 100, 20
"""Labels in all, and of each kind, below which nothing is learned from them."""
_LEAD = 0.4
_RATE = 30.0
_LEARN = 0.6
_VIEW = 0.6
"""Angle in radians from which a figure is seen at the start of its piece."""
_REACH = 4.0
"""Heights that fit into the numbers of a page, either way."""


@dataclass(frozen=True, eq=False)
class Item:
    """A piece to be judged.

    Attributes
    ----------
    graft : Graft
        The motion that it is in.
    group : str
        The grafted group.
    segment, donor : int
        The base segment and the donor, in the library.
    start, stop : int
        Its frames in the motion, both included.
    """

    graft: Graft
    group: str
    segment: int
    donor: int
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Labels:
    """What a person said of pairs of parts.

    Attributes
    ----------
    segment, donor : ndarray of int, shape (n,)
        Base segments and donors.
    natural : ndarray of bool, shape (n,)
        Whether the piece was called natural.
    group : str
        The grafted group.
    """

    segment: IntArray
    donor: IntArray
    natural: BoolArray
    group: str

    def __len__(self) -> int:
        return len(self.natural)


@dataclass(frozen=True)
class Verdict:
    """What a classifier that learned from labels says of one way's donors.

    Attributes
    ----------
    method : str
        The way.
    called : Estimate
        Share of the exchanged parts that it calls natural.
    corrected : Estimate
        The share behind that, by its errors on labels that it has not seen (Rogan-Gladen);
        NaN where it is no better than chance. It may leave 0 to 1.
    """

    method: str
    called: Estimate
    corrected: Estimate

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            "method": self.method,
            "called_natural": self.called.as_dict(),
            "corrected": self.corrected.as_dict(),
        }


@dataclass(frozen=True)
class Judgement:
    """What labels say.

    Attributes
    ----------
    group : str
        The grafted group.
    learned, tested : int
        Labels that the classifier learned from and was tested on.
    natural : Estimate
        Share of the pieces with random donors that were called natural.
    captured : Estimate
        The same of captured pieces that were shown among them: what a perfect way can reach.
    accuracy, sensitivity, specificity : Estimate
        On the labels that it was tested on.
    verdicts : tuple of Verdict
        For each way to choose donors.
    parameters : dict of str to float
        The classifier's.
    """

    group: str
    learned: int
    tested: int
    natural: Estimate
    captured: Estimate
    accuracy: Estimate
    sensitivity: Estimate
    specificity: Estimate
    verdicts: tuple[Verdict, ...]
    parameters: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        found = {
            name: value.as_dict() if isinstance(value, Estimate) else value
            for name, value in vars(self).items()
            if name != "verdicts"
        }
        return {**found, "verdicts": [own.as_dict() for own in self.verdicts]}


def label_items(
    library: Library,
    count: int = 500,
    *,
    captured: int | None = None,
    group: str | None = None,
    way: Method | None = None,
    seed: int = 0,
) -> list[Item]:
    """Draw pieces for a person to judge.

    Parameters
    ----------
    library : Library
        The segments.
    count : int
        Pieces with an exchanged part. The paper has 300 to learn from and 200 to test on.
    captured : int, optional
        Captured pieces to show among them, unmarked. Default: a tenth of `count`.
    group : str, optional
        The grafted group. Default: the first that is not the base.
    way : Method, optional
        How donors are drawn. Default: by chance among those of fitting length, so that
        labels tell of parts that do not go together and not of stretching.
    seed : int
        Of all that is drawn.

    Returns
    -------
    list of Item
        Shuffled; no two of the same base segment and donor.

    Raises
    ------
    InsufficientDataError
        If the library has no so many different pieces.
    """
    if count < 1:
        raise ValueError(f"count must be 1 or more, got {count}")
    group = _chosen(library, group)
    way = RandomLength() if way is None else way
    captured = round(count / 10) if captured is None else captured
    rng = np.random.default_rng(seed)
    made: dict[tuple[int, int], Item] = {}
    own: dict[tuple[int, int], Item] = {}
    rounds = 0
    while len(made) < count and rounds < 40:
        for clip in rng.permutation(len(library.entries)).tolist():
            name = library.entries[clip].name
            graft = grafts_by(way, library, name, swap=[group], seed=int(rng.integers(2**31)))[0]
            for s in graft.substitutions:
                item = Item(graft, group, s.segment, s.donor, s.start, s.stop)
                (own if s.is_own else made)[s.segment, s.donor] = item
            if rounds == 0 and captured and len(own) < captured:
                still = _captured(library, clip, group, seed)
                own |= {(item.segment, item.donor): item for item in still}
            if len(made) > 4 * count + 200:
                break
        rounds += 1
    if len(made) < count or len(own) < captured:
        raise InsufficientDataError(
            f"{count} pieces and {captured} captured ones were wanted, the library gives "
            f"{len(made)} and {len(own)}"
        )
    picked = [list(made.values())[at] for at in rng.choice(len(made), count, replace=False)]
    picked += [list(own.values())[at] for at in rng.choice(len(own), captured, replace=False)]
    return [picked[at] for at in rng.permutation(len(picked))]


def _captured(library: Library, clip: int, group: str, seed: int) -> list[Item]:
    """Return pieces of a clip as it was captured."""
    graft = grafts_by(Captured(), library, library.entries[clip].name, swap=[group], seed=seed)[0]
    return [Item(graft, group, s.segment, s.donor, s.start, s.stop) for s in graft.substitutions]


def _chosen(library: Library, group: str | None) -> str:
    base = library.groups.base
    others = [name for name in library.groups.names if name != base]
    if group is not None and group not in others:
        raise ValueError(f"group must be one of {', '.join(others)}, got {group!r}")
    return others[0] if group is None else group


def _row(library: Library, group: str, segment: int, donor: int) -> tuple[str, ...]:
    """Return what names a pair of parts whatever their numbers are."""
    cut = library.segments
    told: list[str] = []
    for own in (segment, donor):
        frames = (str(int(cut.start[own])), str(int(cut.stop[own])))
        told += [library.clips[int(cut.clip[own])].name, *frames]
    return (*told[:3], group, *told[3:])


def label_page(library: Library, items: Sequence[Item], title: str = "Label motions") -> Page:
    """Return a page that plays pieces and takes a key press for each.

    Parameters
    ----------
    library : Library
        Where the pieces come from.
    items : sequence of Item
        As `label_items` draws them.
    title : str
        The page's title.

    Returns
    -------
    Page
        Self-contained; it keeps the labels in the browser and saves them as ``labels.csv``,
        which `read_labels` reads.

    Raises
    ------
    ValueError
        If there is no item.
    """
    if not items:
        raise ValueError("items must hold at least one piece, got none")
    skeleton = library.clips[0].skeleton
    members = list(library.groups.names)
    owner = np.zeros(skeleton.n_joints, int)
    for index, name in enumerate(members):
        owner[library.joints(name)] = index
    sites = [site.parent for site in skeleton.end_sites]
    rows = [_row(library, item.group, item.segment, item.donor) for item in items]
    step = max(round(library.rate / _RATE), 1)
    unit = _REACH / 32767
    places: dict[int, tuple[FloatArray, FloatArray]] = {}
    for item in items:
        if id(item.graft) not in places:
            places[id(item.graft)] = _standing(item.graft.motion, item.graft.base)
    shown = []
    for item, row in zip(items, rows, strict=True):
        lead = round(_LEAD * library.rate)
        first = max(item.start - lead, 0)
        last = min(item.stop + lead, item.graft.motion.n_frames - 1)
        frames = np.arange(first, last + 1, step)
        nodes, heading = (own[frames] for own in places[id(item.graft)])
        nodes = nodes - nodes[len(nodes) // 2].mean(axis=0) * [1.0, 0.0, 1.0]
        nodes = rotations.rotate(rotations.exp([0.0, _VIEW - heading[0], 0.0]), nodes)
        whole = np.clip(np.round(nodes / unit), -32767, 32767).astype("<i2")
        shown.append(
            {
                "row": list(row),
                "frames": len(frames),
                "first": int(np.ceil((item.start - first) / step)),
                "last": int((item.stop - first) // step),
                "pos": b64encode(whole.tobytes()).decode("ascii"),
            }
        )
    key = hashlib.sha256(repr(rows).encode()).hexdigest()[:16]
    values = {
        "key": key,
        "columns": COLUMNS,
        "parents": [*skeleton.parents.tolist(), *sites],
        "group": owner.tolist(),
        "dt": step / library.rate,
        "unit": unit,
        "items": shown,
    }
    text = f"{_part('label.html')}\n{embed_json(values)}"
    return assemble_page(title, text, "report", _part("label.css"), _part("label.js"))


def _standing(motion: Motion, base: Motion) -> tuple[FloatArray, FloatArray]:
    """Return joints and ends in heights, y up from the floor, and where the hips face about y."""
    ground = Ground.of(base)
    turns, joints = motion.world_transforms()
    ends = [
        joints[:, site.parent] + rotations.rotate(turns[:, site.parent], np.asarray(site.offset))
        for site in motion.skeleton.end_sites
    ]
    nodes = np.concatenate([joints, *(end[:, None] for end in ends)], axis=1)
    up = int(np.flatnonzero(ground.up)[0])
    low = (nodes @ ground.up).min() if not ground.floors.size else ground.floors.min()
    # With z up x, y, z become y, z, x: a turn and no reflection, also where up is down.
    order = [(up + 2) % 3, up, (up + 1) % 3]
    signs = np.array([ground.up[up], ground.up[up], 1.0])
    y_up = nodes[..., order] * signs - [0.0, float(low), 0.0]
    ahead = facing(motion, ground)[:, order] * signs
    return y_up / mass_model(motion.skeleton).height, np.arctan2(ahead[:, 0], ahead[:, 2])


@cache
def _part(name: str) -> str:
    return files("mograft.evaluation").joinpath(name).read_text(encoding="utf-8").strip()


def read_labels(path: str | os.PathLike[str], library: Library) -> Labels:
    """Read labels that a person has given.

    Parameters
    ----------
    path : str or path
        The table that the page has saved.
    library : Library
        Built of the same files by the same configuration as the page.

    Returns
    -------
    Labels
        One for each row.

    Raises
    ------
    ValueError
        If it is no such table, or a row is of a segment that the library has not; with its
        line.
    """
    cut = library.segments
    names = [clip.name for clip in library.clips]
    known = {
        (names[clip], start, stop): index
        for index, (clip, start, stop) in enumerate(
            zip(cut.clip.tolist(), cut.start.tolist(), cut.stop.tolist(), strict=True)
        )
    }
    found: list[tuple[int, int, bool]] = []
    groups: set[str] = set()
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: no UTF-8: {error}") from error
    rows = csv.reader(text.splitlines())
    head = next(rows, [])
    if tuple(head[: len(COLUMNS) + 1]) != (*COLUMNS, "label"):
        wanted = ",".join((*COLUMNS, "label"))
        raise ValueError(f"{path}:1: must begin with {wanted}; got {','.join(head)[:120]}")
    for number, row in enumerate(rows, start=2):
        if not row:
            continue
        place = f"{path}:{number}"
        if len(row) < len(COLUMNS) + 1:
            raise ValueError(f"{place}: must have {len(COLUMNS) + 1} columns, got {len(row)}")
        own = (row[0], *row[1:3]), (row[4], *row[5:7])
        indices = []
        for clip, first, last in own:
            if not (first.isdecimal() and last.isdecimal()):
                raise ValueError(f"{place}: frames must be whole numbers, got {first}, {last}")
            key = (clip, int(first), int(last))
            if key not in known:
                raise ValueError(
                    f"{place}: {clip} has no segment {first}-{last} in this library; labels are "
                    "read with the files and options that their page was made with"
                )
            indices.append(known[key])
        label = row[len(COLUMNS)]
        if label not in ("natural", "unnatural"):
            raise ValueError(f"{place}: label must be natural or unnatural, got {label!r}")
        groups.add(row[3])
        found.append((indices[0], indices[1], label == "natural"))
    if len(groups) > 1 or (groups and not groups <= set(library.groups.names)):
        shown = ", ".join(sorted(groups))
        raise ValueError(f"{path}: labels must be of one group of the library, got {shown}")
    table = np.array(found, np.int64).reshape(-1, 3)
    group = groups.pop() if groups else _chosen(library, None)
    return Labels(table[:, 0], table[:, 1], table[:, 2].astype(bool), group)


def judgement(
    library: Library,
    labels: Labels,
    ways: Sequence[Method] | None = None,
    *,
    seed: int = 0,
) -> Judgement:
    """Learn from labels what is natural, and judge ways to choose donors by it.

    Parameters
    ----------
    library : Library
        The segments.
    labels : Labels
        A person's.
    ways : sequence of Method, optional
        Ways to choose donors. Default: `methods` of the library.
    seed : int
        Of the split and the resampling.

    Returns
    -------
    Judgement
        The intervals of corrected shares hold the errors of the test labels as well as the
        choice of segments.

    Raises
    ------
    InsufficientDataError
        If there are fewer than 100 labels of pieces with exchanged parts, or fewer than 20 of
        either kind, or only one of the kinds is in the learned or the tested part.
    ImportError
        If scikit-learn is not installed.

    Notes
    -----
    Three fifths of the labels are learned from, as 300 of the paper's 500; neighbouring
    segments are on one side. A support vector machine judges principal components of
    `part_features` of both parts, its parameters chosen by cross-validation on what it learns
    from. Seams are not among these: it judges whether parts go together.
    """
    ways = methods(library) if ways is None else ways
    exchanged = labels.segment != labels.donor
    natural = labels.natural[exchanged]
    few = min(int(natural.sum()), int((~natural).sum()))
    if len(natural) < FEWEST or few < FEWEST_OF_A_KIND:
        raise InsufficientDataError(
            f"labels of {FEWEST} exchanged parts are needed, {FEWEST_OF_A_KIND} of each kind; "
            f"there are {len(natural)}: {int(natural.sum())} natural, {int((~natural).sum())} not"
        )
    needed("sklearn")
    pairs = np.stack([labels.segment[exchanged], labels.donor[exchanged]], axis=1)
    block = estimate.blocks(library.segments)
    learns = _learning(block[pairs[:, 0]], seed)
    if len(np.unique(natural[learns])) < 2 or len(np.unique(natural[~learns])) < 2:
        raise InsufficientDataError("both kinds of labels must be among those learned and tested")
    everyone = np.arange(len(library.segments))
    halves = [
        _reduced(part_features(library, group), everyone)
        for group in (library.groups.base, labels.group)
    ]

    def joined(some: IntArray) -> FloatArray:
        return np.concatenate([halves[0][some[:, 0]], halves[1][some[:, 1]]], axis=1)

    inner = _split(np.unique(block[pairs[learns, 0]], return_inverse=True)[1], 3, seed)
    truth = natural.astype(np.int64)
    chosen = _searched(joined(pairs[learns]), truth[learns], inner)
    machine = _classifier(chosen).fit(joined(pairs[learns]), truth[learns])
    said = machine.predict(joined(pairs[~learns])).astype(bool)
    tested = natural[~learns]
    counts = [
        (int((said == tested).sum()), len(tested)),
        (int((said & tested).sum()), int(tested.sum())),
        (int((~said & ~tested).sum()), int((~tested).sum())),
    ]
    accuracy, sensitivity, specificity = (estimate.share(*own, "test labels") for own in counts)

    rng = np.random.default_rng(seed)
    drawn = {
        way.name: _donors_drawn(library, labels.group, way, seed) for way in ways if way.by_cost
    }
    partners = _partners(library, ways, np.zeros(len(everyone), np.int64), drawn)
    verdicts = []
    for way in ways:
        several = _within(partners[way.name], everyone, rng)
        values = np.full(len(everyone), np.nan)
        if len(several):
            calls = machine.predict(joined(several)).astype(np.float64)
            values = _by_segment(calls, several, len(everyone))
        called = estimate.mean(values, block, "segments with a donor", seed)
        verdicts.append(Verdict(way.name, called, _corrected(called, values, block, counts, seed)))
    return Judgement(
        group=labels.group,
        learned=int(learns.sum()),
        tested=len(tested),
        natural=estimate.share(int(natural.sum()), len(natural), "exchanged pieces"),
        captured=estimate.share(
            int(labels.natural[~exchanged].sum()), int((~exchanged).sum()), "captured pieces"
        ),
        accuracy=accuracy,
        sensitivity=sensitivity,
        specificity=specificity,
        verdicts=tuple(verdicts),
        parameters=chosen,
    )


def _learning(block: IntArray, seed: int) -> BoolArray:
    """Return which labels to learn from: whole blocks, three fifths of the labels or just more."""
    own, index = np.unique(block, return_inverse=True)
    order = np.random.default_rng(seed).permutation(len(own))
    sizes = np.bincount(index)[order]
    n_learned = int(np.searchsorted(np.cumsum(sizes), _LEARN * len(block))) + 1
    taken: BoolArray = np.isin(index, order[:n_learned])
    return taken


def _corrected(
    called: Estimate,
    values: FloatArray,
    block: IntArray,
    counts: Sequence[tuple[int, int]],
    seed: int,
) -> Estimate:
    """Return the share behind what an imperfect classifier calls natural."""
    (sensitive, positives), (specific, negatives) = counts[1:]
    whole = rogan_gladen(called.value, sensitive / positives, specific / negatives)
    how = f"{called.interval}, and of the test labels"
    of = "segments with a donor"
    # A classifier whose gain over chance may be nothing corrects nothing.
    low_gain = sum(estimate.share(*own, "").low for own in counts[1:]) - 1.0
    if not math.isfinite(whole) or low_gain <= 0:
        return Estimate(math.nan, math.nan, math.nan, called.n, of, how)
    kept = np.isfinite(values)
    own, index = np.unique(block[kept], return_inverse=True)
    sums, sizes = np.bincount(index, values[kept]), np.bincount(index).astype(np.float64)
    rng = np.random.default_rng(seed)

    def statistic(drawn: FloatArray) -> FloatArray:
        rates = (drawn @ sums) / (drawn @ sizes)
        se = rng.binomial(positives, sensitive / positives, len(drawn)) / positives
        sp = rng.binomial(negatives, specific / negatives, len(drawn)) / negatives
        gain = se + sp - 1.0
        found: FloatArray = np.where(gain > 0, (rates + sp - 1.0) / gain, np.nan)
        return found

    low, high = estimate.bootstrap(statistic, len(own), seed)
    return Estimate(whole, float(low[0]), float(high[0]), called.n, of, how)
