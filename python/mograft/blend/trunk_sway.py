"""The response of a trunk to the fast horizontal motion of the pelvis, its sway."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.gaussian import gaussian_filter_columns
from mograft.blend.joint_track import joint_track
from mograft.body.anatomy import anatomy
from mograft.body.hierarchy import subtree_mask
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

SWAY_SMOOTHING = 0.1
"""Standard deviation, in seconds, of the Gaussian that separates sway from slower motion.

Chosen from 0.05, 0.1 and 0.2 s on the clips `dance_*` by the jerk of the head.
"""


def sway_compensation(clip: Motion, trunk: int, up: int, to_heading: FloatArray) -> FloatArray:
    """Return the rotations that remove from a trunk its response to the sway of its parent.

    The sway s is the position of the parent of joint `trunk`, less its average over
    `SWAY_SMOOTHING` seconds. The relative sway r is computed likewise from the position of the head
    relative to that parent. For each horizontal axis of the heading, the response is the factor b
    that minimizes the sum of (r - b s)² over all frames. The rotation in each frame is about joint
    `trunk` and displaces the head by -b s. It is relative to the heading: it is applied after
    `to_heading`, which rotates from the world to the heading. Both have shape (n_frames, 4). In a
    skeleton without neck and head, the last joint of the trunk replaces the head. If that joint is
    `trunk`, all rotations are the identity.
    """
    head = _top_joint(clip.skeleton, trunk)
    parent = int(clip.skeleton.parents[trunk])
    pelvis, top, pivot = (joint_track(clip, joint)[1] for joint in (parent, head, trunk))
    lever = rotations.rotate(to_heading, top - pivot).mean(axis=0)
    length = float(np.sqrt((lever**2).sum()))
    if length == 0.0:
        return np.tile(rotations.IDENTITY, (clip.n_frames, 1))
    sigma = SWAY_SMOOTHING * clip.rate
    sway, relative = (
        rotations.rotate(to_heading, path - gaussian_filter_columns(path, sigma))
        for path in (pelvis, top - pelvis)
    )
    power = (sway**2).sum(axis=0)
    response = (sway * relative).sum(axis=0) / np.where(power > 0.0, power, np.inf)
    response[up] = 0.0
    # The smallest rotation that displaces the end of the lever by -b s, as far as it is
    # perpendicular to the lever.
    return rotations.exp(np.cross(lever / length, -response * sway) / length)


def _top_joint(skeleton: Skeleton, trunk: int) -> int:
    """Return the joint whose position is taken as that of the head, among `trunk` and its subtree.

    It is the first joint of the head, or else the last one of the neck, or else the last one of the
    trunk.
    """
    known = anatomy(skeleton)
    is_carried = subtree_mask(skeleton, [trunk])
    for part, index in (("head", 0), ("neck", -1), ("trunk", -1)):
        found = [joint for joint in known.joints(part) if is_carried[joint]]
        if found:
            return found[index]
    return trunk
