"""Build a library in memory; choose its joint groups: given, of a preset, or discovered."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar, Unpack

import numpy as np

from mograft._util.arrays import BoolArray
from mograft._util.names import automatic_number, is_automatic, unique_names
from mograft.analysis.embedding import Embedding, Samples
from mograft.analysis.group_discovery import MAX_CLIPS, GroupDiscovery, discover_in_segments
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.library import clusters
from mograft.library.clip_table import ClipInfo
from mograft.library.data import LibraryData
from mograft.library.discover import ClipSource
from mograft.library.files.stored_clips import JoinedSamples
from mograft.library.ingest import IngestedClip
from mograft.library.ingest_run import IngestOptions, IngestPlan, ingest_motions, warn_of_clips
from mograft.library.spec import LibrarySpec
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton

L = TypeVar("L", bound=LibraryData)
T = TypeVar("T")


def build_library(
    library_type: type[L], sources: ClipSource | Iterable[ClipSource], plan: IngestPlan
) -> L:
    """Build a library in memory; see `Library.build`."""
    result = ingest_motions(plan.find_clips(sources), plan)
    plan.warn_of_keys(stacklevel=3)
    clips = result.clips
    if not clips:
        raise ValueError(f"no clip can be used: {next(iter(result.errors.values()))}")
    groups = choose_groups(plan, result.spec.skeleton, spread_evenly(clips))
    entries = name_clips([clip.info for clip in clips])
    warn_of_clips(entries, result, stacklevel=3)
    library = assemble(library_type, clips, entries, groups, result.spec, plan.config)
    refused = {label: str(error) for label, error in result.errors.items()}
    return replace(clusters.compare(library, plan.report), refused=refused)


def assemble(
    library_type: type[L],
    clips: Sequence[IngestedClip],
    entries: Sequence[ClipInfo],
    groups: JointGroups,
    spec: LibrarySpec,
    config: Config,
) -> L:
    """Return a library of ingested clips that hold motions, with the metadata `entries`.

    Each segment forms a cluster by itself until `clusters.compare`.
    """
    rows = np.concatenate([clip.samples for clip in clips])
    samples = Samples(rows, config.samples, spec.skeleton.n_joints)
    states = [clip.boundary_states for clip in clips]
    cuts = [(clip.segments, clip.is_donor) for clip in clips]
    return replace(
        join_clips(library_type, cuts, entries, samples, groups, spec, config),
        clips=tuple(
            clip.clip if clip.clip.name == info.name else replace(clip.clip, name=info.name)
            for clip, info in zip(clips, entries, strict=True)
            if isinstance(clip.clip, Motion)
        ),
        boundary_states=clusters.join_boundary_states(states, groups, spec.skeleton),
    )


def join_clips(
    library_type: type[L],
    cuts: Sequence[tuple[Segments, BoolArray]],
    entries: Sequence[ClipInfo],
    samples: Samples | JoinedSamples,
    groups: JointGroups,
    spec: LibrarySpec,
    config: Config,
) -> L:
    """Return a library without motions and boundary states, in which segments are not compared.

    `cuts` has the segments of each clip, and whether each of them may be a donor.
    """
    embedding: dict[str, Embedding | None] = dict.fromkeys(groups.names)
    labels, sigma = clusters.cluster_groups(embedding, len(samples), config)
    return library_type(
        clips=(),
        entries=tuple(entries),
        segments=Segments(
            np.concatenate([cut.start for cut, _ in cuts]),
            np.concatenate([cut.stop for cut, _ in cuts]),
            np.repeat(np.arange(len(cuts)), [len(cut) for cut, _ in cuts]),
        ),
        is_donor=np.concatenate([is_donor for _, is_donor in cuts]),
        groups=groups,
        config=config,
        spec=spec,
        embedding=embedding,
        labels=labels,
        sigma=sigma,
        boundary_states={},
        samples=samples,
        refused={},
        folder=None,
    )


def name_clips(entries: Sequence[ClipInfo]) -> tuple[ClipInfo, ...]:
    """Return metadata of clips with unique names, which are made from the names in the sources."""
    names = unique_names([info.source_name for info in entries])
    return tuple(info._replace(name=own) for info, own in zip(entries, names, strict=True))


def discover_groups(
    clips: ClipSource | Iterable[ClipSource],
    n: int | None = None,
    *,
    config: Config | None = None,
    seed: int = 0,
    **options: Unpack[IngestOptions],
) -> GroupDiscovery:
    """Discover groups of joints that move together, with the measures behind them.

    Parameters
    ----------
    clips : Motion, address, folder or glob, or several
        Clips of one hierarchy, as for `Library.build`. Of more than 64 clips, 64 at equal
        intervals are used.
    n : int, optional
        The number of groups, at least 2. Default: the number at the largest gap between the
        heights of the linkage tree.
    config : Config, optional
        Provides the parameters of segmentation and the number of samples per segment.
    seed : int
        Seed of the random permutations that measure the dependence of independent joints.
    **options
        `include_grafts`, `rate`, `match`, `hierarchy`, `skeleton`, `frame_rates` and `executor`, as
        for `Library.build`.

    Returns
    -------
    GroupDiscovery
        The groups, the dependences and the linkage tree. The base group is the first: the hips with
        their ancestors, and all chains of joints that carry the body, such as the legs. Names are
        those of the presets if the body parts are the same.

    Raises
    ------
    ValueError
        If `n` is below 2 or above the number of chains, the clips have fewer than three
        segments, or no joint beside the base moves.
    SkeletonMismatchError
        If the hierarchies of the clips differ.
    FormatError, FileNotFoundError
        If a file is invalid; if a path, folder or glob holds no file.

    Notes
    -----
    `docs/groups.md` describes the method.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> discovery = discover_groups(dance(strides=2).motion, 3)
    >>> discovery.groups.names
    ('lower', 'torso', 'arms')
    >>> [len(unit) for unit in discovery.units]
    [7, 1, 2, 8]
    """
    plan = IngestPlan(config=Config() if config is None else config, **options)
    result = ingest_motions(spread_evenly(plan.find_clips(clips)), plan)
    return _discover(result.clips, n, plan.config, seed)


def choose_groups(
    plan: IngestPlan, skeleton: Skeleton, clips: Iterable[IngestedClip]
) -> JointGroups:
    """Return the groups of the plan: given, of a preset, or discovered in some clips.

    `clips` is used only if the plan names automatic groups, such as ``auto:3``. Clips must hold
    motions: packed motions are ignored.
    """
    groups = plan.groups
    if not isinstance(groups, str):
        return groups
    if not is_automatic(groups):
        return JointGroups.preset(groups, skeleton)
    return _discover(clips, automatic_number(groups), plan.config, 0).groups


def spread_evenly(items: Sequence[T]) -> list[T]:
    """Return at most `MAX_CLIPS` of the items, at equal intervals, the first and last included."""
    if len(items) <= MAX_CLIPS:
        return list(items)
    chosen = np.linspace(0, len(items) - 1, MAX_CLIPS).round().astype(int)
    return [items[index] for index in chosen.tolist()]


def _discover(
    clips: Iterable[IngestedClip], n: int | None, config: Config, seed: int
) -> GroupDiscovery:
    """Discover groups in ingested clips; segments that are excluded as donors are left out."""
    motions = (
        (clip.clip, clip.segments[clip.is_donor])
        for clip in clips
        if isinstance(clip.clip, Motion) and clip.is_donor.any()
    )
    return discover_in_segments(motions, n, config, seed)
