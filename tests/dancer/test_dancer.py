"""Laws of the dancer: what a body, a floor and a clock demand of every dance."""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mograft.dancer import ARM_PATTERNS, LEG_STYLES, dance
from mograft.motion import rotations

LOWER = [
    "Hips",
    *[f"{side}{part}" for side in ("Left", "Right") for part in ("UpLeg", "Leg", "Foot")],
]
SIDES = {"Left": 1.0, "Right": -1.0}
HEIGHT = 170.0  # cm, of the figure
HEEL = [0.0, -7.0, -5.0]


class Seen:
    """A dance with its joints placed in the world."""

    def __init__(self, seed, strides, rate=30.0):
        self.dance = dance(seed, strides=strides, rate=rate)
        self.motion = self.dance.motion
        self.turns, self.places = self.motion.world_transforms()
        self.index = self.motion.skeleton.index
        self.tips = {
            self.motion.skeleton.names[site.parent]: site.offset
            for site in self.motion.skeleton.end_sites
        }

    def at(self, name):
        return self.places[:, self.index(name)]

    def turn(self, name):
        return self.turns[:, self.index(name)]

    def local(self, name):
        return self.motion.rotations[:, self.index(name)]

    def point(self, name, offset):
        """Place a point of a joint's body in the world."""
        return self.at(name) + rotations.rotate(self.turn(name), np.array(offset))

    def tip(self, name):
        return self.point(name, self.tips[name])

    def towards(self, name, points):
        """Look at points from a joint: along its axes."""
        return rotations.rotate(rotations.inverse(self.turn(name)), points - self.at(name))


@lru_cache(maxsize=64)
def seen(seed=0, strides=4, rate=30.0):
    return Seen(seed, strides, rate)


def in_every_dance(test):
    """Run a test on the built-in sample and on a few shorter dances."""
    drawn = given(st.integers(0, 2**32).flatmap(lambda s: st.tuples(st.just(s), st.integers(1, 2))))
    whole = example((0, 4))
    few = settings(max_examples=8, deadline=None)
    return few(whole(drawn(lambda which: test(seen(*which)))))


def speeds(values, rate):
    return np.linalg.norm(np.diff(values, axis=0), axis=-1) * rate


def distances(points, starts, ends):
    """Distances of points from lines between two moving ends, frame by frame."""
    along = ends - starts
    share = np.einsum("fi,fi->f", points - starts, along) / np.einsum("fi,fi->f", along, along)
    return np.linalg.norm(points - starts - share.clip(0, 1)[:, None] * along, axis=-1)


def bend(quats, axis):
    """Angles of rotations about one coordinate axis; the other two must be still."""
    others = [other for other in range(3) if other != axis]
    np.testing.assert_allclose(quats[:, others], 0.0, atol=1e-12)
    return np.degrees(2 * np.arctan2(quats[:, axis], quats[:, 3]))


# The data.


