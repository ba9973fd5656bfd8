"""The procedural dancer: its labels, anatomical limits, floor contact and styles."""

from functools import lru_cache
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mograft.dancer import ARM_PATTERNS, LEG_STYLES, dance
from mograft.motion import rotations

SIDES = {"Left": 1.0, "Right": -1.0}
HEIGHT = 170.0  # cm, of the figure
HEEL = [0.0, -7.0, -5.0]


class PlacedDance:
    """A dance with the world positions and rotations of its joints."""

    def __init__(self, seed, strides, rate=30.0):
        self.dance = dance(seed, strides=strides, rate=rate)
        self.motion = self.dance.motion
        self.rotations, self.positions = self.motion.world_transforms()
        self.index = self.motion.skeleton.index
        self.tips = {
            self.motion.skeleton.names[site.parent]: site.offset
            for site in self.motion.skeleton.end_sites
        }

    def position(self, name):
        return self.positions[:, self.index(name)]

    def rotation(self, name):
        return self.rotations[:, self.index(name)]

    def local_rotation(self, name):
        return self.motion.rotations[:, self.index(name)]

    def point(self, name, offset):
        """Return the world positions of a point that is fixed to a joint."""
        return self.position(name) + rotations.rotate(self.rotation(name), np.array(offset))

    def tip(self, name):
        return self.point(name, self.tips[name])

    def to_local(self, name, points):
        """Return the coordinates of points relative to a joint."""
        return rotations.rotate(
            rotations.inverse(self.rotation(name)), points - self.position(name)
        )


@lru_cache(maxsize=64)
def placed_dance(seed=0, strides=4, rate=30.0):
    return PlacedDance(seed, strides, rate)


def for_every_dance(test):
    """Run a test on the default dance and on four shorter ones."""
    random_dances = given(
        st.integers(0, 2**32).flatmap(lambda s: st.tuples(st.just(s), st.integers(1, 2)))
    )
    default_dance = example((0, 4))
    few_examples = settings(max_examples=4, deadline=None)
    return few_examples(default_dance(random_dances(lambda args: test(placed_dance(*args)))))


def speeds(values, rate):
    return np.linalg.norm(np.diff(values, axis=0), axis=-1) * rate


def distances(points, starts, ends):
    """Distances of points from the lines between two ends in each frame."""
    along = ends - starts
    fraction = np.einsum("fi,fi->f", points - starts, along) / np.einsum("fi,fi->f", along, along)
    return np.linalg.norm(points - starts - fraction.clip(0, 1)[:, None] * along, axis=-1)


def bend(quats, axis):
    """Angles of rotations about one axis in degrees; asserts that there is no other rotation."""
    others = [other for other in range(3) if other != axis]
    np.testing.assert_allclose(quats[:, others], 0.0, atol=1e-12)
    return np.degrees(2 * np.arctan2(quats[:, axis], quats[:, 3]))


# The data.


