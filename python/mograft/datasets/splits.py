"""Parts of a library, such as train, val and test, that have no motion in common."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from os import PathLike
from pathlib import Path

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft.datasets.copies import find_shared_clips
from mograft.errors import join_names, suggest_name
from mograft.library.clip_keys import csv_rows, plain_tags
from mograft.library.library import Library

Split = str | PathLike[str] | Mapping[str, str]
"""A table from clips to parts, its CSV file, or ``auto:clip``, ``auto:file`` or ``auto:tag``."""

AUTOMATIC_SHARES = {"train": 0.8, "val": 0.1, "test": 0.1}
"""Parts of automatic splits, with their shares of all frames."""


@dataclass(frozen=True, eq=False)
class Part:
    """The clips of one part of a split."""

    name: str  # "all" without a split
    clips: BoolArray  # (n_clips,): whether each clip of the library is in the part
    shared: tuple[str, ...] = ()  # clips that were left out: other parts hold the same motion
    n_others: int = 0  # clips in other parts


def select_part(library: Library, split: Split | None, name: str, seed: int) -> Part:
    """Return one part of a split, without clips whose motion also occurs in another part.

    Raise ValueError if there is no such part, or if the split does not fit the library.
    """
    if split is None:
        return Part("all", np.ones(len(library.entries), bool))
    parts = assign_parts(library, split, seed)
    names = sorted({own for own in parts if own})
    if name not in names:
        hint = suggest_name(name, names)
        raise ValueError(f"`part` must be one of {', '.join(names)}; got {name!r}{hint}")
    ours = np.array([own == name for own in parts])
    others = np.array([own not in (name, "") for own in parts])
    shared = find_shared_clips(library, ours, others)
    kept, clips = ours.copy(), library.names
    kept[shared] = False
    if not kept.any():
        raise ValueError(f"`split` leaves no clip in {name}: other parts hold the same motion")
    return Part(name, kept, tuple(clips[clip] for clip in shared.tolist()), int(others.sum()))


def assign_parts(library: Library, split: Split, seed: int = 0) -> list[str]:
    """Return the part of each clip; "" for clips that the table does not list."""
    if isinstance(split, Mapping):
        return _parts_of_table(library, split, "`split`")
    text = str(split)
    if text.startswith("auto:"):
        return _automatic_parts(library, text, seed)
    if not (Path(text).suffix or Path(text).exists()):
        raise ValueError(
            "`split` must be a CSV file of clips and parts, auto:clip, auto:file or auto:tag; "
            f"got {text!r}"
        )
    return _parts_of_table(library, read_split(Path(text)), text)


def read_split(path: Path) -> dict[str, str]:
    """Read a CSV file whose rows have a clip, and its part.

    The clip is a name, a file, a glob of these, or ``tag:`` followed by a tag. A first row that
    begins with ``clip``, ``file`` or ``tag`` is a heading. Raise ValueError with the number of the
    line of an invalid row, and for a clip that is in two parts.
    """
    table: dict[str, str] = {}
    for line, cells in csv_rows(path):
        if line == 1 and cells[0].lower() in ("clip", "file", "tag"):
            continue
        if len(cells) != 2 or not all(cells):
            raise ValueError(f"{path}:{line}: expected a clip and its part, got {cells}")
        if table.setdefault(*cells) != cells[1]:
            known = table[cells[0]]
            raise ValueError(f"{path}:{line}: {cells[0]} is in {known} and in {cells[1]}")
    return table


def _parts_of_table(library: Library, table: Mapping[str, str], source: str) -> list[str]:
    parts, listed = [""] * len(library.entries), list[list[str]]()
    for entry in library.entries:
        file = "" if entry.source_file is None else entry.source_file.path
        listed.append([entry.name, file, Path(file).name, *(f"tag:{tag}" for tag in entry.tags)])
    for pattern, part in table.items():
        is_glob, n_found = bool(set(pattern) & set("*?[")), 0
        for clip, keys in enumerate(listed):
            if pattern in keys or (is_glob and any(fnmatchcase(key, pattern) for key in keys)):
                n_found += 1
                if parts[clip] not in ("", part):
                    name = library.entries[clip].name
                    raise ValueError(f"{source}: {name} is in {parts[clip]} and in {part}")
                parts[clip] = part
        if not n_found:
            hint = "" if is_glob else suggest_name(pattern, library.names)
            raise ValueError(f"{source}: no clip of the library matches {pattern!r}{hint}")
    return parts


def _automatic_parts(library: Library, text: str, seed: int) -> list[str]:
    """Return parts of about `AUTOMATIC_SHARES` of the frames; whole units are in one part."""
    _, kind, pattern = [*text.split(":", 2), ""][:3]
    if kind not in ("clip", "file", "tag") or (pattern and kind != "tag"):
        raise ValueError(
            f"`split` must be a file, auto:clip, auto:file, auto:tag or auto:tag:GLOB, got {text!r}"
        )
    units = _units(library, kind, pattern)
    n_frames = np.bincount(units, [entry.n_frames for entry in library.entries])
    if len(n_frames) < len(AUTOMATIC_SHARES):
        raise ValueError(
            f"`split` needs at least {len(AUTOMATIC_SHARES)} groups of clips, {text} gives "
            f"{len(n_frames)}; auto:tag:GLOB selects tags, such as those of performers"
        )
    names, shares = list(AUTOMATIC_SHARES), np.array(list(AUTOMATIC_SHARES.values()))
    # Hashes of names do not depend on the order of the clips.
    firsts = dict(sorted(zip(units.tolist(), library.names, strict=True), reverse=True))
    texts = {own: f"{seed} {name}".encode("utf-8", "surrogatepass") for own, name in firsts.items()}
    order = sorted(texts, key=lambda own: hashlib.sha256(texts[own]).digest())
    assigned, part_of = np.zeros(len(names)), np.zeros(len(n_frames), np.int64)
    for n_left, unit in zip(range(len(order), 0, -1), order, strict=True):
        lacking = shares - assigned / n_frames.sum()
        if n_left <= (assigned == 0).sum():  # no part stays empty
            lacking = np.where(assigned == 0, lacking, -1.0)
        part_of[unit] = int(np.argmax(lacking))
        assigned[part_of[unit]] += n_frames[unit]
    return [names[part_of[unit]] for unit in units.tolist()]


def _units(library: Library, kind: str, pattern: str) -> IntArray:
    """Return for each clip the number of its unit: clips with a file or tag in common are one."""
    keys: list[list[str]] = []
    for entry in library.entries:
        file, tags = entry.source_file, plain_tags(entry)
        if pattern:
            tags = tuple(tag for tag in entry.tags if fnmatchcase(tag, pattern))
        if kind != "tag":
            tags = (file.sha256 if file and kind == "file" else entry.name,)
        keys.append(list(tags) or [f"\0{entry.name}"])
    if kind == "tag" and not any(own and not own[0].startswith("\0") for own in keys):
        known = join_names(sorted({tag for entry in library.entries for tag in plain_tags(entry)}))
        raise ValueError(f"`split` needs tags, no clip has one that matches; the tags: {known}")
    parent: dict[str, str] = {}

    def find(key: str) -> str:
        while parent.setdefault(key, key) != key:
            key = parent[key]
        return key

    for first, *more in keys:
        for key in more:
            parent[find(key)] = find(first)
    numbers: dict[str, int] = {}
    return np.array([numbers.setdefault(find(own[0]), len(numbers)) for own in keys])
