"""`Config`: every adjustable parameter, with its unit and source."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from numbers import Real
from typing import Any, Literal, TypeVar, get_args, get_origin

from mograft._util.validate import as_integer, check_choice, freeze_cut_frames, python_scalar
from mograft.errors import suggest_name

FRAME = 1.0 / 30.0
"""Seconds per frame of the paper's recordings: its segment lengths show 30 frames per second."""

STAGES = ("segmentation", "embedding", "neighbourhood", "search", "blend")
"""The stages of the computation, in their order. A field of `Config` carries the first stage whose
result it changes; all later stages depend on it."""

_FUNCTION = "function "  # marks the name of a function in `Config.as_dict`

T = TypeVar("T")


_FACTORS = ("length_weight", "distance_weight", "balance_weight", "novelty", "diversity")
"""Factors of costs: infinity times a cost of 0 is not a number."""


def setting(stage: str, default: T, at_least: float | None = None, *, paper: T | None = None) -> T:
    """Return a field of `Config` that belongs to one of `STAGES`.

    Numbers must be at least `at_least` or, by default, above 0. `paper` is the value in the paper,
    None if it is the default.
    """
    paper = default if paper is None else paper
    return field(default=default, metadata={"stage": stage, "at_least": at_least, "paper": paper})


@dataclass(frozen=True)
class Config:
    """Parameters of segmentation, clustering, donor choice and blending.

    ``Config()`` holds robust defaults. `Config.paper` holds the parameters of the paper.
    Section and equation numbers below are those of the paper.

    Parameters
    ----------
    segmentation : "energy", mapping or callable
        How motions are cut into segments: at the extrema of the kinetic energy; at the cut frames
        of each clip, given as a mapping from the name of the clip to ascending frames; or by a
        function that receives a `Motion` and returns its cut frames. Frames of a
        mapping count in the clip as it was recorded, at its own rate; a function receives the clip
        at the rate of the library. A library with a function cannot be stored.
    smoothing : float
        Standard deviation, in seconds, of the Gaussian that smooths the kinetic energy before
        its extrema are found (4.1.1). 0 disables smoothing.
    min_length, max_length : float
        Shortest and longest segment, in seconds. Shorter segments are merged, longer ones
        split. With a `min_length` of 0 none are merged, as in the paper.
    omega : {"world", "local"}
        Whether the angular velocity of a link, the body part that moves with a joint, is relative
        to the world or to its parent (eq. 1).
    inertia : {"own", "subtree", "unit"}
        Moment of inertia of a link: that of the link alone, that of the link together with all
        links below it, or 1.
    samples : int
        Number of frames to which every segment is resampled before comparison (4.1.3).
    components : int
        Maximum number of principal components (p* of 4.2).
    keep_heading : bool
        Whether segments that differ only in heading count as different, as in the paper. If
        False, every segment is rotated to the same initial heading before the comparison.
    rotation_floor, position_floor, length_floor : float
        Lower bounds of the standard deviations by which features are divided: of rotations in
        radians, of root displacements in skeleton heights, and of segment lengths in frames of
        1/30 s. They prevent the jitter of nearly static joints from weighing as much as motion.
        With 0, the correlation matrix is that of the paper (4.2).
    sigma : {"rms", "literal"}
        Spread of all segments, of which `sigma_scale` is a multiple (4.3). "rms" is √(mean d²),
        where d is the distance of a segment from the mean of all segments. "literal" is √(mean d),
        as eq. 14 is printed.
    sigma_scale : float
        Cluster diameter threshold as a multiple of `sigma`. Larger values give more variety,
        smaller values more similarity. `with_variety` sets it from a number between 0 and 1.
    neighbourhood : {"cluster", "ball"}
        Which segments are similar enough to replace a base segment, compared by the motion of the
        base group. "cluster": the segments of its cluster (4.3). "ball": the segments whose
        distance from it is at most the cluster diameter threshold; where fewer than two of them
        can be donors, also the nearest two possible donors up to twice that distance.
    max_stretch : float
        Maximum length difference between a base segment and a donor, as a share of the base
        segment's length (λ_f of eq. 19).
    length_slack : float
        Length difference, in seconds, that is accepted even if it exceeds `max_stretch`. With 0,
        only eq. 19 applies, as a strict inequality.
    max_angle : float
        Maximum seam angle, in radians: the mean joint angle between the two poses that meet at
        a seam (4.4).
    choice : {"viterbi", "sample", "nearest", "random"}
        How donors are chosen among the candidates within the limits. "sample" draws donor
        sequences with probability proportional to exp(-cost / `temperature`), so motions of
        different seeds usually differ in some donors. "viterbi" takes the donor sequence of minimum
        total cost, whatever the seed. "nearest" minimises only the distance between the base
        group's motion in donor and base segment. "random" draws uniformly within the limits, as in
        the paper (4.4).
    length_weight : float
        Weight of the relative length difference, 1 - shorter / longer, in the unary cost.
    distance_weight : float
        Weight, in the unary cost, of the distance between the base group's motion in the donor and
        in the base segment, as a multiple of the cluster diameter threshold.
    balance_weight : float
        Weight, in the unary cost, of the imbalance that a donor adds. The imbalance is about the
        share of the base segment in which the zero-moment point is outside of the support polygon.
        0 disables the term. It applies to groups that move neither the root nor a foot, and not in
        streams.
    angle_scale : float
        Seam angle, in radians, at which the pairwise cost is 1; the cost is proportional to the
        square of the angle. The scale is reduced to half the mean angle at seams between
        random donors if that is smaller, as in most libraries.
    velocity_scale : float
        Mean difference of joint velocities at a seam, in radians per second, at which the pairwise
        cost is 1. This scale is reduced like `angle_scale`, to twice the mean difference.
    novelty : float
        Reduction of the unary cost for donors whose poses differ from those of the base segment by
        at least 5 degrees on average; donors with smaller differences have from half of it on, and
        the base segment itself nothing. At 0 the captured motion has the lowest cost.
    temperature : float
        For the choice "sample": the cost difference between two donor sequences whose
        probabilities differ by the factor e. As it approaches 0, the result approaches that of
        "viterbi"; as it approaches infinity, a uniform draw.
    diversity : float
        Cost that "sample", "viterbi" and "nearest" add to a donor for every previous motion of
        the same call that has the same poses at the same position. It is less if the poses differ,
        and 0 from a mean joint angle of 20 degrees on.
    max_candidates : int
        Maximum number of candidates per position: those of lowest unary cost. "random" keeps
        all.
    seam : {"gradient", "offset", "paper", "displacement", "inertial"}
        Seam treatment (4.5).
        "gradient" solves for the frames on both sides whose accelerations, velocities and poses are
        nearest to the donors'. "offset" adds a decaying offset on both sides, so that pose and
        velocity are continuous. "displacement" spreads the pose gap over both segments. "paper"
        does the same and replaces the frames near the seam by a cubic, which removes detail.
        "inertial" adds a decaying offset after the seam only.
    seam_window : float
        Duration, in seconds, on each side of a seam that the cubic of "paper" replaces.
    seam_blend : float
        Duration, in seconds, on each side of a seam within which all treatments except "paper"
        and "displacement" may change frames.
    torso : {"pelvis", "world"}
        What a grafted trunk keeps if the pelvis of the base moves differently from that of the
        donor: its angle to the pelvis (the paper), or its lean in the world, with the heading of
        the base (Heck, Kovar and Gleicher 2006).
    loop : {"auto", "on", "off"}
        Whether the last frame of a graft meets its first. "auto": if those of the base do, in pose
        and velocity, as in the walk cycle of a game. "on": always. "off": never. It has no effect
        if an exchanged group contains the root, and in streams.
    self_repair : bool
        Whether donors are replaced where the assembled motion has a greater acceleration, jerk or
        depth below the floor than the limits in docs/seams.md, which derive from the recordings. It
        has no effect with the choice "random".
    feet : {"auto", "never"}
        Whether feet are planted: "auto" plants them if an exchanged group drives the feet or
        the root; "never" leaves them.
    reach_ik : float
        Maximum distance, as a fraction of the length of the arm or leg, over which inverse
        kinematics moves a hand or foot to the target of a `Reach` that the donors nearly meet. 0
        disables it. It applies to exchanged limbs, and not in streams.

    Raises
    ------
    ValueError
        If a value is out of range. The message names the field.

    Examples
    --------
    >>> Config().sigma, Config.paper().sigma
    ('rms', 'literal')
    >>> Config(sigma_scale=-1)
    Traceback (most recent call last):
    ...
    ValueError: `sigma_scale` must be above 0, got -1
    """

    segmentation: Literal["energy"] | Mapping[str, Sequence[int]] | Callable[[Any], Any] = setting(
        "segmentation", "energy"
    )
    smoothing: float = setting("segmentation", 2 * FRAME, 0)
    min_length: float = setting("segmentation", 3 * FRAME, 0, paper=0.0)
    max_length: float = setting("segmentation", 2.0, paper=math.inf)
    omega: Literal["world", "local"] = setting("segmentation", "world")
    inertia: Literal["own", "subtree", "unit"] = setting("segmentation", "own")
    samples: int = setting("embedding", 10, 2)
    components: int = setting("embedding", 10, 1)
    keep_heading: bool = setting("embedding", default=False, paper=True)
    rotation_floor: float = setting("embedding", math.radians(0.5), 0, paper=0.0)
    position_floor: float = setting("embedding", 0.001, 0, paper=0.0)
    length_floor: float = setting("embedding", 0.5, 0, paper=0.0)
    sigma: Literal["rms", "literal"] = setting("neighbourhood", "rms", paper="literal")
    sigma_scale: float = setting("neighbourhood", 0.75, paper=1.0)
    # The candidates are found among the clusters and points when donors are searched.
    neighbourhood: Literal["cluster", "ball"] = setting("search", "ball", paper="cluster")
    max_stretch: float = setting("search", 0.15)
    length_slack: float = setting("search", FRAME, 0, paper=0.0)
    max_angle: float = setting("search", math.radians(45.0))
    choice: Literal["viterbi", "sample", "nearest", "random"] = setting(
        "search", "sample", paper="random"
    )
    length_weight: float = setting("search", 1.0, 0)
    distance_weight: float = setting("search", 4.0, 0)
    balance_weight: float = setting("search", 30.0, 0, paper=0.0)
    angle_scale: float = setting("search", math.radians(20.0))
    velocity_scale: float = setting("search", math.radians(200.0))
    novelty: float = setting("search", 10.0, 0)
    temperature: float = setting("search", 0.25)
    diversity: float = setting("search", 3.0, 0)
    max_candidates: int = setting("search", 32, 1)
    seam: Literal["gradient", "offset", "paper", "displacement", "inertial"] = setting(
        "blend", "gradient", paper="paper"
    )
    seam_window: float = setting("blend", 5 * FRAME, 0)
    seam_blend: float = setting("blend", 0.3)
    torso: Literal["pelvis", "world"] = setting("blend", "world", paper="pelvis")
    loop: Literal["auto", "on", "off"] = setting("search", "auto", paper="off")
    self_repair: bool = setting("search", default=True, paper=False)
    feet: Literal["auto", "never"] = setting("blend", "auto", paper="never")
    reach_ik: float = setting("blend", 0.25, 0, paper=0.0)

    def __post_init__(self) -> None:
        for own in fields(self):
            self._check(own)
        self._check_segmentation()
        for name, accepted in CHOICES.items():
            value = getattr(self, name)
            if name != "segmentation" or isinstance(value, str):
                check_choice(name, value, accepted)
        if self.max_length < 2 * self.min_length:
            raise ValueError(
                f"`max_length` must be at least {2 * self.min_length:.4g} s, twice `min_length`, "
                f"got {self.max_length:.4g}"
            )

    def _check(self, own: "Field[Any]") -> None:
        """Replace a NumPy scalar in a field, and check a value that is a boolean or a number."""
        value, at_least = python_scalar(self, own.name), own.metadata["at_least"]
        if own.type is bool and not isinstance(value, bool):
            raise ValueError(f"`{own.name}` must be True or False, got {value!r}")
        if own.type is int:
            as_integer(own.name, value, at_least)
        power = 15 if own.type is int else 300  # larger ones are no indices, or no floats
        if isinstance(value, int) and value > 10**power:
            raise ValueError(f"`{own.name}` must be at most 10^{power}, got a larger number")
        if own.type is float:
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"`{own.name}` must be a number, got {value!r}")
            if at_least is None and not value > 0:
                raise ValueError(f"`{own.name}` must be above 0, got {value!r}")
            if not value >= 0:
                raise ValueError(f"`{own.name}` must not be negative, got {value!r}")
            if value == math.inf and own.name in _FACTORS:
                raise ValueError(f"`{own.name}` must be finite, got {value!r}")

    def _check_segmentation(self) -> None:
        """Check `segmentation`, and replace a mapping by an immutable copy."""
        chosen = self.segmentation
        if isinstance(chosen, Mapping):
            object.__setattr__(self, "segmentation", freeze_cut_frames(chosen))
        elif not isinstance(chosen, str) and not callable(chosen):
            raise ValueError(
                "`segmentation` must be 'energy', a mapping from names of clips to cut frames, "
                f"or a function, got {chosen!r}"
            )

    @classmethod
    def paper(cls, **changes: Any) -> "Config":  # noqa: ANN401 - any field's value
        """Return the configuration of the paper, except for the fields given as `changes`.

        Notes
        -----
        With eq. 14 as printed, sigma is so small that few segments have donors. With
        ``sigma="rms"`` it is the root mean square, the usual geometric standard deviation.

        Results differ from the printed method in these points: the window of the cubic at a seam
        covers at most half of each segment, and there is no cubic if the window has no frame;
        stretched donors are interpolated by a curve through neighbouring frames of their clip;
        segments with recording faults are excluded donors; eq. 19 counts intervals instead of
        frames; sigma limits the diameter of a cluster.
        """
        values = {own.name: own.metadata["paper"] for own in fields(cls)}
        return cls(**(values | changes))

    @classmethod
    def with_variety(cls, variety: float, **changes: Any) -> "Config":  # noqa: ANN401 - any field's value
        """Return the defaults, except for `sigma_scale` and the fields in `changes`.

        Parameters
        ----------
        variety : float
            From 0, few and similar donors, to 1, many and less similar ones. 0.5 is ``Config()``.
            See `scale_of_variety`.
        **changes
            Values of other fields.

        Raises
        ------
        ValueError
            If `variety` is not between 0 and 1, or `changes` has `sigma_scale`.

        Examples
        --------
        >>> [round(Config.with_variety(v).sigma_scale, 2) for v in (0, 0.5, 1)]
        [0.3, 0.75, 1.88]
        """
        scale = scale_of_variety(variety)
        if "sigma_scale" in changes:
            raise ValueError(
                "`sigma_scale` must not be given together with `variety`, which sets it"
            )
        return cls(sigma_scale=scale, **changes)

    @classmethod
    def fields_of(cls, *stages: str) -> tuple[str, ...]:
        """Return the names of the fields of some of the `STAGES`."""
        return tuple(own.name for own in fields(cls) if own.metadata["stage"] in stages)

    def changed_fields(self, other: "Config") -> dict[str, list[str]]:
        """Return the names of the fields whose values differ from those of `other`, by stage."""
        changed: dict[str, list[str]] = {}
        for own in fields(self):
            if getattr(self, own.name) != getattr(other, own.name):
                changed.setdefault(own.metadata["stage"], []).append(own.name)
        return changed

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as a dict of JSON values; infinity becomes None.

        `segmentation` is left out if it has its default. A function is replaced by its name, and
        `from_dict` refuses it.
        """
        return {
            own.name: _to_json(getattr(self, own.name))
            for own in fields(self)
            if own.name != "segmentation" or self.segmentation != own.default
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Config":
        """Return the configuration whose `as_dict` is `values`.

        Raises ValueError if a name is not a field, a value is out of range, or `segmentation` was a
        function.
        """
        names = [own.name for own in fields(cls)]
        unknown = sorted(set(values) - set(names))
        if unknown:
            hint = suggest_name(unknown[0], names)
            raise ValueError(f"unknown fields of Config: {', '.join(unknown)}{hint}")
        given: dict[str, Any] = {k: math.inf if v is None else v for k, v in values.items()}
        chosen = given.get("segmentation")
        if isinstance(chosen, str) and chosen.startswith(_FUNCTION):
            raise ValueError(
                f"`segmentation` was the {chosen}, and functions are not stored: give its cut "
                "frames for each clip instead"
            )
        return cls(**given)


def _words(kind: Any) -> tuple[str, ...]:  # noqa: ANN401 - any annotation
    """Return the words that an annotation lists by `Literal`."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return tuple(word for part in get_args(kind) for word in _words(part))


