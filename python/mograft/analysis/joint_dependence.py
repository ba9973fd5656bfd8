"""How strongly the motions of joints depend on each other, from canonical correlations."""

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.linalg import eigenvectors, product
from mograft.analysis.embedding import normalise
from mograft.body.anatomy import anatomy
from mograft.body.mass import mass_model, up_axis
from mograft.config import FRAME, Config
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments

N_PERMUTATIONS = 20
"""Number of permutations of segments from which the floor of the dependence is computed."""
_MIN_SPEED = np.radians(0.5)
"""Root mean square angular velocity, in radians per second, below which a joint does not move."""
_MIN_AXIS_SHARE = 0.05
"""Minimum speed about an axis of a joint, as a share of the speed about its main axis."""


def angular_velocities(
    motion: Motion, segments: Segments, joints: IntArray, config: Config
) -> FloatArray:
    """Return angular velocities in radians per second, (n_segments, samples - 1, n_joints, 3).

    Segments are resampled to `config.samples` frames. The velocity of the hips is relative to the
    world, that of other joints to their parents; all are in the axes of the joint.
    """
    skeleton = motion.skeleton
    samples = normalise(
        [motion],
        segments,
        config,
        root=anatomy(skeleton).hips,
        up=up_axis(motion),
        heights=[mass_model(skeleton).height],
    )
    quats = np.asarray(samples.rotations, np.float64)[:, :, joints]
    seconds = samples.displacements_and_length[:, -1] * FRAME / (config.samples - 1)
    steps = rotations.multiply(rotations.inverse(quats[:, :-1]), quats[:, 1:])
    return rotations.log(steps) / seconds[:, None, None, None]


def joint_dependence(velocities: FloatArray, seed: int) -> FloatArray:
    """Return the dependence of each pair of joints, shape (n_joints, n_joints), from 0 to 1.

    `velocities` has shape (n_segments, n_samples, n_joints, 3). The dependence of two joints is the
    mean r² of the squared canonical correlations of their angular velocities, corrected for chance:
    (r² - f) / (1 - f), and 0 if this is negative. The floor f is the mean of r² over
    `N_PERMUTATIONS` permutations, drawn with `seed`, of the segments of one of the two joints. The
    dependence is NaN if one of the joints does not move.
    """
    n, m, n_joints = velocities.shape[:3]
    axes = [_whiten(velocities[:, :, joint].reshape(n * m, 3)) for joint in range(n_joints)]
    widths = np.array([whitened.shape[1] for whitened in axes])
    stacked = np.concatenate(axes, axis=1)
    owners = np.repeat(np.arange(n_joints), widths)
    rng = np.random.default_rng(seed)
    floor = np.zeros((n_joints, n_joints))
    for _ in range(N_PERMUTATIONS):
        permuted = stacked.reshape(n, m, -1)[rng.permutation(n)].reshape(n * m, -1)
        floor += _mean_squares(product(permuted.T, stacked), owners, widths) / N_PERMUTATIONS
    floor = np.minimum(0.5 * (floor + floor.T), 1.0 - 1e-9)
    measured = _mean_squares(product(stacked.T, stacked), owners, widths)
    dependence: FloatArray = np.clip((measured - floor) / (1.0 - floor), 0.0, 1.0)
    dependence[widths == 0] = np.nan
    dependence[:, widths == 0] = np.nan
    return dependence


def _whiten(values: FloatArray) -> FloatArray:
    """Return the principal component scores of vectors, scaled to columns of norm 1.

    `values` has shape (n, 3), the result (n, n_components). Components with a deviation below
    `_MIN_AXIS_SHARE` of the largest one are left out. There are no columns if the root mean square
    length of the vectors is below `_MIN_SPEED`.
    """
    size = float(np.sqrt((values**2).sum(axis=1).mean()))
    if size < _MIN_SPEED:
        return values[:, :0]
    centred = (values - values.mean(axis=0)) / (size * np.sqrt(len(values)))
    variances, vectors = eigenvectors(product(centred.T, centred), 3)
    is_kept = variances > max(_MIN_AXIS_SHARE**2 * variances[0], 1e-9)
    return product(centred, vectors)[:, is_kept] / np.sqrt(variances[is_kept])


def _mean_squares(products: FloatArray, owners: IntArray, widths: IntArray) -> FloatArray:
    """Return the mean squared canonical correlation of each pair of joints.

    `products` has the inner products of the columns that `_whiten` returns for all joints.
    `owners` has the joint of each column, and `widths` the number of columns of each joint.
    """
    indicator = np.equal.outer(np.arange(len(widths)), owners).astype(np.float64)
    sums = indicator @ products**2 @ indicator.T
    return sums / np.maximum(np.minimum.outer(widths, widths), 1)
