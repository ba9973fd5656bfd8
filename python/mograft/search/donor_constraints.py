"""Constraints on donors and seams: source clip, stretch and seam angle."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.names import as_words, find_matches
from mograft._util.validate import as_integer, check_not_negative, check_positive, is_integer
from mograft.config import Config
from mograft.errors import join_names
from mograft.motion.segments import Segments
from mograft.search.constraints import (
    Clip,
    Constraint,
    Span,
    Violation,
    as_span,
    build_violation,
    overlaps,
)

_NO_TAG = "left out, as no clip has a tag: mograft index FILE -o LIB --tags TABLE.csv gives them"
_NO_DONOR = "`donor` must be a segment index or (clip, first frame, last frame), got {!r}"


@dataclass(frozen=True, kw_only=True)
class _GroupConstraint(Constraint):
    """Base class of constraints that may apply to the donors of one joint group only."""

    group: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.group is not None and not isinstance(self.group, str):
            raise TypeError(f"`group` must be the name of a joint group, got {self.group!r}")

    def applies_to_group(self, group: str) -> bool:
        """As `Constraint.applies_to_group`."""
        return self.group in (None, group)


@dataclass(frozen=True)
class KeepOriginal(_GroupConstraint):
    """Keep the captured motion of every segment that shares two successive frames with `frames`.

    The first and last frame of a segment thus select this segment alone, although its neighbours
    share these frames.

    Parameters
    ----------
    frames : tuple of int, optional
        First and last frame of the base motion. Default: all frames.
    group : str, optional
        The joint group that is kept. Default: all exchanged groups.

    Examples
    --------
    >>> KeepOriginal(frames=(0, 60)).frames
    (0, 60)
    """

    def donor_errors(self, base: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.donor_errors`."""
        return np.where(_is_same(base, donors), 0.0, 2.0)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        return "the captured part must be kept"


@dataclass(frozen=True)
class _ClipConstraint(Constraint):
    """Base class of constraints that select donors by clip, tag and frames of the clip."""

    clips: str | Sequence[str] = ()
    clip_frames: Span | None = None
    tags: str | Collection[str] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("clips", "tags"):
            object.__setattr__(self, name, as_words(name, getattr(self, name)))
        if not self.clips and not self.tags:
            raise ValueError("`clips` or `tags` must be given, got neither")
        if self.clip_frames is not None:
            object.__setattr__(self, "clip_frames", as_span("clip_frames", self.clip_frames))

    def _is_selected(self, donors: Segments, clips: Sequence[Clip], *, whole: bool) -> BoolArray:
        """Return which donors are from the selected clips and lie within the selected frames.

        If not `whole`, a donor that overlaps the selected frames is selected, too.
        """
        known, selected = vars(self).get("_resolved", (None, None))
        if selected is None or known is not clips:
            selected = self._select_clips(clips)
            vars(self)["_resolved"] = (clips, selected)
        inside: BoolArray = selected[donors.clip]
        if self.clip_frames is None or not whole:
            return inside & overlaps(donors, self.clip_frames)
        return inside & (donors.start >= self.clip_frames[0]) & (donors.stop <= self.clip_frames[1])

    def _select_clips(self, clips: Sequence[Clip]) -> BoolArray:
        """Return which clips the names and tags select."""
        found = find_matches("clips", _as_names(self.clips), [clip.name for clip in clips])
        contents = [_content_of(clip) for clip in clips]
        named = {contents[index] for index in found} - {None}
        selected = np.array([own in named for own in contents], bool)
        selected[found] = True
        for tag in _as_names(self.tags):
            tagged = [tag in clip.tags for clip in clips]
            if not any(tagged):
                known = sorted({name for clip in clips for name in clip.tags})
                expected = f"among {join_names(known)}" if known else _NO_TAG
                raise ValueError(f"`tags` must be {expected}; got {tag!r}")
            selected |= tagged
        return selected

    def __getstate__(self) -> dict[str, object]:
        """Return the fields; a copy or another process finds the clips again."""
        return {name: value for name, value in vars(self).items() if name != "_resolved"}

    def describe_selection(self) -> str:
        """Return the selected clips, tags and frames as text."""
        tagged = (f"clips tagged {tag}" for tag in _as_names(self.tags))
        frames = self.clip_frames
        span = "" if frames is None else f", frames {frames[0]} to {frames[1]}"
        return ", ".join([*_as_names(self.clips), *tagged]) + span


