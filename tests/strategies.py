"""Hypothesis strategies for rotations and motions, and settings of slow tests."""

from dataclasses import replace

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from mograft import Motion, Segments, Skeleton
from mograft.motion import rotations
from mograft.motion.skeleton import usual_channels
from tests.hierarchies import human

SEEDS = st.integers(0, 2**32 - 1)
SEGMENT_LENGTHS = st.lists(st.integers(1, 15), min_size=1, max_size=8).map(np.array)

HOSTILE_NAMES = [
    "</script><script>document.title='owned'</script>",
    "<img src=x onerror=\"document.title='owned'\">",
    "a&b\"c'd`e${1}</title>",
    "<!--<script>",
    "</script <img src=x>",
    "</script/x",
    "\u2028\u2029\u202eevil\u0000\ud800",
    "",
]
"""Names that break out of HTML, scripts or XML unless they are escaped."""


def few_examples(count):
    """Return the settings of a test with another count of examples than Hypothesis's 100.

    The profile "thorough" has more than 100 in any case, and "few" at most 10.
    """
    default = settings.default.max_examples
    if default > 100:
        return settings()
    return settings(max_examples=count if default == 100 else min(count, default))


def vectors(shape, size=3.0):
    """Vectors of three components, each up to `size`."""
    return npst.arrays(np.float64, (*shape, 3), elements=st.floats(-size, size))


def quaternions(shape):
    """Unit quaternions, scalar last, covering the sphere and its poles."""
    numbers = npst.arrays(np.float64, (*shape, 4), elements=st.floats(-1, 1))
    long = numbers.filter(lambda q: (np.linalg.norm(q, axis=-1) > 0.1).all())
    return long.map(lambda q: q / np.linalg.norm(q, axis=-1, keepdims=True))


@st.composite
def rotation_tracks(draw, max_frames=8):
    """Frame times and the rotations of a few joints at those times."""
    n_frames, n_joints = draw(st.tuples(st.integers(2, max_frames), st.integers(1, 4)))
    steps = draw(npst.arrays(np.float64, n_frames - 1, elements=st.floats(1e-3, 1.0)))
    return np.concatenate([[0.0], steps.cumsum()]), draw(quaternions((n_frames, n_joints)))


def smooth_rotations(rng, n_frames, n_joints, speed=0.3):
    """Rotations that change direction from time to time, as limbs do: (F, J, 4)."""
    phase = rng.uniform(0, 2 * np.pi, (n_joints, 3))
    pace = rng.uniform(0.5, 2.0, (n_joints, 3)) * speed
    time = np.arange(n_frames)[:, None, None]
    return rotations.exp(rng.uniform(0.2, 1.0, (n_joints, 3)) * np.sin(pace * time + phase))


def skeletons(rng, n_joints):
    """A skeleton of random shape; joint 0 is its root."""
    parents = [-1, *(int(rng.integers(joint)) for joint in range(1, n_joints))]
    offsets = rng.uniform(-20, 20, (n_joints, 3))
    return Skeleton([f"joint{j}" for j in range(n_joints)], parents, offsets)


def motion_of(skeleton, quats, **fields):
    """A motion at 30 fps with given rotations, whose joints stay at their offsets."""
    positions = np.tile(skeleton.offsets, (len(quats), 1, 1))
    return Motion(skeleton, 1 / 30, quats, positions, **fields)


def still_motion(skeleton, n_frames):
    """A motion in the rest pose."""
    return motion_of(skeleton, np.tile(rotations.IDENTITY, (n_frames, skeleton.n_joints, 1)))


@st.composite
def motions(draw, min_frames=2, max_frames=120, min_joints=1, max_joints=6):
    """Smooth motions of random skeletons."""
    rng = np.random.default_rng(draw(SEEDS))
    n_frames = draw(st.integers(min_frames, max_frames))
    skeleton = skeletons(rng, draw(st.integers(min_joints, max_joints)))
    quats = smooth_rotations(rng, n_frames, skeleton.n_joints)
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    positions[:, 0] += np.cumsum(rng.normal(size=(n_frames, 3)), axis=0)
    return Motion(skeleton, 1 / 30, quats, positions, name="wander")


def tile_segments(lengths):
    """Successive segments of given lengths that cover a clip."""
    stops = np.cumsum(lengths)
    return Segments(stops - lengths, stops)


def star_skeleton(n_joints):
    """A root with limbs of one bone."""
    offsets = np.arange(3.0 * n_joints).reshape(n_joints, 3)
    return Skeleton([f"j{i}" for i in range(n_joints)], [-1] + [0] * (n_joints - 1), offsets)


def random_star_clip(rng, segments, n_joints=4, moving=()):
    """A clip as long as its segments, with channel values; the root and `moving` translate."""
    skeleton = star_skeleton(n_joints)
    n_frames = int(segments.stop[-1]) + 1
    quats = smooth_rotations(rng, n_frames, n_joints)
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    for joint in (0, *moving):
        positions[:, joint] += np.cumsum(rng.normal(size=(n_frames, 3)), axis=0)
    channels = usual_channels(joint in (0, *moving) for joint in range(n_joints))
    skeleton = replace(skeleton, channels=channels)
    quats = rotations.continuous_signs(quats)
    motion = Motion(skeleton, 1 / 30, quats, positions, name="clip")
    return replace(motion, channel_values=motion.channel_numbers())


def person(seed, n_frames=40):
    """A human who leans and turns at random."""
    rng = np.random.default_rng(seed)
    skeleton = human()
    quats = smooth_rotations(rng, n_frames, skeleton.n_joints, speed=0.2)
    return motion_of(skeleton, rotations.continuous_signs(quats), name=f"person{seed}")


def assert_same_rotations(actual, desired, atol=1e-12):
    """Assert that rotations are equal; `q` and `-q` are."""
    gaps = np.abs([actual - desired, actual + desired]).max(axis=-1).min(axis=0)
    np.testing.assert_array_less(gaps, atol)


def with_config(library, **changes):
    """Return a library with other fields of the configuration, without new clusters."""
    return replace(library, config=replace(library.config, **changes))


def scale_skeleton(skeleton, factor):
    """Return a skeleton in another unit."""
    sites = [replace(site, offset=site.offset * factor) for site in skeleton.end_sites]
    return replace(skeleton, offsets=skeleton.offsets * factor, end_sites=tuple(sites))


def turn_motion(motion, turn):
    """Return a motion that is turned as a whole by a quaternion."""
    quats, positions = motion.rotations.copy(), motion.positions.copy()
    quats[:, 0] = rotations.multiply(turn, quats[:, 0])
    positions[:, 0] = rotations.rotate(turn, positions[:, 0])
    return replace(motion, rotations=quats, positions=positions, channel_values=None)


def transform_motion(motion, scale=1.0, yaw=0.0, offset=(0.0, 0.0, 0.0)):
    """Return a motion with y up in another unit, with another heading and root position."""
    larger = replace(motion, positions=motion.positions * scale, channel_values=None)
    turned = turn_motion(larger, rotations.exp(np.array([0.0, yaw, 0.0])))
    positions = turned.positions.copy()
    positions[:, 0] += np.asarray(offset) * scale
    return replace(turned, skeleton=scale_skeleton(motion.skeleton, scale), positions=positions)