def test_the_same_seed_gives_the_same_bytes():
    first, second = dance(5, strides=2), dance(5, strides=2)
    for name in ("rotations", "positions"):
        assert getattr(first.motion, name).tobytes() == getattr(second.motion, name).tobytes()
    for name in ("legs", "arms", "phase", "stance"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def test_a_generator_may_stand_for_the_seed():
    by_generator = dance(np.random.default_rng(3), strides=1)
    np.testing.assert_array_equal(
        by_generator.motion.rotations, dance(3, strides=1).motion.rotations
    )


def test_different_seeds_give_different_dances():
    orders = {tuple(seen(seed, 1).dance.legs[::30]) for seed in range(5)}
    assert len(orders) == 5


def test_the_sample_is_as_long_as_the_papers():
    sample = dance()
    assert 5700 < len(sample) < 6300
    assert repr(sample.motion).startswith("Motion(dance: 18 joints")


def test_the_figure_has_the_papers_degrees_of_freedom():
    skeleton = seen().motion.skeleton
    counts = dict(zip(skeleton.names, map(len, skeleton.channels), strict=True))
    assert sum(counts.values()) == skeleton.n_channels == 57
    assert sum(counts[name] for name in LOWER) == 24
    upper = ["Spine", "Neck", "Head"]
    upper += [f"{s}{part}" for s in SIDES for part in ("Shoulder", "Arm", "ForeArm", "Hand")]
    assert sum(counts[name] for name in upper) == 33
    assert set(counts) == {*LOWER, *upper}


def test_the_figure_rests_in_a_t_pose():
    skeleton = seen().motion.skeleton
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


def test_the_root_has_its_channels_in_the_common_order():
    channels = seen().motion.skeleton.channels
    places = ("Xposition", "Yposition", "Zposition")
    turns = ("Zrotation", "Yrotation", "Xrotation")
    assert channels == (places + turns, *[turns] * 17)


@in_every_dance
def test_every_combination_is_danced_once(seen):
    pairs = list(zip(seen.dance.legs.tolist(), seen.dance.arms.tolist(), strict=True))
    blocks = [pair for before, pair in pairwise([None, *pairs]) if pair != before]
    assert sorted(blocks) == sorted(product(LEG_STYLES, ARM_PATTERNS))


@in_every_dance
def test_labels_have_one_entry_per_frame(seen):
    n_frames = seen.motion.n_frames
    known = seen.dance
    assert known.legs.shape == known.arms.shape == known.phase.shape == (n_frames,)
    assert known.stance.shape == (n_frames, 2)
    assert (known.phase >= 0).all()
    assert (known.phase <= 1).all()


@in_every_dance
def test_rotations_are_unit_and_do_not_jump(seen):
    quats = seen.motion.rotations
    np.testing.assert_allclose(np.linalg.norm(quats, axis=-1), 1.0, rtol=0, atol=1e-12)
    assert (np.einsum("fji,fji->fj", quats[1:], quats[:-1]) > 0.97).all()


@in_every_dance
def test_euler_angles_do_not_jump(seen):
    numbers = seen.motion.channel_numbers()[:, 3:]
    assert np.isfinite(numbers).all()
    assert np.abs(np.diff(numbers, axis=0)).max() < 32  # degrees from frame to frame
    assert np.abs(numbers).max() < 180


@pytest.mark.parametrize("seed", [0, 7])
def test_the_dance_does_not_depend_on_the_frame_rate(seed):
    slow, fast = seen(seed, 1), seen(seed, 1, 60.0)
    assert abs(slow.motion.duration - fast.motion.duration) <= 1 / 30
    n_frames = min(len(slow.dance), len(fast.dance[::2]))
    for name in ("rotations", "positions"):
        np.testing.assert_allclose(
            getattr(fast.motion[::2], name)[:n_frames],
            getattr(slow.motion, name)[:n_frames],
            atol=1e-7,
        )
    np.testing.assert_array_equal(fast.dance[::2].legs[:n_frames], slow.dance.legs[:n_frames])


def test_takes_are_the_dance_in_parts():
    whole = seen(0, 1).dance
    parts = whole.takes(6)
    assert [part.motion.name for part in parts] == [f"dance_{number}" for number in range(1, 7)]
    for name in ("legs", "arms", "phase", "stance"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))
    joined = np.concatenate([part.motion.rotations for part in parts])
    np.testing.assert_array_equal(joined, whole.motion.rotations)
    assert np.ptp([len(part) for part in parts]) <= 1


@pytest.mark.parametrize("n", [0, -1, 10**6])
def test_takes_must_hold_a_frame_each(n):
    with pytest.raises(ValueError, match=rf"n must be 1 to \d+.*got {n}"):
        seen(0, 1).dance.takes(n)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"rate": 0}, ValueError, "rate must be above 0.*got 0"),
        ({"rate": -30.0}, ValueError, "rate must be above 0.*got -30"),
        ({"rate": np.nan}, ValueError, "rate must be finite"),
        ({"rate": "fast"}, TypeError, "rate must be real numbers"),
        ({"strides": 0}, ValueError, "strides must be 1 or more, got 0"),
        ({"strides": 1.5}, TypeError, "strides must be a whole number, got 1.5"),
        ({"strides": True}, TypeError, "strides must be a whole number, got True"),
        ({"seed": -1}, ValueError, "seed must be 0 or more, got -1"),
        ({"seed": 0.5}, TypeError, "seed must be a whole number or a .*Generator, got 0.5"),
        ({"seed": None}, TypeError, "seed must be a whole number or a .*Generator, got None"),
        ({"seed": True}, TypeError, "seed must be a whole number or a .*Generator, got True"),
    ],
)
def test_bad_arguments_are_named(arguments, error, message):
    with pytest.raises(error, match=message):
        dance(**arguments)


# The feet and the floor.


@in_every_dance
def test_standing_feet_are_still_and_flat(seen):
    for column, side in enumerate(SIDES):
        stands = seen.dance.stance[:, column]
        through = stands[1:] & stands[:-1]
        name = f"{side}Foot"
        moved = np.linalg.norm(np.diff(seen.at(name), axis=0), axis=-1)
        assert moved[through].max() <= 1e-6 * HEIGHT
        turned = rotations.angle(seen.turn(name)[1:], seen.turn(name)[:-1])
        assert turned[through].max() <= 1e-6
        sole = np.stack([seen.tip(name), seen.point(name, HEEL)])[:, stands, 1]
        assert np.abs(sole).max() <= 1e-6 * HEIGHT


