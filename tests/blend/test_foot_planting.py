"""Laws of feet: where they stand, that they stand still, and that legs stay as long as they are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import (
    Config,
    JointGroups,
    KeepOriginal,
    Library,
    foot_skate,
    graft,
    plant_feet,
    read_bvh,
)
from mograft.blend.foot_planting import _no_faster, two_bones
from mograft.body.contacts import Ground, detect_contacts, find_legs, foot_heights
from mograft.body.mass import mass_model
from mograft.dancer import dance
from mograft.motion import rotations
from tests.hierarchies import DANCES, DATA, distinct_recordings, recording
from tests.strategies import SEEDS


@pytest.fixture(scope="module")
def sample():
    return dance(seed=1, strides=1)


def sliding(motion, drift):
    """The motion with its root drifting over the floor, so that all feet slide."""
    places = motion.positions.copy()
    places[:, 0] += np.outer(np.arange(motion.n_frames) * motion.frame_time, drift)
    return replace(motion, positions=places, channel_values=None)


def limb(rng, bend):
    """A limb of two bones in any direction, bent by an angle, and the axis that it bends about."""
    turn = rotations.exp(rng.normal(size=3))
    upper, lower = rng.uniform(0.5, 2.0, 2)
    points = np.zeros((3, 3))
    points[1] = [0.0, -upper, 0.0]
    points[2] = points[1] + lower * np.array([0.0, -np.cos(bend), -np.sin(bend)])
    axis = rotations.rotate(turn, np.array([-1.0, 0.0, 0.0]))
    return rotations.rotate(turn, points) + rng.normal(size=3), axis, upper, lower


def bent(points, wanted, axis):
    start, middle, end = (point[None] for point in points)
    at_start, at_middle = two_bones(start, middle, end, wanted[None], axis[None])
    knee = start + rotations.rotate(at_start, middle - start)
    foot = rotations.rotate(at_middle, end - middle) + middle
    return knee[0], (start + rotations.rotate(at_start, foot - start))[0], at_start, at_middle


@given(SEEDS, st.floats(0.0, 3.0), st.floats(0.02, 0.98))
def test_a_limb_reaches_all_that_is_near_enough(seed, bend, share):
    rng = np.random.default_rng(seed)
    points, axis, upper, lower = limb(rng, bend)
    way = rng.normal(size=3)
    distance = abs(upper - lower) + share * (upper + lower - abs(upper - lower))
    wanted = points[0] + way / np.linalg.norm(way) * distance
    # An axis that is off the limb's plane a little must do as well.
    for off in (0.0, 0.05):
        tilted = axis + off * rng.normal(size=3)
        knee, foot, *_ = bent(points, wanted, tilted / np.linalg.norm(tilted))
        if off == 0.0 or 0.1 < share < 0.9:
            np.testing.assert_allclose(foot, wanted, atol=1e-6)
        assert np.linalg.norm(knee - points[0]) == pytest.approx(upper)
        assert np.linalg.norm(foot - knee) == pytest.approx(lower)


@given(SEEDS, st.floats(0.1, 3.0), st.floats(1.0, 3.0))
def test_out_of_reach_it_points_there(seed, bend, times):
    rng = np.random.default_rng(seed)
    points, axis, upper, lower = limb(rng, bend)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    foot = bent(points, points[0] + way * (upper + lower) * times, axis)[1]
    np.testing.assert_allclose(foot, points[0] + way * (upper + lower), atol=1e-6)


@given(SEEDS, st.floats(0.01, 3.0))
def test_a_limb_that_is_there_is_not_turned(seed, bend):
    points, axis, *_ = limb(np.random.default_rng(seed), bend)
    *_, at_start, at_middle = bent(points, points[2], axis)
    for turn in (at_start, at_middle):
        assert rotations.angle(turn, rotations.IDENTITY).max() < 1e-6


def test_nothing_is_not_a_number():
    straight = np.array([[0, 0, 0], [0, -1, 0], [0, -2, 0]], float)
    for wanted in ([0, 0, 0], [0, 2, 0], [0, -5, 0], [0, -2, 0]):
        assert np.isfinite(
            np.concatenate(bent(straight, np.array(wanted, float), np.eye(3)[0])[2:])
        ).all()


def test_contacts_are_where_the_dancer_stands(sample):
    found = detect_contacts(sample.motion).any(axis=2)
    assert (found[sample.stance]).mean() > 0.99
    assert len(detect_contacts(sample.motion[:3])) == 3


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0])
def test_contacts_know_no_unit(sample, scale):
    motion = sample.motion
    other = replace(
        motion,
        skeleton=replace(
            motion.skeleton.with_offsets(motion.skeleton.offsets * scale),
            end_sites=tuple(
                replace(site, offset=site.offset * scale) for site in motion.skeleton.end_sites
            ),
        ),
        positions=motion.positions * scale,
        channel_values=None,
    )
    np.testing.assert_array_equal(detect_contacts(other), detect_contacts(motion))
    assert foot_skate(other) == pytest.approx(foot_skate(motion))


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_planted_feet_stand_still_and_bones_keep_their_lengths(sample, seed):
    rng = np.random.default_rng(seed)
    start = int(rng.integers(0, sample.motion.n_frames - 200))
    stands = detect_contacts(sample.motion)[start : start + 200]
    motion = sliding(sample.motion[start : start + 200], [*rng.uniform(-8, 8, 1), 0.0, 5.0])
    still, _ = plant_feet(motion, stands)
    height = mass_model(motion.skeleton).height
    points = Ground.of(motion).points(still)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1) / height
    held = stands[1:] & stands[:-1]
    assert steps[held].max(initial=0) < 1e-3
    lengths = [
        np.linalg.norm(np.diff(m.world_positions()[:, [1, 2, 3]], axis=1), axis=-1)
        for m in (motion, still)
    ]
    np.testing.assert_allclose(lengths[0], lengths[1], rtol=1e-9)
    others = np.setdiff1d(np.arange(motion.n_joints), [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(still.rotations[:, others], motion.rotations[:, others])
    np.testing.assert_array_equal(still.positions[:, 1:], motion.positions[:, 1:])


def test_the_root_is_not_shaken(sample):
    motion = sliding(sample.motion, [12.0, 0.0, 5.0])
    still, report = plant_feet(motion, detect_contacts(sample.motion))
    assert report.moved_root > 0
    bends = [np.abs(np.diff(m.positions[:, 0], 2, axis=0)).max() for m in (motion, still)]
    assert bends[1] < 2 * bends[0]


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_the_root_goes_no_faster_than_at_its_fastest(sample, seed):
    """However far legs are too short: the shift takes its time, and is none where nothing is."""
    rng = np.random.default_rng(seed)
    start = int(rng.integers(0, sample.motion.n_frames - 200))
    motion = sliding(sample.motion[start : start + 200], rng.uniform(-20, 20, 3))
    stands = detect_contacts(sample.motion)[start : start + 200]
    still, report = plant_feet(motion, stands)
    speeds = [
        np.linalg.norm(np.diff(m.positions[:, 0, [0, 2]], axis=0), axis=1) for m in (motion, still)
    ]
    assert speeds[1].max() <= speeds[0].max() * (1 + 1e-9)
    if report.moved_root == 0:
        np.testing.assert_array_equal(still.positions, motion.positions)


@given(SEEDS, st.integers(2, 40), st.floats(0.0, 3.0))
def test_a_shift_that_makes_nothing_too_fast_is_kept(seed, n, size):
    rng = np.random.default_rng(seed)
    path, shift = np.cumsum(rng.normal(size=(n, 3)), axis=0), size * rng.normal(size=(n, 3))
    up = np.eye(3)[int(rng.integers(3))]

    def speeds(places):
        steps = np.diff(places, axis=0)
        return np.linalg.norm(steps - np.outer(steps @ up, up), axis=1)

    new = _no_faster(shift, path, up)
    assert speeds(path + new).max() <= speeds(path).max() * (1 + 1e-9)
    np.testing.assert_allclose(new @ up, shift @ up, atol=1e-12)
    if speeds(path + shift).max() <= speeds(path).max():
        np.testing.assert_array_equal(new, shift)


@given(st.integers(3, 30), st.integers(3, 30), st.floats(0.01, 1.0))
def test_a_shift_gives_way_only_by_what_is_too_much(before, after, more):
    """One step is at its fastest and would be longer; there is room beside it."""
    steps = np.concatenate([np.ones(before), [3.0], np.ones(after)])
    path = np.zeros((len(steps) + 1, 3))
    path[1:, 0] = np.cumsum(steps)
    shift = np.zeros_like(path)
    shift[before + 1 :, 0] = more
    new = _no_faster(shift, path, np.array([0.0, 1.0, 0.0]))
    assert np.diff((path + new)[:, 0]).max() <= 3.0 * (1 + 1e-12)
    # Half on either side, and at most a little more, so that there is an end to it.
    assert np.abs(new - shift).max() <= 0.5 * more + 1e-3


def test_the_root_stays_where_it_may_not_move(sample):
    motion = sliding(sample.motion, [12.0, 0.0, 5.0])
    still, report = plant_feet(motion, detect_contacts(sample.motion), move_root=False)
    np.testing.assert_array_equal(still.positions, motion.positions)
    assert report.unreached_frames > 0


def test_only_legs_that_may_be_bent_are(sample):
    motion = sliding(sample.motion, [12.0, 0.0, 5.0])
    still, _ = plant_feet(motion, movable_legs=[True, False])
    np.testing.assert_array_equal(still.rotations[:, 4:], motion.rotations[:, 4:])
    assert (still.rotations[:, 1:4] != motion.rotations[:, 1:4]).any()


def test_what_needs_nothing_is_left_to_the_bit(sample):
    none = np.zeros((sample.motion.n_frames, 2, 2), bool)
    assert plant_feet(sample.motion, none)[0] is sample.motion
    bare = sample.motion[:2]
    assert plant_feet(replace(bare, positions=bare.positions + 0.0))[1].unreached == 0.0


def test_bad_arguments_are_refused_by_name(sample):
    with pytest.raises(
        ValueError, match=r"foot_contacts must have shape \(\d+, 2, 2\), got \(3, 2\)"
    ):
        plant_feet(sample.motion, np.zeros((3, 2), bool))
    with pytest.raises(ValueError, match="movable_legs must tell of 2 legs, got 1"):
        plant_feet(sample.motion, movable_legs=[True])
    with pytest.raises(
        ValueError, match=r"min_heights must have shape \(\d+, 2, 2\), got \(3, 2\)"
    ):
        plant_feet(sample.motion, min_heights=np.zeros((3, 2)))
    with pytest.raises(ValueError, match="`feet` must be one of"):
        Config(feet="sometimes")


def test_a_foot_that_is_said_to_stand_and_walks_is_not_held(sample):
    """As at a seam between donors whose feet stand far apart: the root would be torn away."""
    motion = sample.motion[:240]
    everywhere = np.ones((240, 2, 2), bool)
    still, report = plant_feet(motion, everywhere)
    points, height = Ground.of(motion).points(motion), mass_model(motion.skeleton).height
    moved = np.linalg.norm(Ground.of(motion).points(still) - points, axis=-1) / height
    speeds = np.linalg.norm(np.gradient(points, axis=0), axis=-1) * motion.rate / height
    assert report.plants > 4
    assert moved[speeds > 1.5].max() < 0.15
    assert report.moved_root < 0.1


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.floats(0.01, 0.04))
def test_feet_that_swing_are_lifted_where_they_would_drag(sample, seed, drop):
    """A figure that sinks into the floor: its feet swing as high as before, or clear of it."""
    start = int(np.random.default_rng(seed).integers(0, sample.motion.n_frames - 200))
    motion = sample.motion[start : start + 200]
    stands, high = detect_contacts(sample.motion), foot_heights(sample.motion)
    stands, high = stands[start : start + 200], high[start : start + 200]
    height = mass_model(motion.skeleton).height
    places = motion.positions.copy()
    places[:, 0, 1] -= drop * height * np.sin(np.linspace(0, np.pi, 200)) ** 2
    sunk = replace(motion, positions=places, channel_values=None)
    loose, tight = (
        plant_feet(sunk, stands, floor_reference=sample.motion, min_heights=own)[0]
        for own in (None, high)
    )
    ground = Ground.of(sample.motion)
    low = [ground.above(ground.points(one)) / height for one in (loose, tight)]
    # Far from plants, where nothing else pulls at a foot, and with a leg to spare.
    free = ~stands.any(axis=2)
    for shift in range(1, 5):
        free[shift:] &= ~stands.any(axis=2)[:-shift]
        free[:-shift] &= ~stands.any(axis=2)[shift:]
    lacks = [np.maximum(np.minimum(high, 0.05) - own, 0.0)[free] for own in low]
    # Below 1e-4 heights times frames in total (0.2 mm of a person, for one frame) nothing drags:
    # at that size the smoothing of the lift decides the ratio.
    assert lacks[1].sum() <= 0.3 * lacks[0].sum() + 1e-4
    held = stands[1:] & stands[:-1]
    steps = np.linalg.norm(np.diff(ground.points(tight), axis=0), axis=-1) / height
    assert steps[held].max(initial=0) < 1e-3
    assert (low[1] >= low[0] - 1e-3).all()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", distinct_recordings(), ids=lambda path: path.stem[:30])
def test_feet_of_every_skeleton_stand(path):
    motion = read_bvh(path, strict=False)[:240]
    still, report = plant_feet(motion)
    assert report.skate_after <= report.skate_before + 0.01
    stands, height = detect_contacts(motion), mass_model(motion.skeleton).height
    held = stands[1:] & stands[:-1]
    points = Ground.of(motion).points(still)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1) / height
    if report.unreached_frames == 0:
        assert steps[held].max(initial=0) < 1e-3
    assert np.isfinite(still.rotations).all()


def test_where_nothing_is_exchanged_every_bit_stays(sample):
    """Feet too, that other grafts on an upper body plant."""
    motion = sample.motion
    preset = JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    members = {group: [int(j) for j in joints] for group, joints in preset.items()}
    library = Library.build(motion, JointGroups(members, base="upper"))
    assert graft(library, seed=1).feet is not None
    new = graft(library, seed=1, constraints=[KeepOriginal(frames=(0, motion.n_frames - 1))])
    assert new.feet is None
    np.testing.assert_array_equal(new.motion.rotations, motion.rotations)
    np.testing.assert_array_equal(new.motion.positions, motion.positions)
    np.testing.assert_array_equal(new.motion.channel_numbers(), motion.channel_numbers())


def test_a_quadruped_has_four_legs():
    path = DATA / "synthetic_quadruped" / "quadruped_trot.bvh"
    if not path.exists():
        pytest.skip("the quadruped is not here")
    motion = read_bvh(path)
    assert len(find_legs(motion.skeleton)) == 4
    _, report = plant_feet(motion)
    assert report.skate_after <= report.skate_before
    assert report.unreached_frames == 0


@pytest.mark.filterwarnings("ignore")  # of faults in the recordings
@pytest.mark.parametrize("name", DANCES)
def test_feet_of_real_grafts_on_upper_bodies_stand(name):
    motion = recording(name)
    preset = JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    members = {group: [int(j) for j in joints] for group, joints in preset.items()}
    loose, tight = (
        graft(Library.build(motion, JointGroups(members, base="upper"), Config(feet=feet)))
        for feet in ("never", "auto")
    )
    assert tight.feet.unreached_frames == 0
    assert tight.feet.skate_after < tight.feet.skate_before
    assert tight.feet.skate_after <= foot_skate(motion)
    assert foot_skate(tight.motion) <= foot_skate(motion)
    root = Library.build(motion).root
    speeds = [
        np.linalg.norm(np.diff(m.world_positions()[:, root], axis=0), axis=1).max()
        for m in (loose.motion, tight.motion)
    ]
    assert speeds[1] < 1.2 * speeds[0]
