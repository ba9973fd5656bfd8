# SPDX-License-Identifier: GPL-3.0-or-later
"""Grafts from motions: what runs in the worker thread, without any data of Blender."""

import hashlib
import json
import warnings
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

import mograft as mg

VARIETIES = (
    ("LOW", "Little", "Few changes, from very similar parts", 0.2),
    ("MEDIUM", "Medium", "The default", 0.5),
    ("HIGH", "Much", "Many changes, also from less similar parts", 0.8),
    ("MAXIMUM", "As much as possible", "Nearly all parts change; seams are wider", 1.0),
)
"""The words of the panel, with the variety of `Config.with_variety`."""

_libraries = {}
"""The library of the last call, by the hash of all that determines it."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """The arguments of `make` and `change`."""

    motions: tuple
    match: str
    is_mirrored: bool
    others: dict  # by number of the constraint, what a setup stores of an avoided armature
    bases: tuple = ()  # names of clips
    groups: object = None  # JointGroups, or the name of a preset
    config: mg.Config | None = None
    count: int = 1
    seed: int = 0
    constraints: tuple = ()


@dataclass(frozen=True, kw_only=True)
class Result:
    """A graft as Blender stores it."""

    graft: mg.Graft
    record: str
    ranges: tuple  # of dict
    newness: str
    others: dict
    notes: tuple


def build_library(request, groups, config, report):
    """Return the library of motions, which is kept for the next call."""
    digest = hashlib.sha256()
    for own in request.motions:
        for array in (own.rotations, own.positions, own.skeleton.offsets):
            digest.update(np.ascontiguousarray(array))
        digest.update(json.dumps([own.name, own.frame_time, own.skeleton.names]).encode())
    options = [request.match, request.is_mirrored, str(groups), config.as_dict()]
    digest.update(json.dumps(options).encode())
    key = digest.hexdigest()
    if key not in _libraries:
        hierarchy = request.motions[0].skeleton if request.match == "anatomy" else None
        options = {"match": request.match, "hierarchy": hierarchy, "progress": report}
        options["mirrored"] = request.is_mirrored
        library = mg.Library.build(request.motions, groups, config, **options)
        forget()
        _libraries[key] = library
    return _libraries[key]


def forget():
    """Drop the library that is kept."""
    _libraries.clear()


def make(request, report):
    """Return new grafts on all bases, as `Result`."""
    with _noted() as notes:
        library = build_library(request, request.groups, request.config, report)
        results, number, total = [], 0, len(request.bases) * request.count
        for base in request.bases:
            grafts = mg.graft_many(
                library, base, request.count, constraints=request.constraints, seed=request.seed
            )
            notes += list(grafts.notes)
            motions = []
            for graft in grafts:
                report("grafts", number, total)
                number += 1
                results.append(_result(graft, motions, request.others, request.constraints))
                motions.append(graft.motion)
            made = [own.graft.substitutions for own in results[-len(grafts) :]]
            notes += mg.advise(grafts[0], made)
    return [replace(own, notes=tuple(dict.fromkeys(notes))) for own in results]


def change(request, record, edit, report):
    """Return the graft of a provenance after `edit`, a function of a graft; None repeats it."""
    with _noted() as notes:
        document = json.loads(record)
        groups = mg.JointGroups.from_toml(document["groups_toml"] + "\n")
        config = mg.Config.from_dict(document["config"])
        library = build_library(request, groups, config, report)
        report("graft", 0, 1)
        try:
            graft = mg.replay(document, library)
        except mg.ProvenanceError as error:
            reason = str(error).removeprefix("document: ")
            raise mg.ProvenanceError(
                f"{document['name']} cannot be made again: a source was changed ({reason})"
            ) from error
        known = dict(enumerate(graft.request.constraints))
        known |= {number: constraint for number, (constraint, _) in request.others.items()}
        restored = replace(graft.request, constraints=tuple(known.values()))
        graft = replace(graft, request=restored)
        if edit is not None:
            graft = edit(graft)
        others = {number: other for number, (_, other) in request.others.items()}
        result = _result(graft, [], others, known)
    return replace(result, notes=tuple(dict.fromkeys(notes)))


@contextmanager
def _noted():
    """Collect the warnings while a block runs, as text."""
    notes = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield notes
    notes += [str(own.message) for own in caught]


def _result(graft, motions, others, constraints):
    """Return a graft with its provenance; `others` belong to `constraints` by number."""
    document, now = mg.graft_record(graft), {}
    for number, constraint in enumerate(graft.request.constraints):
        for old, other in others.items():
            if constraint is constraints[old]:
                now[number] = other
                # The motion of an armature is in no file: the setup stores where it is.
                record = {"kind": "Avoid", "name": other["armature"], "is_restored": False}
                document["request"]["constraints"][number] = record
    return Result(
        graft=graft,
        record=json.dumps(document),
        ranges=tuple(_ranges(graft)),
        newness=str(mg.newness(graft, motions)),
        others=now,
        notes=(),
    )


def _ranges(graft):
    """Yield the exchanged ranges of a graft: frames, donor, mean cost and newness in degrees."""
    library, angles = graft.library, {}
    for group in graft.alternatives:
        joints = library.joints(group)
        turned = [own.rotations[:, joints] for own in (graft.motion, graft.base)]
        angles[group] = np.degrees(mg.rotations.angle(*turned)).mean(axis=1)
    found = []
    for own in graft.substitutions:
        last = found[-1] if found else None
        if own.is_own:
            continue
        follows = last is not None and (last["group"], last["clip"]) == (own.group, own.clip)
        if follows and (last["last"], last["donor_last"]) == (own.start, own.donor_start):
            last |= {"last": own.stop, "donor_last": own.donor_stop}
            last["costs"].append(own.cost)
            continue
        place = {"group": own.group, "first": own.start, "last": own.stop, "clip": own.clip}
        donor = {"donor_first": own.donor_start, "donor_last": own.donor_stop}
        found.append({**place, **donor, "costs": [own.cost]})
    for own in graft.changes:
        (first, last), (donor_first, donor_last) = own.frames, own.clip_frames
        found = [
            old
            for old in found
            if old["group"] != own.group or old["first"] < first or old["last"] > last
        ]
        place = {"group": own.group, "first": first, "last": last, "clip": own.clip}
        found.append({**place, "donor_first": donor_first, "donor_last": donor_last, "costs": []})
    for own in sorted(found, key=lambda item: (item["first"], item["group"])):
        frames = slice(own["first"], own["last"] + 1)
        costs = own.pop("costs")
        yield {
            **own,
            "cost": float(np.mean(costs)) if costs else 0.0,
            "newness": float(angles[own["group"]][frames].mean()),
        }