@in_every_dance
def test_a_foot_stands_all_the_time_and_each_foot_most_of_it(seen):
    assert seen.dance.stance.any(axis=1).all()
    shares = seen.dance.stance.mean(axis=0)
    assert (shares > 0.45).all()
    assert (shares < 0.75).all()


@in_every_dance
def test_feet_stay_above_the_floor(seen):
    for side in SIDES:
        for offset in (HEEL, seen.tips[f"{side}Foot"], [0.0, 0.0, 0.0]):
            assert seen.point(f"{side}Foot", offset)[:, 1].min() > -1e-6 * HEIGHT


def test_feet_roll_over_a_toe_that_stays():
    sample = seen(0, 1, 120.0)
    styles = [LEG_STYLES[name] for name in sample.dance.legs]
    swing, push = (
        np.array([getattr(style, name) for style in styles]) for name in ("swing", "push")
    )
    for column, (side, middle) in enumerate(zip(SIDES, (0.25, 0.75), strict=True)):
        share = (sample.dance.phase - middle) / swing + 0.5  # of the swing
        rolls = (share > 0) & (share < push) & ~sample.dance.stance[:, column]
        through = rolls[1:] & rolls[:-1]
        toe, heel = sample.tip(f"{side}Foot"), sample.point(f"{side}Foot", HEEL)
        assert np.linalg.norm(np.diff(toe, axis=0), axis=-1)[through].max() < 1e-6 * HEIGHT
        assert np.diff(heel[:, 1])[through].min() > 0
        assert heel[rolls, 1].max() > 2


def test_the_pelvis_sinks_where_a_leg_would_be_too_short(monkeypatch):
    for name, style in LEG_STYLES.items():
        monkeypatch.setitem(LEG_STYLES, name, replace(style, height=style.height + 12))
    tall = Seen(0, 1)
    assert tall.at("Hips")[:, 1].max() < 94  # where both legs are straight
    for column, side in enumerate(SIDES):
        stands = tall.dance.stance[:, column]
        np.testing.assert_allclose(tall.at(f"{side}Foot")[stands, 1], 7.0, atol=1e-6 * HEIGHT)
        assert bend(tall.local(f"{side}Leg"), 0).min() > 5
    acceleration = np.diff(tall.at("Hips"), n=2, axis=0) * tall.motion.rate**2
    assert np.linalg.norm(acceleration, axis=-1).max() < 4000  # cm a second²


@in_every_dance
def test_toes_clear_the_floor_in_mid_swing(seen):
    for column, (side, middle) in enumerate(zip(SIDES, (0.28, 0.78), strict=True)):
        swings = ~seen.dance.stance[:, column] & (np.abs(seen.dance.phase - middle) < 0.03)
        assert swings.any()
        assert seen.tip(f"{side}Foot")[swings, 1].min() > 0.5


@in_every_dance
def test_feet_do_not_cross(seen):
    left, right = (seen.towards("Hips", seen.at(f"{side}Foot"))[:, 0] for side in SIDES)
    assert (left - right).min() > 3.0


# The joints.


@in_every_dance
def test_knees_bend_as_knees_do(seen):
    for side in SIDES:
        angles = bend(seen.local(f"{side}Leg"), 0)
        assert angles.min() > 5
        assert angles.max() < 130
        hip, knee, ankle = (seen.at(f"{side}{part}") for part in ("UpLeg", "Leg", "Foot"))
        ahead = rotations.rotate(seen.turn("Hips"), np.array([0.0, 0.0, 1.0]))
        forward = np.einsum("fi,fi->f", knee - 0.5 * (hip + ankle), ahead)
        assert forward.min() > 0


@in_every_dance
def test_ankles_stay_in_their_range(seen):
    for side in SIDES:
        angles = np.degrees(rotations.to_euler(seen.local(f"{side}Foot"), "ZYX"))
        assert np.abs(angles[:, :2]).max() < 25
        assert angles[:, 2].min() > -72  # toe up
        assert angles[:, 2].max() < 30


@in_every_dance
def test_elbows_bend_as_elbows_do(seen):
    for side, out in SIDES.items():
        angles = -out * bend(seen.local(f"{side}ForeArm"), 1)
        assert angles.min() > 10
        assert angles.max() < 145
        arm, elbow, wrist = (
            seen.towards("Spine", seen.at(f"{side}{part}")) for part in ("Arm", "ForeArm", "Hand")
        )
        # They point out, back or down, never all to the other side.
        outside = (elbow - 0.5 * (arm + wrist)) @ np.array([out, -1.0, -1.0])
        assert outside.min() > 0