@dataclass(frozen=True)
class OnlyFrom(_ClipConstraint):
    """Accept donors from some clips only; segments may also stay as captured.

    The constraint is violated if none of the segments in `frames` has a candidate from these
    clips. To require a donor at a segment, see `Use`.

    Parameters
    ----------
    clips : str or sequence of str
        Names of clips, or patterns such as ``"waltz*"``. The clips of copies of a file, such as
        ``"waltz~2"``, are selected together.
    tags : str or collection of str
        Tags of clips; a clip with one of them is selected, in addition to `clips`.
    clip_frames : tuple of int, optional
        First and last frame in these clips; donors must lie within them. Default: all frames.

    Examples
    --------
    >>> OnlyFrom("waltz*", tags=["slow"]).describe_error(2.0, height=180.0)
    'not from waltz*, clips tagged slow'
    """

    def donor_errors(self, base: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.donor_errors`."""
        return np.where(self.selects(donors, clips) | _is_same(base, donors), 0.0, 2.0)

    def selects(self, donors: Segments, clips: Sequence[Clip]) -> BoolArray:
        """Return which donors lie in the selected clips and frames, shape (n,)."""
        return self._is_selected(donors, clips, whole=True)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        return f"not from {self.describe_selection()}"


@dataclass(frozen=True)
class NotFrom(_ClipConstraint):
    """Accept no donors from some clips; segments of these clips may stay as captured.

    Parameters
    ----------
    clips : str or sequence of str
        Names of clips, or patterns such as ``"walk*"``; see `OnlyFrom`.
    tags : str or collection of str
        Tags of clips; a clip with one of them is selected, in addition to `clips`.
    clip_frames : tuple of int, optional
        First and last frame in these clips; donors that share two successive frames with this
        range are excluded, or donors that contain it if it is one frame. Default: all frames.

    Examples
    --------
    >>> NotFrom(["walk1", "walk2"]).describe_error(2.0, height=180.0)
    'from walk1, walk2'
    """

    def donor_errors(self, base: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.donor_errors`."""
        within = self._is_selected(donors, clips, whole=False)
        return np.where(within & ~_is_same(base, donors), 2.0, 0.0)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        return f"from {self.describe_selection()}"


DonorReference = int | str | tuple[str, int, int]
"""Index of a segment in the library, name of a clip, or clip with first and last frame."""


@dataclass(frozen=True)
class _SegmentConstraint(_GroupConstraint):
    """Base class of constraints on one donor, or several donors of a clip, at base segments."""

    segment: int | None = None
    donor: DonorReference | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.segment is None) == (self.frames is None):
            raise ValueError("one of `segment` and `frames` must be given, got both or neither")
        if self.segment is not None:
            object.__setattr__(self, "segment", as_integer("segment", self.segment))
        if is_integer(self.donor):
            object.__setattr__(self, "donor", as_integer("donor", self.donor))
        elif self.donor is not None and not isinstance(self.donor, str):
            object.__setattr__(self, "donor", _as_clip_span(self.donor))

    def _is_donor(self, donors: Segments, clips: Sequence[Clip]) -> BoolArray:
        """Return which of `donors` are in the clip of `self.donor` and overlap its frames."""
        if isinstance(self.donor, int):
            expected = "`donor` must be (clip, first frame, last frame) outside of `graft`"
            raise ValueError(f"{expected}, got {self.donor}")
        name, *frames = self.donor if isinstance(self.donor, tuple) else (self.donor,)
        span = (int(frames[0]), int(frames[1])) if frames else None
        is_clip = np.array([clip.name == name for clip in clips], bool)
        return is_clip[donors.clip] & overlaps(donors, span)

    def _describe_donor(self) -> str:
        if isinstance(self.donor, tuple):
            return f"{self.donor[0]}, frames {self.donor[1]} to {self.donor[2]}"
        return str(self.donor)


@dataclass(frozen=True)
class Use(_SegmentConstraint):
    """Use one donor for a base segment, in one or all exchanged groups.

    The donor may be any segment of the library: a hard `Use` accepts donors of other clusters, of
    any length and with recording faults. The seams beside the donor can violate a `MaxAngle`.

    Parameters
    ----------
    segment : int, optional
        Number of the base segment in the base motion, from 0.
    donor : int or tuple of (str, int, int)
        Index of the donor in the library, such as `Candidate.segment`, or the name of its clip and
        the first and last frame of the donor.
    frames : tuple of int, optional
        First and last frame of the base segment, instead of `segment`.
    group : str, optional
        The joint group. Default: all exchanged groups.

    Raises
    ------
    ValueError
        If both or none of `segment` and `frames` are given, or the donor is not of one of the
        forms. `graft` raises it if there is no such segment.

    Examples
    --------
    >>> Use(24, ("waltz", 242, 275)).describe_error(2.0, height=180.0)
    'not waltz, frames 242 to 275'
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.donor is None or isinstance(self.donor, str):
            raise ValueError(_NO_DONOR.format(self.donor))

    def donor_errors(self, base: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.donor_errors`."""
        return np.where(self._is_donor(donors, clips), 0.0, 2.0)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        return f"not {self._describe_donor()}"


@dataclass(frozen=True)
class Ban(_SegmentConstraint):
    """Forbid a donor, or the captured motion, for base segments.

    Unlike `NotFrom`, it applies to captured motion, too.

    Parameters
    ----------
    segment : int, optional
        Number of the base segment in the base motion, from 0.
    donor : int, str or tuple of (str, int, int), optional
        Index of a segment in the library, a clip, or a clip with the first and last frame of a
        range: all segments that share two successive frames with it are excluded. Default: the
        captured motion, so that the segment is exchanged; in `mograft.edit`, the donor that the
        segment has in the graft, if it has another candidate.
    frames : tuple of int, optional
        First and last frame of a range of base segments, instead of `segment`.
    group : str, optional
        The joint group. Default: all exchanged groups.

    Raises
    ------
    ValueError
        If both or none of `segment` and `frames` are given, or the donor is not of one of the
        forms. `graft` raises it if there is no such segment or clip.

    Examples
    --------
    >>> Ban(24, "waltz").describe_error(2.0, height=180.0)
    'excluded donor: waltz'
    """

    def donor_errors(self, base: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.donor_errors`."""
        captured = self.donor is None
        banned = _is_same(base, donors) if captured else self._is_donor(donors, clips)
        return np.where(banned, 2.0, 0.0)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        donor = "the captured part" if self.donor is None else self._describe_donor()
        return f"excluded donor: {donor}"


def _content_of(clip: Clip) -> tuple[str, str, str | None] | None:
    """Return what a clip of a file has in common with the clips of copies of the file.

    The names of these differ by the numbers of `unique_names`. Return None without a file.
    """
    file = getattr(clip, "source_file", None)
    return file and (re.sub(r"~\d+", "", clip.name), file.sha256, file.clip)


def _as_clip_span(donor: object) -> tuple[str, int, int]:
    """Return `donor` as (clip name, first frame, last frame); raise ValueError if it is not."""
    parts = tuple(donor) if isinstance(donor, Sequence) else ()
    if len(parts) != 3 or not isinstance(parts[0], str):
        raise ValueError(_NO_DONOR.format(donor))
    return (parts[0], *as_span("donor", parts[1:]))


@dataclass(frozen=True)
class MaxStretch(Constraint):
    """Limit the length difference between a donor and its base segment.

    Parameters
    ----------
    limit : float
        Maximum length difference, as a fraction of the length of the base segment.

    Examples
    --------
    >>> MaxStretch(0.1).describe_error(2.5, height=180.0)
    'stretched by 0.25, limit 0.10'
    """

    limit: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_not_negative(self, "limit")

    def donor_errors(self, base: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.donor_errors`."""
        stretch = np.abs(base.lengths - donors.lengths) / base.lengths
        exceeds = stretch > self.limit * (1 + 1e-9)
        # With a limit below 0.001, the quotient is at most 1 for some stretches above the limit.
        errors = np.maximum(stretch / max(self.limit, 1e-3), 1.0 + 1e-9)
        return np.where(exceeds, errors, 0.0)

    def describe_error(self, error: float, height: float) -> str:
        """As `Constraint.describe_error`."""
        return f"stretched by {error * max(self.limit, 1e-3):.2f}, limit {self.limit:.2f}"


@dataclass(frozen=True)
class MaxAngle(Constraint):
    """Limit the seam angle; a hard constraint in addition to `Config.max_angle`.

    Parameters
    ----------
    limit : float
        Maximum mean joint angle between the poses at a seam, in radians.

    Examples
    --------
    >>> import math
    >>> round(MaxAngle(math.radians(20)).limit, 3)
    0.349
    """

    limit: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "limit")
        if self.weight is not None or self.frames is not None:
            raise ValueError("MaxAngle accepts neither weight nor frames: it applies to every seam")


def limit_config(config: Config, constraints: Sequence[Constraint]) -> Config:
    """Return the configuration with `max_angle` reduced to the smallest limit of any `MaxAngle`."""
    angles = [constraint.limit for constraint in constraints if isinstance(constraint, MaxAngle)]
    return replace(config, max_angle=min([config.max_angle, *angles]))


def find_seam_violations(
    constraints: Sequence[Constraint], group: str, frames: Sequence[int], angles: Sequence[float]
) -> list[Violation]:
    """Return the violations of `MaxAngle` at the seams of a group, by constraint and frame.

    `frames` are the frames of the seams in the base motion, `angles` their mean joint angles in
    radians.
    """
    return [
        build_violation(
            constraint,
            (frame, frame),
            angle / constraint.limit,
            f"seam angle of {group} {np.degrees(angle):.1f}°, "
            f"limit {np.degrees(constraint.limit):.1f}°",
        )
        for constraint in constraints
        if isinstance(constraint, MaxAngle)
        for frame, angle in zip(frames, angles, strict=True)
        if angle > constraint.limit
    ]


def _is_same(base: Segments, donors: Segments) -> BoolArray:
    """Return whether each donor is the base segment itself."""
    return (base.clip == donors.clip) & (base.start == donors.start) & (base.stop == donors.stop)


def _as_names(words: str | Collection[str]) -> list[str]:
    return [words] if isinstance(words, str) else sorted(words)