def test_dance_same_seed_gives_same_bytes():
    first, second = dance(5, strides=2), dance(5, strides=2)
    for name in ("rotations", "positions"):
        assert getattr(first.motion, name).tobytes() == getattr(second.motion, name).tobytes()
    for name in ("legs", "arms", "phase", "stance"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def test_dance_generator_equals_its_seed():
    by_generator = dance(np.random.default_rng(3), strides=1)
    np.testing.assert_array_equal(
        by_generator.motion.rotations, dance(3, strides=1).motion.rotations
    )


def test_dance_different_seeds_differ_in_order():
    orders = {tuple(placed_dance(seed, 1).dance.legs[::30]) for seed in range(5)}
    assert len(orders) == 5


def test_dance_default_has_about_6000_frames():
    sample = dance()
    assert 5700 < len(sample) < 6300
    assert repr(sample.motion).startswith("Motion(dance: 18 joints")


def test_skeleton_rest_pose_is_symmetric_t_pose():
    skeleton = placed_dance().motion.skeleton
    rest = dict(zip(skeleton.names, skeleton.rest_positions(), strict=True))
    for side, out in SIDES.items():
        arm = np.diff([rest[f"{side}{part}"] for part in ("Arm", "ForeArm", "Hand")], axis=0)
        assert (arm[:, 0] * out > 0).all()
        np.testing.assert_array_equal(arm[:, 1:], 0.0)
        leg = np.diff([rest[f"{side}{part}"] for part in ("UpLeg", "Leg", "Foot")], axis=0)
        assert (leg[:, 1] < 0).all()
    mirrored = [name.replace("Left", "Right") for name in skeleton.names if "Left" in name]
    for name in mirrored:
        np.testing.assert_array_equal(rest[name] * [-1, 1, 1], rest[name.replace("Right", "Left")])


@for_every_dance
def test_dance_contains_every_combination_once(sample):
    pairs = list(zip(sample.dance.legs.tolist(), sample.dance.arms.tolist(), strict=True))
    blocks = [pair for before, pair in pairwise([None, *pairs]) if pair != before]
    assert sorted(blocks) == sorted(product(LEG_STYLES, ARM_PATTERNS))


@for_every_dance
def test_dance_labels_have_one_entry_per_frame(sample):
    n_frames = sample.motion.n_frames
    labels = sample.dance
    assert labels.legs.shape == labels.arms.shape == labels.phase.shape == (n_frames,)
    assert labels.stance.shape == (n_frames, 2)
    assert 0 <= labels.phase.min() <= labels.phase.max() <= 1


@for_every_dance
def test_dance_rotations_are_unit_and_continuous(sample):
    quats = sample.motion.rotations
    np.testing.assert_allclose(np.linalg.norm(quats, axis=-1), 1.0, rtol=0, atol=1e-12)
    assert (np.einsum("fji,fji->fj", quats[1:], quats[:-1]) > 0.97).all()


@for_every_dance
def test_dance_euler_angles_are_continuous(sample):
    numbers = sample.motion.channel_numbers()[:, 3:]
    assert np.isfinite(numbers).all()
    assert np.abs(np.diff(numbers, axis=0)).max() < 32  # degrees from frame to frame
    assert np.abs(numbers).max() < 180


@pytest.mark.parametrize("seed", [0, 7])
def test_dance_double_rate_has_same_frames_in_between(seed):
    slow, fast = placed_dance(seed, 1), placed_dance(seed, 1, 60.0)
    assert abs(slow.motion.duration - fast.motion.duration) <= 1 / 30
    n_frames = min(len(slow.dance), len(fast.dance[::2]))
    for name in ("rotations", "positions"):
        np.testing.assert_allclose(
            getattr(fast.motion[::2], name)[:n_frames],
            getattr(slow.motion, name)[:n_frames],
            atol=1e-7,
        )
    np.testing.assert_array_equal(fast.dance[::2].legs[:n_frames], slow.dance.legs[:n_frames])


def test_takes_partition_the_dance():
    whole = placed_dance(0, 1).dance
    parts = whole.takes(6)
    assert [part.motion.name for part in parts] == [f"dance_{number}" for number in range(1, 7)]
    for name in ("legs", "arms", "phase", "stance"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))
    joined = np.concatenate([part.motion.rotations for part in parts])
    np.testing.assert_array_equal(joined, whole.motion.rotations)
    assert np.ptp([len(part) for part in parts]) <= 1