CHOICES = {own.name: words for own in fields(Config) if (words := _words(own.type))}
"""The accepted words of every field of `Config` that selects by name."""


def _to_json(value: object) -> object:
    """Return the value of a field of `Config` as a JSON value."""
    if isinstance(value, Mapping):
        return {name: list(own) if isinstance(own, tuple) else own for name, own in value.items()}
    if callable(value):
        module, name = (getattr(value, key, "") for key in ("__module__", "__qualname__"))
        return f"{_FUNCTION}{module}.{name or type(value).__qualname__}"
    return None if value == math.inf else value


def scale_of_variety(variety: float) -> float:
    """Return the `Config.sigma_scale` of a variety from 0 to 1: 0.75 · 2.5^(2 · variety - 1).

    This is 0.3 for a variety of 0, 0.75 for 0.5 and 1.875 for 1. Raises ValueError if `variety` is
    not a number between 0 and 1.
    """
    if isinstance(variety, bool) or not isinstance(variety, Real) or not 0 <= variety <= 1:
        raise ValueError(f"`variety` must be a number from 0 to 1, got {variety!r}")
    return float(0.75 * 2.5 ** (2.0 * float(variety) - 1.0))


def variety_of_scale(scale: float) -> float:
    """Return the variety whose `scale_of_variety` is `scale`; it may be outside of 0 to 1."""
    return 0.5 + 0.5 * math.log(scale / 0.75, 2.5)