@in_every_dance
def test_wrists_and_collar_bones_bend_little(seen):
    for side in SIDES:
        still = np.broadcast_to(rotations.IDENTITY, seen.local("Hips").shape)
        assert np.degrees(rotations.angle(seen.local(f"{side}Hand"), still)).max() < 75
        assert np.degrees(rotations.angle(seen.local(f"{side}Shoulder"), still)).max() < 25


@in_every_dance
def test_arms_stay_outside_the_body(seen):
    middle_of_head = seen.at("Head") + 0.5 * (seen.tip("Head") - seen.at("Head"))
    for side in SIDES:
        elbow, wrist = seen.at(f"{side}ForeArm"), seen.at(f"{side}Hand")
        tip = seen.tip(f"{side}Hand")
        for point in (elbow, 0.5 * (elbow + wrist), wrist, 0.5 * (wrist + tip), tip):
            assert distances(point, seen.at("Hips"), seen.at("Neck")).min() > 12
            assert np.linalg.norm(point - middle_of_head, axis=-1).min() > 15
            for thigh in SIDES:
                ends = seen.at(f"{thigh}UpLeg"), seen.at(f"{thigh}Leg")
                assert distances(point, *ends).min() > 7


@in_every_dance
def test_arms_do_not_cross(seen):
    hands = [seen.towards("Spine", seen.tip(f"{side}Hand"))[:, 0] for side in SIDES]
    wrists = [seen.towards("Spine", seen.at(f"{side}Hand"))[:, 0] for side in SIDES]
    assert min(hands[0].min(), wrists[0].min()) > 0
    assert max(hands[1].max(), wrists[1].max()) < 0


@in_every_dance
def test_nothing_is_too_fast(seen):
    motion = seen.motion
    turns = rotations.angle(motion.rotations[1:], motion.rotations[:-1]) * motion.rate
    assert np.degrees(turns).max() < 850  # degrees a second
    assert speeds(seen.at("Hips"), motion.rate).max() < 180  # cm a second
    acceleration = np.diff(seen.at("Hips"), n=2, axis=0) * motion.rate**2
    assert np.linalg.norm(acceleration, axis=-1).max() < 1400  # cm a second²
    for side in SIDES:
        assert speeds(seen.tip(f"{side}Hand"), motion.rate).max() < 900
        assert speeds(seen.at(f"{side}Foot"), motion.rate).max() < 700


# The dance.


def inner(sample, legs=None, arms=None, margin=20):
    """Mark the frames of a style or a pattern away from where it begins and ends."""
    own = np.ones(len(sample), dtype=bool)
    for labels, wanted in ((sample.legs, legs), (sample.arms, arms)):
        own &= (labels == wanted) if wanted else True
    edges = np.flatnonzero(np.diff(own, prepend=False, append=False)).reshape(-1, 2)
    for start, stop in edges:
        own[start : start + margin] = own[max(stop - margin, 0) : stop] = False
    return own


def test_hands_meet_in_front_when_they_clap():
    sample = seen()
    clap = inner(sample.dance, arms="clap")
    gaps = np.linalg.norm(sample.tip("LeftHand") - sample.tip("RightHand"), axis=-1)[clap]
    assert gaps.min() < 6
    assert gaps.max() > 30
    closed = np.flatnonzero(clap)[gaps < 8]
    for side in SIDES:
        place = sample.towards("Spine", sample.tip(f"{side}Hand"))[closed]
        assert place[:, 2].min() > 35
        assert (np.abs(place[:, 1] - 27) < 10).all()


def test_hands_rest_on_the_hips_with_elbows_out_and_back():
    sample = seen()
    frames = inner(sample.dance, arms="hips")
    for side, out in SIDES.items():
        wrist, tip, elbow = (
            sample.towards("Hips", points)[frames]
            for points in (
                sample.at(f"{side}Hand"),
                sample.tip(f"{side}Hand"),
                sample.at(f"{side}ForeArm"),
            )
        )
        np.testing.assert_allclose(wrist, np.broadcast_to([out * 19.5, 8, 1], wrist.shape), atol=2)
        assert np.linalg.norm(tip, axis=-1).max() < 26
        assert ((elbow - wrist)[:, 0] * out).min() > 8
        assert (elbow - wrist)[:, 2].max() < -2


