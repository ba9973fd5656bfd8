"""Checks of a stream's arguments: configuration, grafted groups, constraints, frames, arrays."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import as_floats, as_quaternions
from mograft.body.capsules import Poses
from mograft.body.contacts import find_legs
from mograft.config import Config
from mograft.library.library import Library
from mograft.library.spec import rates_match
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton
from mograft.search.constraints import Clip, Constraint
from mograft.search.donor_constraints import Ban, Use
from mograft.solve.search_problem import check_constraints


def check_stream_config(config: Config) -> None:
    """Raise ValueError for settings that a stream does not support."""
    for name, required, reason in (
        ("segmentation", "energy", ", because other methods need all later frames"),
        ("alignment", "uniform", ""),
    ):
        if (value := getattr(config, name)) != required:
            raise ValueError(
                f"`Config.{name}` must be {required!r} in a stream{reason}, got {value!r}"
            )


def check_stream_groups(library: Library, groups: Sequence[str]) -> None:
    """Raise ValueError for groups that contain single channels, the root or joints of legs."""
    divided = library.groups.divided_channels(library.skeleton)
    legs = find_legs(library.skeleton)
    kept = {library.root, *(joint for leg in legs for joint in (leg.hip, leg.knee, leg.ankle))}
    for group in groups:
        if divided[group]:
            joints = ", ".join(library.skeleton.names[joint] for joint in divided[group])
            raise ValueError(
                f"`swap` must name groups of whole joints in a stream, got {group!r}, "
                f"which contains single channels of {joints}"
            )
        if not kept.isdisjoint(library.joints(group).tolist()):
            raise ValueError(
                "`swap` must not name a group with the root or a leg joint in a stream, "
                f"got {group!r}"
            )


def check_stream_constraints(
    constraints: Sequence[Constraint], skeleton: Skeleton, clips: Sequence[Clip]
) -> None:
    """Check the types of constraints, and the joints and clips that they name.

    Raise TypeError for an item that is not a constraint, ValueError for an unknown joint or clip.
    """
    identity = np.tile(rotations.IDENTITY, (1, skeleton.n_joints, 1))
    rest = Motion(skeleton, 1.0, identity, skeleton.offsets[None])
    check_constraints(constraints, Poses.from_motion(rest))
    no_segments = Segments(np.zeros(0, np.int64), np.zeros(0, np.int64))
    for constraint in constraints:
        if isinstance(constraint, Use | Ban):
            name = type(constraint).__name__
            raise ValueError(
                f"`constraints` of a stream must not contain {name}; use OnlyFrom or NotFrom"
            )
        if not constraint.applies_to_group(""):
            raise ValueError(
                "`constraints` of a stream must apply to all groups, got "
                f"{type(constraint).__name__} with a group"
            )
        constraint.donor_errors(no_segments, no_segments, clips)


def check_free_frames(constraints: Sequence[Constraint], first_free_frame: int) -> None:
    """Raise ValueError for a constraint that applies only to frames that are committed."""
    for constraint in constraints:
        if constraint.frames is not None and constraint.frames[1] < first_free_frame:
            first, last = constraint.frames
            frames = f"frame {first}" if first == last else f"frames {first} to {last}"
            raise ValueError(
                "`constraints` must apply to frames that are not committed: "
                f"{type(constraint).__name__} applies to {frames}, and the first free frame is "
                f"{first_free_frame}"
            )


def motion_from_arrays(
    frames: npt.ArrayLike, positions: npt.ArrayLike | None, library: Library, skeleton: Skeleton
) -> Motion:
    """Convert arrays that `Stream.push` receives to a motion at the library's frame rate.

    `Stream.push` documents the shapes and errors.
    """
    if positions is None:
        raise TypeError("`positions` must be given with an array of rotations")
    quats = as_quaternions("frames", frames)
    places = as_floats("positions", positions)
    n_joints = skeleton.n_joints
    if quats.ndim == 2:
        quats, places = quats[None], places[None]
    if quats.ndim != 3 or quats.shape[1] != n_joints:
        raise ValueError(
            f"`frames` must have shape (n_frames, {n_joints}, 4) or ({n_joints}, 4), "
            f"got {np.shape(frames)}"
        )
    n_frames = len(quats)
    if places.shape == (n_frames, 3):
        root, places = places, np.tile(skeleton.offsets, (n_frames, 1, 1))
        places[:, library.root] = root
    elif places.shape != (n_frames, n_joints, 3):
        axis = "" if np.ndim(frames) == 2 else f"{n_frames}, "
        raise ValueError(
            f"`positions` must have shape ({axis}{n_joints}, 3) or ({axis}3), "
            f"got {np.shape(positions)}"
        )
    return Motion(skeleton, 1.0 / library.rate, quats, places)


def check_stream_frames(frames: Motion, library: Library, skeleton: Skeleton | None) -> None:
    """Check that the frames fit the library and the frames pushed before.

    `skeleton` is that of the frames pushed before; a different skeleton raises ValueError. For the
    first frames it is None; a hierarchy other than the library's raises SkeletonMismatchError. A
    different frame rate raises ValueError.
    """
    if skeleton is None:
        library.skeleton.check_same_hierarchy(frames.skeleton, frames.name or "the base")
    elif frames.skeleton.names != skeleton.names or not np.array_equal(
        frames.skeleton.offsets, skeleton.offsets
    ):
        raise ValueError(
            "`frames` must all have the same skeleton, got joint names or offsets that differ from "
            "those of the first frames"
        )
    if not rates_match(frames.rate, library.rate):
        raise ValueError(
            f"`frames` must have the library's rate of {library.rate:.6g} frames/s, "
            f"got {frames.rate:.6g}: resample the base first"
        )
