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
HEEL = np.array([0.0, -7.0, -5.0])
LABELS = ("legs", "arms", "phase", "stance")


class PlacedDance:
    """A dance with the world positions and rotations of its joints."""

    def __init__(self, seed, strides, rate):
        self.dance = dance(seed, strides=strides, rate=rate)
        self.motion, skeleton = self.dance.motion, self.dance.motion.skeleton
        turned, places = self.motion.world_transforms()
        self.positions = dict(zip(skeleton.names, places.swapaxes(0, 1), strict=True))
        self.rotations = dict(zip(skeleton.names, turned.swapaxes(0, 1), strict=True))
        local = self.motion.rotations.swapaxes(0, 1)
        self.local_rotations = dict(zip(skeleton.names, local, strict=True))
        self.tips = {skeleton.names[own.parent]: own.offset for own in skeleton.end_sites}

    def point(self, name, offset):
        """Return the world positions of a point that is fixed to a joint."""
        return self.positions[name] + rotations.rotate(self.rotations[name], offset)

    def tip(self, name):
        return self.point(name, self.tips[name])


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


def test_dance_seed_and_its_generator_give_the_same_bytes():
    first, second = dance(5, strides=2), dance(np.random.default_rng(5), strides=2)
    for name in ("rotations", "positions"):
        assert getattr(first.motion, name).tobytes() == getattr(second.motion, name).tobytes()
    for name in LABELS:
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    assert len({tuple(placed_dance(seed, 1).dance.legs[::30]) for seed in range(5)}) == 5


def test_skeleton_rest_pose_is_a_symmetric_t_pose():
    skeleton = placed_dance(0, 1).motion.skeleton
    rest = dict(zip(skeleton.names, skeleton.rest_positions(), strict=True))
    for name in (own for own in rest if own.startswith("Left")):
        mirrored = rest[name.replace("Left", "Right")] * [-1, 1, 1]
        np.testing.assert_array_equal(rest[name], mirrored)
    arm = np.array([rest[f"Left{part}"] for part in ("Arm", "ForeArm", "Hand")])
    np.testing.assert_array_equal(np.diff(arm, axis=0)[:, 1:], 0.0)
    assert (np.diff(arm[:, 0]) > 0).all()


@for_every_dance
def test_dance_contains_every_combination_once(sample):
    pairs = list(zip(sample.dance.legs.tolist(), sample.dance.arms.tolist(), strict=True))
    blocks = [pair for before, pair in pairwise([None, *pairs]) if pair != before]
    assert sorted(blocks) == sorted(product(LEG_STYLES, ARM_PATTERNS))


@for_every_dance
def test_dance_euler_angles_are_continuous(sample):
    numbers = sample.motion.channel_numbers()[:, 3:]
    assert np.abs(np.diff(numbers, axis=0)).max() < 32  # degrees from frame to frame
    assert np.abs(numbers).max() < 180


@pytest.mark.parametrize("seed", [0, 7])
def test_dance_double_rate_has_same_frames_in_between(seed):
    slow, fast = placed_dance(seed, 1), placed_dance(seed, 1, 60.0)
    assert abs(slow.motion.duration - fast.motion.duration) <= 1 / 30
    n_frames = min(len(slow.dance), len(fast.dance[::2]))
    found, expected = (own[:n_frames] for own in (fast.dance[::2], slow.dance))
    np.testing.assert_allclose(found.motion.rotations, expected.motion.rotations, atol=1e-7)
    np.testing.assert_allclose(found.motion.positions, expected.motion.positions, atol=1e-7)
    np.testing.assert_array_equal(found.legs, expected.legs)


def test_takes_partition_the_dance():
    whole = placed_dance(0, 1).dance
    parts = whole.takes(6)
    assert [part.motion.name for part in parts] == [f"dance_{number}" for number in range(1, 7)]
    for name in LABELS:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))
    joined = np.concatenate([part.motion.rotations for part in parts])
    np.testing.assert_array_equal(joined, whole.motion.rotations)
    assert np.ptp([len(part) for part in parts]) <= 1
    for n in (0, -1, 10**6):
        with pytest.raises(ValueError, match=rf"`n` must be 1 to \d+.*got {n}"):
            whole.takes(n)