@pytest.mark.parametrize("pattern", ["swing", "punch", "robot"])
def test_arms_take_turns(pattern):
    sample = seen()
    frames = inner(sample.dance, arms=pattern)
    left, right = (sample.towards("Spine", sample.at(f"{side}Hand"))[frames] for side in SIDES)
    axis = 1 if pattern == "robot" else 2
    assert np.corrcoef(left[:, axis], right[:, axis])[0, 1] < -0.8


def test_arms_swing_against_the_legs():
    sample = seen()
    frames = inner(sample.dance, legs="walk", arms="swing")
    for side, other in (("Left", "Right"), ("Right", "Left")):
        hand = sample.towards("Hips", sample.at(f"{side}Hand"))[frames, 2]
        same, opposite = (
            sample.towards("Hips", sample.at(f"{own}Foot"))[frames, 2] for own in (side, other)
        )
        assert np.corrcoef(hand, opposite)[0, 1] > 0.7
        assert np.corrcoef(hand, same)[0, 1] < -0.7


def yaw(turns):
    ahead = rotations.rotate(turns, np.array([0.0, 0.0, 1.0]))
    return np.degrees(np.arctan2(ahead[:, 0], ahead[:, 2]))


@pytest.mark.parametrize("style", ["walk", "march", "bounce", "lunge"])
def test_shoulders_turn_against_the_hips_under_a_steady_head(style):
    sample = seen()
    frames = inner(sample.dance, legs=style)
    gaze = yaw(sample.turn("Head"))
    hips, chest = (yaw(sample.turn(name))[frames] - gaze[frames] for name in ("Hips", "Spine"))
    assert np.corrcoef(hips, chest)[0, 1] < -0.7
    spins = {
        name: np.abs(np.diff(yaw(sample.turn(name))))[frames[1:]].mean()
        for name in ("Hips", "Spine", "Head")
    }
    assert spins["Head"] < 0.5 * min(spins["Hips"], spins["Spine"])


@pytest.mark.parametrize("style", LEG_STYLES)
def test_the_weight_shifts_over_the_standing_foot(style):
    sample = seen()
    frames = inner(sample.dance, legs=style)
    phase = sample.dance.phase
    middle = 0.5 * (sample.at("LeftFoot") + sample.at("RightFoot"))
    aside = -sample.towards("Hips", middle)[:, 0]
    right_stands = frames & (np.abs(phase - 0.25) < 0.15)
    left_stands = frames & (np.abs(phase - 0.75) < 0.15)
    assert aside[left_stands].mean() > aside[right_stands].mean() + 1.5


def knee_curve(sample, legs, arms):
    """Average bends of both knees over the phase, away from the ends of the block."""
    frames = inner(sample.dance, legs, arms, margin=25)
    bins = (sample.dance.phase[frames] * 12).astype(int).clip(0, 11)
    knees = [bend(sample.local(f"{side}Leg"), 0)[frames] for side in SIDES]
    return np.array([[knee[bins == own].mean() for own in range(12)] for knee in knees])


def test_the_same_legs_are_seen_under_every_arm_pattern():
    sample = seen()
    curves = {
        legs: np.array([knee_curve(sample, legs, arms) for arms in ARM_PATTERNS])
        for legs in LEG_STYLES
    }
    within = {legs: own.std(axis=0).mean() for legs, own in curves.items()}
    between = np.array([own.mean(axis=0) for own in curves.values()]).std(axis=0).mean()
    assert max(within.values()) < 0.5 * between


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
def test_styles_go_where_they_should(style, forward, aside):
    sample = seen()
    frames = inner(sample.dance, legs=style)[1:]
    ways = np.diff(sample.at("Hips"), axis=0) * sample.motion.rate
    own = rotations.rotate(rotations.inverse(sample.turn("Head")[1:]), ways)[frames]
    assert abs(own[:, 2].mean() - forward) < 12
    assert (np.abs(own[:, 0]).mean() > 26) == aside


@pytest.mark.parametrize("style", ["turn", "sidestep"])
def test_the_dance_goes_both_ways(style):
    sample = seen()
    frames = inner(sample.dance, legs=style)[1:]
    gaze = sample.turn("Head")
    ways = rotations.rotate(rotations.inverse(gaze[1:]), np.diff(sample.at("Hips"), axis=0))[:, 0]
    left = (np.diff(yaw(gaze)) if style == "turn" else ways)[frames] > 0
    assert 0.25 < left.mean() < 0.75


def test_the_heading_keeps_clear_of_gimbal_lock():
    for seed in range(4):
        headings = yaw(seen(seed, 2).turn("Hips"))
        assert np.abs(headings).max() < 80
        assert np.ptp(headings) > 60
