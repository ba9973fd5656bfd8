"""Replay: a graft made again from its provenance, without a search."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from mograft._util.validate import check_type
from mograft.blend.reach_completion import ReachCompletion
from mograft.config import Config
from mograft.errors import DAMAGE, ProvenanceError
from mograft.library.library import Library
from mograft.library.origin import hash_poses
from mograft.provenance.graft_change import apply_changes, is_among
from mograft.provenance.graft_edit import splice_versions
from mograft.provenance.graft_record import (
    GraftRecord,
    RecordedLibrary,
    as_frames,
    find_library,
    read_motion,
    read_record,
)
from mograft.scenario import Scenario
from mograft.search.constraint_records import UnrestoredConstraint, decode_constraint
from mograft.search.constraints import Constraint, Violation
from mograft.search.pose_constraints import Reach
from mograft.search.trellis import DonorSequences
from mograft.solve.assembly import Assembly
from mograft.solve.plan import GraftPlan
from mograft.solve.self_repair import RepairedWindow
from mograft.synthesis.graft_building import finish_graft
from mograft.synthesis.graft_result import Change, Graft, GraftRequest


def replay(
    source: str | PathLike[str] | Mapping[str, Any],
    library: Library | None = None,
    *,
    sources: Sequence[str] = (),
    config: Config | None = None,
) -> Graft:
    """Make a graft again from its provenance, bit for bit.

    The donors are those of the provenance; nothing is searched.

    Parameters
    ----------
    source : path or mapping
        The ``.json`` file beside a graft, or a document that `Graft.as_dict` returned.
    library : Library, optional
        The library of the graft. Default: the stored library that the provenance names; if it is
        missing or has changed, a library of the clips of which the graft is made, read from their
        files.
    sources : sequence of str
        Files and folders. The files of clips that are not at the path in the provenance are
        searched for among them.
    config : Config, optional
        The configuration of the graft with other fields of the stage "blend": the same donors, with
        other seams, feet and limbs. Default: the recorded configuration.

    Returns
    -------
    Graft
        The graft. If no complete library was found, `Graft.library` has only the clips of the
        graft.

    Raises
    ------
    ValueError
        If `config` differs in other fields.
    ProvenanceError
        If the provenance is damaged or of another schema; if the library or a file is missing or
        has another SHA-256; if the motion differs from that of the provenance, because another
        version of mograft made it.
    OSError
        If a file cannot be read.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> library = mg.Library.build(dance(strides=1).motion)
    >>> document = mg.graft_record(mg.graft(library, seed=7))
    >>> mg.replay(document, library)
    Graft(dance_graft0: 196 of 197 parts exchanged)
    """
    record = read_record(source)
    if library is not None:
        check_type("library", library, Library)
    if config is not None:
        changed = record.config.changed_fields(config)
        changed.pop("blend", None)
        if changed:
            name = next(iter(changed.values()))[0]
            raise ValueError(f"`config` must differ in fields of blending only, got {name}")
        record = replace(record, config=config)
    try:
        return _replay(record, library, sources)
    except ProvenanceError:
        raise
    except DAMAGE as error:
        raise record.error(f"damaged: {error}") from error


def _replay(record: GraftRecord, library: Library | None, sources: Sequence[str]) -> Graft:
    """Return the graft of a record; damaged values raise one of the exceptions in `DAMAGE`."""
    recorded = find_library(record, library, sources)
    groups = list(dict.fromkeys(own.group for own in record.donors))
    scenario = _read_scenario(record, recorded)
    plan = GraftPlan.build(recorded.library, recorded.base, groups, (), scenario)
    versions = _find_versions(record, recorded, plan)
    request = replace(_read_request(record, sources), scenario=plan.scenario)
    graft = _finish_versions(record, plan, versions, request.constraints)
    graft = _with_recorded(graft, record, request)
    changed = apply_changes(graft, plan.problem, _read_changes(record, plan))
    expected, found = record.document["poses_sha256"], hash_poses(changed.motion)
    if record.has_own_config and expected != found:
        raise record.error(
            f"the motion differs from that of the provenance: SHA-256 of its poses {found}, "
            f"expected {expected}; another version of mograft made it"
        )
    return replace(changed, violations=graft.violations)


def _read_scenario(record: GraftRecord, recorded: RecordedLibrary) -> Scenario | None:
    own = record.document["scenario"]
    if own is None:
        return None
    segments = [
        recorded.find_segment(record, str(segment["clip"]), as_frames(segment["clip_frames"]))
        for segment in own["segments"]
    ]
    return Scenario(
        np.array(segments),
        None if own["lengths"] is None else np.array(own["lengths"], np.int64),
        None if own["place"] is None else np.array(own["place"], float),
        float(own["turn"]),
    )


def _find_versions(
    record: GraftRecord, recorded: RecordedLibrary, plan: GraftPlan
) -> list[DonorSequences]:
    """Return the donors before each edit, oldest first, and last those of the graft."""
    cut, scenario = plan.problem.base_segments, plan.problem.scenario.tolist()
    frames = list(zip(cut.start.tolist(), cut.stop.tolist(), strict=True))
    for group in plan.pools:
        if [own.frames for own in record.donors if own.group == group] != frames:
            raise record.error(f"the segments of {record.base} differ from those of the graft")
    position_of = {own: position for position, own in enumerate(frames)}
    donors: DonorSequences = plan.problem.captured_donors
    versions: list[DonorSequences] = []
    for changes in (record.donors, *reversed(record.edits)):
        donors = {group: own.copy() for group, own in donors.items()}
        for own in changes:
            position = position_of[own.frames]
            donors[own.group][position] = (
                scenario[position]
                if own.is_own
                else recorded.find_segment(record, own.clip, own.clip_frames)
            )
        versions.insert(0, donors)
    return versions


def _read_changes(record: GraftRecord, plan: GraftPlan) -> list[Change]:
    """Return the recorded changes; raise ProvenanceError if a group, clip or frame is unknown."""
    changes, clips = [], plan.problem.library
    for own in record.document["changes"]:
        frames = {name: as_frames(own[name]) for name in ("frames", "clip_frames")}
        made = Change(**{**own, **frames})
        is_known = made.group in plan.pools and made.clip in clips.names
        n_frames = is_known and clips.clips[clips.names.index(made.clip)].n_frames
        spans = ((made.frames, plan.problem.base.n_frames), (made.clip_frames, n_frames))
        if not all(0 <= first < last < n for (first, last), n in spans):
            raise record.error(f"`changes` has a group, clip or frame that does not exist: {made}")
        changes.append(made)
    return changes


def _finish_versions(
    record: GraftRecord,
    plan: GraftPlan,
    versions: Sequence[DonorSequences],
    constraints: Sequence[Constraint],
) -> Graft:
    """Return the graft of the last donors; the edits are made one after the other.

    In each version, inverse kinematics moves only the limbs that it moved according to `record`, if
    that has its own configuration.
    """
    document, seed = record.document, int(record.document["seed"])
    is_same = record.has_own_config
    recorded = [_read_completions(own, constraints) for own in [*document["edits"], document]]
    every = [own for own in constraints if type(own) is Reach and own.weight != 0]
    completions: list[tuple[ReachCompletion, ...]] = []
    graft: Graft | None = None
    for index, (donors, found) in enumerate(zip(versions, recorded, strict=True)):
        assembly = Assembly.build(plan.problem, donors, record.name)
        reaches, adjust = [own.reach for own in found] if is_same else every, None
        if graft is not None:
            known = [own.reach for own in completions[-1]]
            # Both those that were added and those that were removed.
            other = [own for own in reaches if not is_among(own, known)]
            other += [own for own in known if not is_among(own, reaches)]
            steps = versions[index - 1], donors
            adjust = partial(splice_versions, plan.problem, *steps, graft.motion, reaches=other)
        moved = [own.reach for own in found if own.is_moved] if is_same else every
        graft = finish_graft(plan.problem, assembly, seed, index, adjust, moved)
        completions.append(found if is_same else graft.reach_completions)
    assert graft is not None
    return replace(
        graft,
        index=int(document["index"]),
        history=tuple(versions[:-1]),
        reach_completions=completions[-1],
        completion_history=tuple(completions[:-1]),
    )


def _read_request(record: GraftRecord, sources: Sequence[str]) -> GraftRequest:
    """Return the recorded request without its scenario."""
    request = record.document["request"]

    decode = partial(read_motion, record=record, sources=sources)
    swap = request["swap"]
    constraints = [decode_constraint(own, decode) for own in request["constraints"]]
    return GraftRequest(
        **{name: request[name] for name in ("method", "base", "command")},
        swap=None if swap is None else tuple(swap),
        constraints=tuple(constraints),
        sources=record.sources,
        edit_commands=tuple(edit["command"] for edit in record.document["edits"]),
    )


def _with_recorded(graft: Graft, record: GraftRecord, request: GraftRequest) -> Graft:
    """Return the graft with the recorded results of the search, which replay does not repeat.

    Those that depend on blending, too, are left out if the record has another configuration.
    """
    costs = {(own.group, own.frames): own.cost for own in record.donors}
    alternatives = {
        group: np.array([own.alternatives for own in record.donors if own.group == group])
        for group in graft.alternatives
    }
    document = record.document
    blended = document if record.has_own_config else {"violations": (), "self_repair": ()}
    return replace(
        graft,
        substitutions=tuple(
            own._replace(cost=costs[own.group, (own.start, own.stop)])
            for own in graft.substitutions
        ),
        alternatives=alternatives,
        violations=tuple(
            _read_violation(own, request.constraints) for own in blended["violations"]
        ),
        self_repairs=tuple(_read_repair(own) for own in blended["self_repair"]),
        remarks=tuple(map(str, document["remarks"])),
        request=request,
    )


def _read_violation(record: Mapping[str, Any], constraints: Sequence[Constraint]) -> Violation:
    number, unknown = record["number"], UnrestoredConstraint(str(record["constraint"]))
    return Violation(
        constraint=unknown if number is None else constraints[number],
        frames=as_frames(record["frames"]),
        worst=int(record["worst_frame"]),
        error=float(record["tolerances"]),
        joint=str(record["joint"]),
        message=str(record["message"]),
    )


def _read_completions(
    document: Mapping[str, Any], constraints: Sequence[Constraint]
) -> tuple[ReachCompletion, ...]:
    """Return what inverse kinematics did according to a document, or to one of its ``edits``."""
    found = []
    for own in document["reach_ik"]:
        reach = constraints[own["number"]]
        if not isinstance(reach, Reach):
            raise ValueError("each `number` in `reach_ik` must be that of a Reach constraint")
        found.append(
            ReachCompletion(
                reach=reach,
                frames=as_frames(own["frames"]),
                before=float(own["before_heights"]),
                after=float(own["after_heights"]),
                reason=str(own["reason"]),
            )
        )
    return tuple(found)


def _read_repair(record: Mapping[str, Any]) -> RepairedWindow:
    start, stop = as_frames(record["frames"])
    kinds = {"group": str, "measure": str, "before": float, "after": float}
    values: dict[str, Any] = {name: kind(record[name]) for name, kind in kinds.items()}
    return RepairedWindow(start=start, stop=stop, **values)
