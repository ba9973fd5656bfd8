"""Every number that can be chosen, with its unit and where it comes from."""

import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from mograft._util.registry import CONFIG_OPTIONS
from mograft._util.validate import python_scalar

__all__ = ["Config"]

FRAME = 1.0 / 30.0
"""The paper counts in frames of, as its segment lengths show, 30 a second."""


@dataclass(frozen=True)
class Config:
    """How motions are cut, compared, chosen and joined.

    ``Config()`` holds robust defaults; `Config.paper` the paper to the letter where it is
    explicit. Section numbers below are the paper's.

    Parameters
    ----------
    smoothing : float
        Standard deviation in seconds of the Gaussian that smooths the kinetic energy before
        its extrema are taken (4.1.1); 0 for none.
    min_length, max_length : float
        Shortest and longest segment in seconds. Shorter ones are merged, longer ones split.
    omega : {"world", "local"}
        Whether a link's angular velocity is relative to the world or to its parent (eq. 1).
    inertia : {"own", "subtree", "unit"}
        Whether a link's moment of inertia is its own, that of all that hangs on it, or 1.
    samples : int
        Frames that every segment is resampled to before it is compared (4.1.3).
    components : int
        Principal components kept, at most (p* of 4.2).
    keep_heading : bool
        Whether the same step in another direction is another motion. The paper keeps the
        root's rotation as it is; the default turns every segment to start facing one way.
    rotation_floor, position_floor, length_floor : float
        Least standard deviation that a feature is divided by: in radians, skeleton heights
        and frames of 1/30 s. It keeps the jitter of joints that hardly move from counting as
        much as motion; 0, as in the paper, for the bare correlation matrix (4.2).
    sigma : {"rms", "literal"} or float
        Greatest diameter of a cluster (4.3): √(mean d²) or, as eq. 14 is printed, √(mean d),
        where d is a segment's distance from the mean; or a number.
    sigma_scale : float
        Factor on a named `sigma`: smaller is more natural, larger is more varied.
    max_stretch : float
        λ_f of eq. 19: by which part of its length a base segment may differ from a donor.
    length_slack : float
        Difference in seconds that is allowed whatever the length; 0 for eq. 19 alone, strictly.
    max_angle : float
        Greatest mean joint angle, in radians, between the poses that meet at a seam (4.4).
    choice : {"viterbi", "best", "sample", "nearest", "random"}
        How donors are chosen among those that pass. "sample" draws with probability
        exp(-cost / `temperature`), so that every seed gives another motion; "viterbi" takes
        those of least cost in all, whatever the seed, and of several motions each pays for
        what the ones before it took; "best" takes the several of least cost, which differ
        little; "nearest" looks at nothing but how alike the base parts are; "random", the
        paper's way, at nothing but the limits (4.4).
    length_weight : float
        Cost of a donor of no length; that of one is its weight times 1 - shorter / longer.
    distance_weight : float
        Cost of a donor whose base part is as far from the base segment's as two of one
        cluster can be.
    angle_scale : float
        Mean joint angle at a seam, in radians, that costs 1, at most; the cost grows with its
        square. Where motions hardly move it is twice what is typical of seams between members
        of clusters.
    velocity_scale : float
        Mean difference of joint velocities at a seam, in radians per second, that costs 1;
        else as `angle_scale`.
    novelty : float
        What is gained by an exchange. At 0 the captured motion costs nothing and wins.
    temperature : float
        Cost that makes a choice of "sample" less likely by the factor e: towards 0 it is
        "viterbi", towards infinity every choice that passes is alike.
    diversity : float
        With "viterbi", what a donor costs more for every earlier motion that has it in the
        same place.
    max_candidates : int
        Donors that are looked at in one place, at most: those of least cost. "random" looks
        at all.
    seam : {"offset", "paper", "displacement", "inertial", "dead"}
        How motions that meet at a seam are made one (4.5). "offset" bends both sides so that
        they meet in pose and velocity; "displacement" spreads the gap in the pose over the
        segments, "paper" also lays the frames about the seam anew, which takes detail away;
        "inertial" and "dead" change only what comes after the seam: the first lets the gap
        die down, the second fades over from what came before, going on.
    seam_window : float
        Seconds on either side of a seam within which "paper" lays its curve anew.
    seam_blend : float
        Seconds beside a seam within which "offset", "inertial" and "dead" change frames.
    alignment : {"uniform", "dtw"}
        How a donor is brought to the length of the segment whose place it takes: stretched
        evenly, or bent in time so that its own base part does what the segment's does when
        that does it (dynamic time warping), wherever this brings them nearer by 5 %.
    torso : {"pelvis", "world"}
        What a grafted trunk keeps where it is joined to a pelvis that leans otherwise: its angle
        to the pelvis (the paper), or how it leans in the world (after Heck, Kovar and Gleicher
        2006).
    feet : {"auto", "never"}
        Whether feet are made to stand still where they should: "auto" wherever the base group
        does not keep both the legs and the root; in all other grafts feet are as they were.

    Raises
    ------
    ValueError
        If a value is out of range; names the field.

    Examples
    --------
    >>> Config().sigma, Config.paper().sigma
    ('rms', 'literal')
    >>> Config(sigma_scale=-1)
    Traceback (most recent call last):
    ...
    ValueError: sigma_scale must be above 0, got -1
    """

    smoothing: float = 2 * FRAME
    min_length: float = 3 * FRAME
    max_length: float = 2.0
    omega: Literal["world", "local"] = "world"
    inertia: Literal["own", "subtree", "unit"] = "own"
    samples: int = 10
    components: int = 10
    keep_heading: bool = False
    rotation_floor: float = math.radians(0.5)
    position_floor: float = 0.001
    length_floor: float = 0.5
    sigma: Literal["rms", "literal"] | float = "rms"
    sigma_scale: float = 0.75
    max_stretch: float = 0.15
    length_slack: float = FRAME
    max_angle: float = math.radians(45.0)
    choice: Literal["viterbi", "best", "sample", "nearest", "random"] = "sample"
    length_weight: float = 1.0
    distance_weight: float = 0.25
    angle_scale: float = math.radians(20.0)
    velocity_scale: float = math.radians(200.0)
    novelty: float = 3.0
    temperature: float = 1.0
    diversity: float = 1.0
    max_candidates: int = 32
    seam: Literal["offset", "paper", "displacement", "inertial", "dead"] = "offset"
    seam_window: float = 5 * FRAME
    seam_blend: float = 0.3
    alignment: Literal["uniform", "dtw"] = "uniform"
    torso: Literal["pelvis", "world"] = "pelvis"
    feet: Literal["auto", "never"] = "auto"

    def __post_init__(self) -> None:
        for field in fields(self):
            python_scalar(self, field.name)
        for name, registry in CONFIG_OPTIONS.items():
            registry.get(getattr(self, name))
        for name, least in (("samples", 2), ("components", 1), ("max_candidates", 1)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ValueError(
                    f"{name} must be a whole number of at least {least}, got {value!r}"
                )
        if not isinstance(self.keep_heading, bool):
            raise ValueError(f"keep_heading must be True or False, got {self.keep_heading!r}")
        named = ("rms", "literal")
        above_zero = ["min_length", "max_length", "sigma_scale", "max_stretch", "max_angle"]
        above_zero += ["seam_blend"]
        if isinstance(self.sigma, str):
            if self.sigma not in named:
                raise ValueError(f"sigma must be one of {named} or a number, got {self.sigma!r}")
        else:
            above_zero.append("sigma")
        not_negative = ["smoothing", "rotation_floor", "position_floor", "length_floor"]
        not_negative += ["length_slack", "seam_window"]
        above_zero += ["angle_scale", "velocity_scale", "temperature"]
        not_negative += ["length_weight", "distance_weight", "novelty", "diversity"]
        for name in above_zero + not_negative:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{name} must be a number, got {value!r}")
            if name in above_zero and not value > 0:
                raise ValueError(f"{name} must be above 0, got {value!r}")
            if not value >= 0:
                raise ValueError(f"{name} must not be negative, got {value!r}")
        if self.max_length < 2 * self.min_length:
            raise ValueError(
                f"max_length must be at least twice min_length, {self.min_length:.4g} s, "
                f"got {self.max_length:.4g}"
            )

    @classmethod
    def paper(cls, **changes: Any) -> "Config":  # noqa: ANN401 - any field's value
        """Return the paper's own parameters, literally where it is explicit.

        Parameters
        ----------
        **changes
            Fields that should differ.

        Returns
        -------
        Config
            The configuration.
        """
        literal = cls(
            min_length=FRAME,
            max_length=math.inf,
            keep_heading=True,
            rotation_floor=0.0,
            position_floor=0.0,
            length_floor=0.0,
            sigma="literal",
            sigma_scale=1.0,
            length_slack=0.0,
            choice="random",
            seam="paper",
            feet="never",
        )
        return replace(literal, **changes)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, as JSON can hold them: infinity is None."""
        return {name: None if value == math.inf else value for name, value in asdict(self).items()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Config":
        """Return the configuration that `as_dict` made `values` of.

        Raises
        ------
        ValueError
            If a name is no field, or a value is out of range.
        """
        unknown = set(values) - {field.name for field in fields(cls)}
        if unknown:
            raise ValueError(f"no parameter is named {', '.join(sorted(unknown))}")
        given: dict[str, Any] = {k: math.inf if v is None else v for k, v in values.items()}
        return cls(**given)
