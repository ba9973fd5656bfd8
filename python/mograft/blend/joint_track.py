"""World rotations and positions of single joints, from the chains of their ancestors."""

from mograft._util.arrays import FloatArray
from mograft.motion import rotations
from mograft.motion.motion import Motion


def joint_track(clip: Motion, joint: int) -> tuple[FloatArray, FloatArray]:
    """Return the world rotations, (n_frames, 4), and positions, (n_frames, 3), of a joint.

    Only the joint and its ancestors are computed, upwards from the joint. `Motion.world_track`
    computes all joints downwards, and its results differ by rounding.
    """
    quats, positions = clip.rotations[:, joint], clip.positions[:, joint]
    for ancestor in clip.skeleton.ancestors(joint):
        above = clip.rotations[:, ancestor]
        positions = clip.positions[:, ancestor] + rotations.rotate(above, positions)
        quats = rotations.multiply(above, quats)
    return quats, positions
