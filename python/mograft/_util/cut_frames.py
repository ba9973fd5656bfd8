"""Checks of cut frames that users give for each clip."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mograft._util.containers import FrozenMapping


def freeze_cut_frames(clips: Mapping[Any, Any]) -> FrozenMapping[str, tuple[int, ...]]:
    """Return an immutable copy of a mapping from clip name to cut frames.

    Raises ValueError unless every key is a string and its value holds ascending whole numbers of at
    least 0.
    """
    frozen = {}
    for name, frames in clips.items():
        if not isinstance(name, str):
            raise ValueError(f"`segmentation` must map names of clips to frames, got {name!r}")
        frozen[name] = as_cut_frames(frames, f"of `segmentation` for the clip {name!r}")
    return FrozenMapping(frozen)


def as_cut_frames(frames: object, source: str) -> tuple[int, ...]:
    """Return cut frames as a tuple; `source` follows "cut frames" in the message of an error.

    Raises ValueError unless they are ascending whole numbers of at least 0.
    """
    try:
        array = np.asarray(frames)
    except ValueError:
        array = np.asarray(frames, object)
    is_whole = array.ndim == 1 and (array.dtype.kind in "iu" or not array.size)
    if not is_whole or (array < 0).any() or (np.diff(array.astype(np.int64)) <= 0).any():
        raise ValueError(
            f"cut frames {source} must be ascending whole numbers of at least 0, got {frames!r}"
        )
    return tuple(int(frame) for frame in array)