def test_dance_invalid_argument_raises_error_naming_it():
    for arguments, message in (
        ({"rate": 0}, "`rate` must be above 0.*got 0"),
        ({"rate": np.nan}, "`rate` must be finite"),
        ({"rate": "fast"}, "`rate` must be real numbers"),
        ({"strides": 0}, "`strides` must be a whole number of at least 1, got 0"),
        ({"seed": -1}, "`seed` must be a whole number of at least 0, got -1"),
        ({"seed": None}, "`seed` must be a whole number of at least 0, got None"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            dance(**arguments)


@for_every_dance
def test_stance_feet_are_flat_and_still_and_stay_above_floor(sample):
    stance = sample.dance.stance
    assert stance.any(axis=1).all()
    assert 0.45 < stance.mean(axis=0).min() <= stance.mean(axis=0).max() < 0.75
    for column, side in enumerate(SIDES):
        name, stands = f"{side}Foot", stance[:, column]
        through = stands[1:] & stands[:-1]
        turned = rotations.angle(sample.rotations[name][1:], sample.rotations[name][:-1])
        assert turned[through].max() <= 1e-6
        assert speeds(sample.positions[name], 1.0)[through].max() <= 1e-6 * HEIGHT
        sole = np.stack([sample.tip(name), sample.point(name, HEEL)])[..., 1]
        assert np.abs(sole[:, stands]).max() <= 1e-6 * HEIGHT
        assert min(sole.min(), sample.positions[name][:, 1].min()) > -1e-6 * HEIGHT


@for_every_dance
def test_joints_stay_within_anatomical_ranges(sample):
    for side, out in SIDES.items():
        # Knees and elbows are hinges, which bend to one side.
        for part, axis, sign, low, high in (("Leg", 0, 1.0, 5, 130), ("ForeArm", 1, -out, 10, 145)):
            vectors = np.degrees(rotations.log(sample.local_rotations[f"{side}{part}"]))
            angles = sign * vectors[:, axis]
            assert low < angles.min() <= angles.max() < high
            np.testing.assert_allclose(np.delete(vectors, axis, axis=1), 0.0, atol=1e-9)
        for part, limit in (("Hand", 75), ("Shoulder", 25)):
            quats = sample.local_rotations[f"{side}{part}"]
            assert np.degrees(rotations.angle(quats, rotations.IDENTITY)).max() < limit
        ankle = np.degrees(rotations.to_euler(sample.local_rotations[f"{side}Foot"], "ZYX"))
        assert np.abs(ankle[:, :2]).max() < 25
        assert -72 < ankle[:, 2].min() <= ankle[:, 2].max() < 30  # toe up, down


@for_every_dance
def test_arms_keep_distance_from_trunk_head_and_thighs(sample):
    head, trunk = sample.positions["Head"], (sample.positions["Hips"], sample.positions["Neck"])
    middle_of_head = 0.5 * (head + sample.tip("Head"))
    for side in SIDES:
        elbow, wrist = sample.positions[f"{side}ForeArm"], sample.positions[f"{side}Hand"]
        tip = sample.tip(f"{side}Hand")
        for point in (elbow, 0.5 * (elbow + wrist), wrist, 0.5 * (wrist + tip), tip):
            assert distances(point, *trunk).min() > 12
            assert np.linalg.norm(point - middle_of_head, axis=-1).min() > 15
            for thigh in SIDES:
                ends = sample.positions[f"{thigh}UpLeg"], sample.positions[f"{thigh}Leg"]
                assert distances(point, *ends).min() > 7


@for_every_dance
def test_dance_speeds_and_accelerations_are_bounded(sample):
    motion, hips = sample.motion, sample.positions["Hips"]
    turns = rotations.angle(motion.rotations[1:], motion.rotations[:-1]) * motion.rate
    assert np.degrees(turns).max() < 850  # degrees a second
    assert speeds(hips, motion.rate).max() < 180  # cm a second
    assert speeds(np.diff(hips, axis=0), motion.rate**2).max() < 1400  # cm a second²
    for side in SIDES:
        assert speeds(sample.tip(f"{side}Hand"), motion.rate).max() < 900
        assert speeds(sample.positions[f"{side}Foot"], motion.rate).max() < 700


FORWARD = {"walk": 95, "turn": 40, "march": 58, "sidestep": 0, "bounce": 0, "lunge": 77}  # cm/s


@pytest.mark.parametrize("style", FORWARD)
def test_leg_styles_have_expected_root_velocity(style):
    sample, margin = placed_dance(), 20
    is_style = sample.dance.legs == style
    inside = np.convolve(is_style, np.ones(2 * margin + 1), "same") > 2 * margin
    velocities = np.diff(sample.positions["Hips"], axis=0) * sample.motion.rate
    heading = rotations.inverse(sample.rotations["Head"][1:])
    velocities = rotations.rotate(heading, velocities)[inside[1:]]
    assert abs(velocities[:, 2].mean() - FORWARD[style]) < 12
    assert (np.abs(velocities[:, 0]).mean() > 26) == (style == "sidestep")