@pytest.mark.parametrize("n", [0, -1, 10**6])
def test_takes_invalid_count_raises_value_error(n):
    with pytest.raises(ValueError, match=rf"`n` must be 1 to \d+.*got {n}"):
        placed_dance(0, 1).dance.takes(n)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"rate": 0}, ValueError, "`rate` must be above 0.*got 0"),
        ({"rate": -30.0}, ValueError, "`rate` must be above 0.*got -30"),
        ({"rate": np.nan}, ValueError, "`rate` must be finite"),
        ({"rate": "fast"}, TypeError, "`rate` must be real numbers"),
        ({"strides": 0}, ValueError, "`strides` must be a whole number of at least 1, got 0"),
        ({"strides": 1.5}, ValueError, "`strides` must be a whole number .*, got 1.5"),
        ({"strides": True}, ValueError, "`strides` must be a whole number .*, got True"),
        ({"seed": -1}, ValueError, "`seed` must be a whole number of at least 0, got -1"),
        ({"seed": 0.5}, ValueError, "`seed` must be a whole number of at least 0, got 0.5"),
        ({"seed": None}, ValueError, "`seed` must be a whole number of at least 0, got None"),
        ({"seed": True}, ValueError, "`seed` must be a whole number of at least 0, got True"),
    ],
)
def test_dance_invalid_argument_raises_error_naming_it(arguments, error, message):
    with pytest.raises(error, match=message):
        dance(**arguments)


# The feet and the floor.


@for_every_dance
def test_stance_feet_are_flat_and_still(sample):
    for column, side in enumerate(SIDES):
        stands = sample.dance.stance[:, column]
        through = stands[1:] & stands[:-1]
        name = f"{side}Foot"
        moved = np.linalg.norm(np.diff(sample.position(name), axis=0), axis=-1)
        assert moved[through].max() <= 1e-6 * HEIGHT
        turned = rotations.angle(sample.rotation(name)[1:], sample.rotation(name)[:-1])
        assert turned[through].max() <= 1e-6
        sole = np.stack([sample.tip(name), sample.point(name, HEEL)])[:, stands, 1]
        assert np.abs(sole).max() <= 1e-6 * HEIGHT


@for_every_dance
def test_stance_covers_all_frames_and_half_of_each_foot(sample):
    assert sample.dance.stance.any(axis=1).all()
    shares = sample.dance.stance.mean(axis=0)
    assert 0.45 < shares.min() <= shares.max() < 0.75


@for_every_dance
def test_feet_stay_above_floor(sample):
    for side in SIDES:
        for offset in (HEEL, sample.tips[f"{side}Foot"], [0.0, 0.0, 0.0]):
            assert sample.point(f"{side}Foot", offset)[:, 1].min() > -1e-6 * HEIGHT


# The joints.


@for_every_dance
def test_knees_bend_forward_within_anatomical_range(sample):
    for side in SIDES:
        angles = bend(sample.local_rotation(f"{side}Leg"), 0)
        assert 5 < angles.min() <= angles.max() < 130
        hip, knee, ankle = (sample.position(f"{side}{part}") for part in ("UpLeg", "Leg", "Foot"))
        ahead = rotations.rotate(sample.rotation("Hips"), np.array([0.0, 0.0, 1.0]))
        forward = np.einsum("fi,fi->f", knee - 0.5 * (hip + ankle), ahead)
        assert forward.min() > 0


@for_every_dance
def test_ankles_stay_within_anatomical_range(sample):
    for side in SIDES:
        angles = np.degrees(rotations.to_euler(sample.local_rotation(f"{side}Foot"), "ZYX"))
        assert np.abs(angles[:, :2]).max() < 25
        assert -72 < angles[:, 2].min() <= angles[:, 2].max() < 30  # toe up, down


@for_every_dance
def test_elbows_bend_outward_within_anatomical_range(sample):
    for side, out in SIDES.items():
        angles = -out * bend(sample.local_rotation(f"{side}ForeArm"), 1)
        assert 10 < angles.min() <= angles.max() < 145
        arm, elbow, wrist = (
            sample.to_local("Spine", sample.position(f"{side}{part}"))
            for part in ("Arm", "ForeArm", "Hand")
        )
        # Elbows point outward, back or down.
        outside = (elbow - 0.5 * (arm + wrist)) @ np.array([out, -1.0, -1.0])
        assert outside.min() > 0


