"""Motions of glTF files."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mograft.errors import FormatError
from mograft.io.clips import Clips
from mograft.io.gltf.animation import DEFAULT_RATE, choose_times, read_animation, sample
from mograft.io.gltf.document import GltfFile, local_parents, read_gltf_file
from mograft.io.gltf.nodes import to_world
from mograft.io.rest_pose import rebase
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


def open_gltf(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clips of a glTF file; see `mograft.io.formats.Opener`."""
    file = read_gltf_file(path)
    return Clips(
        path, file.clip_names, lambda clip: read_gltf_clip(file, clip, rate), "glTF", file.notes
    )


def read_gltf_clip(file: GltfFile, clip: int, rate: float | None = None) -> Motion:
    """Return the motion of a clip, sampled from its first to its last key.

    `rate`, in frames per second, is by default that of the keys if these lie on a uniform grid of
    at least 12 frames per second, else 30. Raises `FormatError` if the animation is invalid.
    """
    container, nodes = file.container, file.moved_nodes
    animation = read_animation(container, file.animations[clip], frozenset(nodes.tolist()))
    try:
        times = choose_times(animation, rate, len(nodes))
    except ValueError as error:
        raise FormatError(
            str(error), container.path, f"animations[{file.animations[clip]}]"
        ) from None
    rows = np.zeros(len(file.tree.names), np.int64)
    rows[nodes] = np.arange(len(nodes))
    local = sample(animation, times, file.tree.rest.of(nodes, 1), rows)
    turned, positions = to_world(local_parents(file.tree, nodes), local)
    first = len(file.above)
    count = len(times)
    frame_time = (times[-1] - times[0]) / (count - 1) if count > 1 else 1.0 / (rate or DEFAULT_RATE)
    motion = rebase(file.rest, turned[:, first:], positions[:, first:], frame_time)
    return replace(motion, name=file.clip_names[clip], path=container.path)
