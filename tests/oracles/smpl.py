"""Forward kinematics of SMPL as its paper states it: rotation vectors, 4 by 4 matrices, a loop."""

import numpy as np
from scipy.spatial.transform import Rotation

# `kintree_table[0]` of SMPL-H; the face of SMPL-X comes before the fingers.
BODY = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19]


def fingers(first):
    """Parents of 30 finger joints, the first of which has the index `first`."""
    parents = []
    for finger in range(10):
        start = first + 3 * finger
        parents += [20 if finger < 5 else 21, start, start + 1]
    return parents


PARENTS = {72: [*BODY, 20, 21], 156: [*BODY, *fingers(22)], 165: [*BODY, 15, 15, 15, *fingers(25)]}


def joints(poses, trans, rest):
    """Return joint positions (F, J, 3) from poses (F, 3 J) and rest positions `rest` (J, 3)."""
    parents = PARENTS[poses.shape[1]]
    positions = np.empty((len(poses), len(parents), 3))
    for frame, (pose, shift) in enumerate(zip(poses, trans, strict=True)):
        world = []
        for joint, parent in enumerate(parents):
            local = np.eye(4)
            local[:3, :3] = Rotation.from_rotvec(pose[3 * joint : 3 * joint + 3]).as_matrix()
            local[:3, 3] = rest[joint] - (rest[parent] if parent >= 0 else 0)
            world.append(local if parent < 0 else world[parent] @ local)
            positions[frame, joint] = world[joint][:3, 3] + shift
    return positions