@for_every_dance
def test_wrists_and_collar_bones_stay_within_anatomical_range(sample):
    for side in SIDES:
        for part, limit in (("Hand", 75), ("Shoulder", 25)):
            quats = sample.local_rotation(f"{side}{part}")
            assert np.degrees(rotations.angle(quats, rotations.IDENTITY)).max() < limit


@for_every_dance
def test_arms_keep_distance_from_trunk_head_and_thighs(sample):
    middle_of_head = sample.position("Head") + 0.5 * (sample.tip("Head") - sample.position("Head"))
    for side in SIDES:
        elbow, wrist = sample.position(f"{side}ForeArm"), sample.position(f"{side}Hand")
        tip = sample.tip(f"{side}Hand")
        for point in (elbow, 0.5 * (elbow + wrist), wrist, 0.5 * (wrist + tip), tip):
            assert distances(point, sample.position("Hips"), sample.position("Neck")).min() > 12
            assert np.linalg.norm(point - middle_of_head, axis=-1).min() > 15
            for thigh in SIDES:
                ends = sample.position(f"{thigh}UpLeg"), sample.position(f"{thigh}Leg")
                assert distances(point, *ends).min() > 7


@for_every_dance
def test_limbs_do_not_cross(sample):
    hands = [sample.to_local("Spine", sample.tip(f"{side}Hand"))[:, 0] for side in SIDES]
    wrists = [sample.to_local("Spine", sample.position(f"{side}Hand"))[:, 0] for side in SIDES]
    assert min(hands[0].min(), wrists[0].min()) > 0
    assert max(hands[1].max(), wrists[1].max()) < 0
    left, right = (sample.to_local("Hips", sample.position(f"{side}Foot"))[:, 0] for side in SIDES)
    assert (left - right).min() > 3.0


@for_every_dance
def test_dance_speeds_and_accelerations_are_bounded(sample):
    motion = sample.motion
    turns = rotations.angle(motion.rotations[1:], motion.rotations[:-1]) * motion.rate
    assert np.degrees(turns).max() < 850  # degrees a second
    assert speeds(sample.position("Hips"), motion.rate).max() < 180  # cm a second
    acceleration = np.diff(sample.position("Hips"), n=2, axis=0) * motion.rate**2
    assert np.linalg.norm(acceleration, axis=-1).max() < 1400  # cm a second²
    for side in SIDES:
        assert speeds(sample.tip(f"{side}Hand"), motion.rate).max() < 900
        assert speeds(sample.position(f"{side}Foot"), motion.rate).max() < 700


# The dance.


def inner(sample, legs=None, arms=None, margin=20):
    """Select the frames of a style or a pattern, without the margins of each block."""
    selected = np.ones(len(sample), dtype=bool)
    for labels, style in ((sample.legs, legs), (sample.arms, arms)):
        selected &= (labels == style) if style else True
    edges = np.flatnonzero(np.diff(selected, prepend=False, append=False)).reshape(-1, 2)
    for start, stop in edges:
        selected[start : start + margin] = selected[max(stop - margin, 0) : stop] = False
    return selected


@pytest.mark.parametrize(
    ("style", "forward", "aside"),
    [  # cm a second
        ("walk", 95, False),
        ("turn", 40, False),
        ("march", 58, False),
        ("sidestep", 0, True),
        ("bounce", 0, False),
        ("lunge", 77, False),
    ],
)
def test_leg_styles_have_expected_root_velocity(style, forward, aside):
    sample = placed_dance()
    frames = inner(sample.dance, legs=style)[1:]
    velocities = np.diff(sample.position("Hips"), axis=0) * sample.motion.rate
    heading = rotations.inverse(sample.rotation("Head")[1:])
    velocities = rotations.rotate(heading, velocities)[frames]
    assert abs(velocities[:, 2].mean() - forward) < 12
    assert (np.abs(velocities[:, 0]).mean() > 26) == aside
