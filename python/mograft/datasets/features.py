"""Arrays of motions on which models are trained."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft.body.contacts import detect_contacts
from mograft.datasets.humanml import HUMANML_RATE, check_humanml_joints, humanml3d, humanml_joints
from mograft.errors import suggest_name
from mograft.library.data import LibraryData
from mograft.motion import rotations
from mograft.motion.motion import Motion

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Feature:
    """An array of numbers that follows from the frames of a motion."""

    summary: str
    compute: Callable[[Motion, int], Array]
    """Function of a motion and the root joint; its result has a row for each frame."""
    of_window: bool = False  # whether it is computed for each window, because rows depend on others


def _matrices(motion: Motion) -> FloatArray:
    axes = [rotations.rotate(motion.rotations, axis) for axis in np.eye(3)]
    return np.stack(axes, axis=-1)


def _contacts(motion: Motion, _: int) -> Array:
    return detect_contacts(motion).reshape(motion.n_frames, -1)


def _humanml(motion: Motion, _: int) -> FloatArray:
    return humanml3d(humanml_joints(motion.resample(HUMANML_RATE)))


FEATURES = {
    "rotations": Feature(
        "local rotations, quaternions xyzw: (T, J, 4)", lambda own, _: own.rotations
    ),
    "rotations_6d": Feature(
        "first two columns of the local rotation matrices: (T, J, 6)",
        lambda own, _: np.swapaxes(_matrices(own)[..., :2], 2, 3).reshape(own.n_frames, -1, 6),
    ),
    "matrices": Feature("local rotation matrices: (T, J, 3, 3)", lambda own, _: _matrices(own)),
    "root": Feature(
        "world position of the root, in the unit of the files: (T, 3)",
        lambda own, root: own.world_track(root)[1],
    ),
    "positions": Feature(
        "world positions of the joints, in the unit of the files: (T, J, 3)",
        lambda own, _: own.world_positions(),
    ),
    "contacts": Feature("contact of heel and toe of each leg: bool, (T, 2 * legs)", _contacts),
    "humanml3d": Feature(
        "the 263 numbers of HumanML3D at 20 frames per second: (S, 263)", _humanml, of_window=True
    ),
}
"""The features by name; all but contacts are float32."""

DEFAULT_FEATURES = ("rotations", "root", "contacts")


def check_features(names: Sequence[str], library: LibraryData) -> tuple[str, ...]:
    """Return names of features; raise ValueError if one is unknown or does not fit the library."""
    if isinstance(names, str):
        raise TypeError(f"`features` must be a list of names, got {names!r}")
    for name in names:
        if name not in FEATURES:
            hint = suggest_name(name, FEATURES)
            raise ValueError(f"`features` must be among {', '.join(FEATURES)}; got {name!r}{hint}")
    if not names:
        raise ValueError(f"`features` must name at least one of {', '.join(FEATURES)}; got none")
    if "humanml3d" in names:
        check_humanml_joints(library.skeleton)
    return tuple(dict.fromkeys(names))


def compute_tracks(names: Sequence[str], motion: Motion, root: int) -> dict[str, Array]:
    """Return the features of all frames of a motion, but those that are computed for windows."""
    whole = [name for name in names if not FEATURES[name].of_window]
    return {name: _as_stored(FEATURES[name].compute(motion, root)) for name in whole}


def cut_window(
    names: Sequence[str], tracks: dict[str, Array], motion: Motion | None, frames: slice, root: int
) -> dict[str, Array]:
    """Return the features of a window, in new arrays; `tracks` has those of all frames.

    The motion may be missing if `tracks` has all features.
    """
    row = {name: own[frames].copy() for name, own in tracks.items()}
    if motion is not None and len(row) < len(names):
        window = motion[frames]
        more = {own: FEATURES[own].compute(window, root) for own in names if own not in row}
        row |= {name: _as_stored(own) for name, own in more.items()}
    return {name: row[name] for name in names}


def _as_stored(track: Array) -> Array:
    return np.ascontiguousarray(track, np.bool_ if track.dtype == np.bool_ else np.float32)
