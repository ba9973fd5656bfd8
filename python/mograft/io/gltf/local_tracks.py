"""Local transforms of glTF nodes that give joints the world transforms of a motion."""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.io.gltf.document import GltfFile
from mograft.io.gltf.nodes import SCALE_TOLERANCE, Transforms, remove_mirroring
from mograft.io.rest_pose import POSITION_TOLERANCE, restore
from mograft.motion import rotations
from mograft.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class LocalTracks:
    """Local rotations and translations of joints in every frame."""

    rotations: FloatArray  # shape (n_frames, n_joints, 4), xyzw
    translations: FloatArray  # shape (n_frames, n_joints, 3)


def local_tracks(file: GltfFile, motion: Motion, nodes: Transforms) -> LocalTracks:
    """Return local transforms that give the joints of a file the world transforms of a motion.

    `nodes` holds, in every frame, the local transforms of `GltfFile.moved_nodes`. The transforms of
    the nodes above the root joint and the scales of the joints are used as they are. If a parent
    has a scale of 0, no translation gives the position, and the translation of `nodes` is returned.
    """
    world_turns, world_places = restore(file.rest, motion)
    parents = file.moved_parents.tolist()
    n_above, n_frames = len(file.above), motion.n_frames
    half_turns, _ = remove_mirroring(
        np.broadcast_to(rotations.IDENTITY, nodes.rotations.shape), nodes.scales
    )
    local = LocalTracks(np.empty(world_turns.shape), np.empty(world_places.shape))
    # Of each node: world rotation without mirroring, axes with scale as columns, position.
    turns: list[FloatArray] = []
    axes: list[FloatArray] = []
    places: list[FloatArray] = []
    for node, parent in enumerate(parents):
        joint = node - n_above
        above = turns[parent] if parent >= 0 else np.tile(rotations.IDENTITY, (n_frames, 1))
        base = axes[parent] if parent >= 0 else np.tile(np.eye(3), (n_frames, 1, 1))
        origin = places[parent] if parent >= 0 else np.zeros((n_frames, 3))
        mirror = half_turns[:, node]
        if joint < 0:
            own, shift = nodes.rotations[:, node], nodes.translations[:, node]
            turns.append(rotations.multiply(above, rotations.multiply(own, mirror)))
            places.append(origin + np.einsum("fij,fj->fi", base, shift))
        else:
            turns.append(world_turns[:, joint])
            places.append(world_places[:, joint])
            own = rotations.multiply(rotations.inverse(above), turns[node])
            own = rotations.multiply(own, rotations.inverse(mirror))
            local.rotations[:, joint] = own
            local.translations[:, joint] = _solve(
                base, places[node] - origin, nodes.translations[:, node]
            )
        columns = np.stack([rotations.rotate(own, np.eye(3)[i]) for i in range(3)], axis=-1)
        axes.append(base @ (columns * nodes.scales[:, node, None, :]))
    return LocalTracks(rotations.continuous_signs(local.rotations), local.translations)


def _solve(axes: FloatArray, vectors: FloatArray, fallback: FloatArray) -> FloatArray:
    """Return the coordinates of vectors, (n, 3), in terms of axes, the columns of (n, 3, 3).

    Where the axes are singular, return `fallback`, (n, 3).
    """
    sizes = np.linalg.norm(axes, axis=1)
    volumes = np.abs(np.linalg.det(axes))
    is_regular = volumes > 1e-9 * sizes.max(axis=1) ** 3
    found = fallback.copy()
    found[is_regular] = np.linalg.solve(axes[is_regular], vectors[is_regular][..., None])[..., 0]
    return found


def changed_tracks(
    file: GltfFile, motion: Motion, base: Motion, scales: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return whether each joint needs new rotations, and whether it needs new translations.

    A joint needs none if its values in `base` are the same, bit for bit. `scales` are those of
    `GltfFile.moved_nodes`. If the scales along the axes of a node differ, new rotations above a
    joint require new translations of the joint, too.
    """
    is_equal = (motion.rotations == base.rotations).all(axis=2)
    is_equal |= (motion.rotations == -base.rotations).all(axis=2)
    is_turned = ~is_equal.all(axis=0)
    is_moved = (motion.positions != base.positions).any(axis=(0, 2))
    spread = np.ptp(scales, axis=2) > SCALE_TOLERANCE * np.abs(scales[..., 0])
    if spread.any():
        parents = file.rest.parents
        below = np.zeros(len(parents), bool)
        for joint, parent in enumerate(parents.tolist()):
            below[joint] = parent >= 0 and (below[parent] or is_turned[parent])
        is_moved |= below
    return is_turned, is_moved


def differs_from_rest(file: GltfFile, tracks: LocalTracks) -> BoolArray:
    """Return whether the translations of each joint differ from that of its node, (n_joints,).

    Differences up to `POSITION_TOLERANCE` do not count. The result is always true for the root.
    """
    rest = file.tree.rest.translations[0, file.joints]
    reach = POSITION_TOLERANCE * np.abs(rest).max(initial=0.0)
    differs: BoolArray = np.abs(tracks.translations - rest).max(axis=(0, 2)) > reach
    differs[0] = True
    return differs


def frame_times(start: float, motion: Motion) -> FloatArray:
    """Return the times of the frames of a motion whose first frame is at `start` seconds."""
    return np.linspace(start, start + motion.duration, motion.n_frames)
