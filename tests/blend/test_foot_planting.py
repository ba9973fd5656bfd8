"""Foot planting: contacts, planted positions, root shift, and legs of constant length."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import Motion, Skeleton, SkeletonMismatchError, foot_skate, plant_feet, read_bvh
from mograft._util.runs import dilate
from mograft.blend.foot_planting import limit_floor_speed
from mograft.blend.two_bone_ik import bend_limb
from mograft.body.contacts import Ground, detect_contacts, foot_heights
from mograft.body.mass import mass_model
from mograft.body.support_polygon import support_polygons
from mograft.dancer import dance
from mograft.motion import rotations
from tests.hierarchies import distinct_recordings
from tests.strategies import SEEDS, few_examples, transform_motion


@pytest.fixture(scope="module")
def sample():
    return dance(seed=1, strides=1)


def sliding(motion, drift):
    """The motion with a drift of the root over the floor: all feet slide."""
    places = motion.positions.copy()
    places[:, 0] += np.outer(np.arange(motion.n_frames) * motion.frame_time, drift)
    return replace(motion, positions=places, channel_values=None)


def limb(rng, bend):
    """A limb of two bones in a random direction, bent by an angle, and its bend axis."""
    turn = rotations.exp(rng.normal(size=3))
    upper, lower = rng.uniform(0.5, 2.0, 2)
    points = np.zeros((3, 3))
    points[1] = [0.0, -upper, 0.0]
    points[2] = points[1] + lower * np.array([0.0, -np.cos(bend), -np.sin(bend)])
    axis = rotations.rotate(turn, np.array([-1.0, 0.0, 0.0]))
    return rotations.rotate(turn, points) + rng.normal(size=3), axis, upper, lower


def bent(points, wanted, axis):
    start, middle, end = (point[None] for point in points)
    at_start, at_middle = bend_limb(start, middle, end, wanted[None], axis[None])
    knee = start + rotations.rotate(at_start, middle - start)
    foot = rotations.rotate(at_middle, end - middle) + middle
    return knee[0], (start + rotations.rotate(at_start, foot - start))[0]


@given(SEEDS, st.floats(0.0, 3.0), st.floats(0.02, 3.0))
def test_bend_limb_meets_target_or_straightens_towards_it(seed, bend, share):
    rng = np.random.default_rng(seed)
    points, axis, upper, lower = limb(rng, bend)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    distance = abs(upper - lower) + share * (upper + lower - abs(upper - lower))
    # Also with an axis that is slightly off the normal of the limb's plane.
    for off in (0.0, 0.05):
        tilted = axis + off * rng.normal(size=3)
        knee, foot = bent(points, points[0] + distance * way, tilted / np.linalg.norm(tilted))
        if off == 0.0 or 0.1 < share < 0.9:
            wanted = points[0] + way * min(distance, upper + lower)
            np.testing.assert_allclose(foot, wanted, atol=1e-6)
        assert np.linalg.norm(knee - points[0]) == pytest.approx(upper)
        assert np.linalg.norm(foot - knee) == pytest.approx(lower)


def test_bend_limb_degenerate_targets_give_finite_positions():
    straight = np.array([[0, 0, 0], [0, -1, 0], [0, -2, 0]], float)
    for wanted in ([0, 0, 0], [0, 2, 0], [0, -5, 0], [0, -2, 0]):
        assert np.isfinite(bent(straight, np.array(wanted, float), np.eye(3)[0])).all()


def test_detect_contacts_dancer_matches_stance(sample):
    found = detect_contacts(sample.motion).any(axis=2)
    assert (found[sample.stance]).mean() > 0.99
    assert len(detect_contacts(sample.motion[:3])) == 3


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0])
def test_detect_contacts_is_independent_of_unit(sample, scale):
    motion = sample.motion
    other = transform_motion(motion, scale)
    np.testing.assert_array_equal(detect_contacts(other), detect_contacts(motion))
    assert foot_skate(other) == pytest.approx(foot_skate(motion))


@few_examples(20)
@given(SEEDS, st.floats(0.0, 20.0))
def test_plant_feet_sliding_motion_fixes_feet_and_keeps_bones_and_root_speed(sample, seed, size):
    """For any distance that legs lack; without a shift every position stays."""
    rng = np.random.default_rng(seed)
    start = int(rng.integers(0, sample.motion.n_frames - 200))
    stands = detect_contacts(sample.motion)[start : start + 200]
    motion = sliding(sample.motion[start : start + 200], rng.uniform(-size, size, 3))
    still, report = plant_feet(motion, stands)
    height = mass_model(motion.skeleton).height
    points = Ground.of(motion).points(still)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1) / height
    if not report.unreached_frames:
        assert steps[stands[1:] & stands[:-1]].max(initial=0) < 1e-3
    lengths = [
        np.linalg.norm(np.diff(m.world_positions()[:, [1, 2, 3]], axis=1), axis=-1)
        for m in (motion, still)
    ]
    np.testing.assert_allclose(lengths[0], lengths[1], rtol=1e-9)
    others = np.setdiff1d(np.arange(motion.n_joints), [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(still.rotations[:, others], motion.rotations[:, others])
    np.testing.assert_array_equal(still.positions[:, 1:], motion.positions[:, 1:])
    speeds = [
        np.linalg.norm(np.diff(m.positions[:, 0, [0, 2]], axis=0), axis=1) for m in (motion, still)
    ]
    assert speeds[1].max() <= speeds[0].max() * (1 + 1e-9)
    if report.moved_root == 0:
        np.testing.assert_array_equal(still.positions, motion.positions)


@pytest.mark.parametrize("rise", [-0.03, 0.06])
def test_plant_feet_of_raised_or_sunk_motion_stand_near_the_floor(sample, rise):
    recorded = sample.motion[:300]
    ground, stands = Ground.of(recorded), detect_contacts(recorded)
    positions = recorded.positions.copy()
    positions[:, 0] += rise * ground.height * ground.up
    moved = replace(recorded, positions=positions, channel_values=None)
    still, _ = plant_feet(moved, stands, floor_reference=recorded)
    heights = ground.above(ground.points(still))[stands] / ground.height
    assert heights.min() >= -0.01 - 1e-3
    assert heights.max() <= 0.03 + 1e-3


def depths(motion, ground):
    """Depths of heels and toes below their floors, in skeleton heights."""
    return -ground.above(ground.points(motion)) / ground.height


def assert_no_deeper(still, motion, ground):
    """Each heel and toe is at most 0.001 heights deeper than in the same frame before."""
    allowed = np.maximum(depths(motion, ground), 0.0) + 0.001
    np.testing.assert_array_less(depths(still, ground), allowed + 1e-6)


@st.composite
def walkers(draw):
    """A dance of a figure with random legs and feet; its root drifts and sinks at random."""
    rng = np.random.default_rng(draw(SEEDS))
    motion = dance(seed=int(rng.integers(5)), strides=1).motion
    start = int(rng.integers(0, motion.n_frames - 120))
    motion = motion[start : start + 120]
    skeleton, scale = motion.skeleton, 10.0 ** rng.uniform(-2, 2)
    offsets = skeleton.offsets * scale
    shins_and_feet = [
        skeleton.index(f"{side}{part}") for part in ("Leg", "Foot") for side in ("Left", "Right")
    ]
    offsets[shins_and_feet] *= np.repeat(rng.uniform(0.8, 1.2, 2), 2)[:, None]
    pitch = rotations.exp(np.array([draw(st.floats(-1.0, 1.5)), 0.0, 0.0]))
    size = scale * rng.uniform(0.3, 1.5)
    sites = [
        replace(
            site,
            offset=rotations.rotate(pitch, np.asarray(site.offset)) * size
            if skeleton.names[site.parent].endswith("Foot")
            else np.asarray(site.offset) * scale,
        )
        for site in skeleton.end_sites
    ]
    positions = np.where(
        np.arange(motion.n_joints)[:, None] == 0, motion.positions * scale, offsets
    )
    seconds = np.arange(120) * motion.frame_time
    drift = rng.uniform(-20, 20, 3) * draw(st.sampled_from([0.0, 1.0]))
    sway = rng.uniform(0, 4) * np.sin(rng.uniform(1, 20, 3) * seconds[:, None])
    positions[:, 0] += scale * (np.outer(seconds, drift * [1.0, 0.1, 1.0]) + sway)
    figure = replace(skeleton, offsets=offsets, end_sites=tuple(sites))
    return replace(motion, skeleton=figure, positions=positions, channel_values=None)


@st.composite
def contact_arrays(draw, n_frames=120):
    """Random intervals of contact of two legs."""
    rng = np.random.default_rng(draw(SEEDS))
    contacts = np.zeros((n_frames, 2, 2), bool)
    for leg, point in np.ndindex(2, 2):
        for first, last in np.cumsum(rng.integers(1, 30, 16)).reshape(8, 2):
            contacts[first:last, leg, point] = True
    return contacts


@few_examples(45)
@given(
    walkers(),
    st.none() | contact_arrays(),
    st.sampled_from([(True, True), (True, False), (False, True)]),
    st.booleans(),
    st.booleans(),
    st.floats(-0.1, 0.1),
)
def test_plant_feet_any_walk_pushes_no_foot_below_the_depths_of_base_and_reference(
    recorded, contacts, movable, move_root, is_lifted, rise
):
    """The motion sinks below its recording, or is above it; unmovable joints are kept."""
    ground = Ground.of(recorded)
    positions = recorded.positions.copy()
    positions[:, 0] += np.outer(np.sin(np.arange(120) / 10.0), rise * ground.height * ground.up)
    motion = replace(recorded, positions=positions)
    heights = foot_heights(motion) if is_lifted else None
    legs = {"movable_legs": movable, "move_root": move_root, "min_heights": heights}
    for reference in (motion, recorded):
        still, _ = plant_feet(motion, contacts, floor_reference=reference, **legs)
        ground = Ground.of(reference)
        assert_no_deeper(still, motion, ground)
        kept = np.repeat(np.logical_not(movable), 3)
        np.testing.assert_array_equal(
            still.rotations[:, 1:7][:, kept], motion.rotations[:, 1:7][:, kept]
        )
        if not move_root:
            np.testing.assert_array_equal(still.positions, motion.positions)
    if contacts is not None and not is_lifted:
        excess = depths(still, ground) - np.maximum(depths(recorded, ground).max(axis=0), 0.0)
        assert excess[:, movable].max() <= 0.001 + 1e-6


@given(SEEDS, st.integers(2, 40), st.floats(0.0, 3.0))
def test_limit_floor_speed_slow_shift_is_unchanged(seed, n, size):
    rng = np.random.default_rng(seed)
    path, shift = np.cumsum(rng.normal(size=(n, 3)), axis=0), size * rng.normal(size=(n, 3))
    up = np.eye(3)[int(rng.integers(3))]

    def speeds(places):
        steps = np.diff(places, axis=0)
        return np.linalg.norm(steps - np.outer(steps @ up, up), axis=1)

    new = limit_floor_speed(shift, path, up)
    assert speeds(path + new).max() <= speeds(path).max() * (1 + 1e-9)
    np.testing.assert_allclose(new @ up, shift @ up, atol=1e-12)
    if speeds(path + shift).max() <= speeds(path).max():
        np.testing.assert_array_equal(new, shift)


def test_plant_feet_without_contacts_returns_same_motion(sample):
    none = np.zeros((sample.motion.n_frames, 2, 2), bool)
    assert plant_feet(sample.motion, none)[0] is sample.motion
    bare = sample.motion[:2]
    assert plant_feet(replace(bare, positions=bare.positions + 0.0))[1].unreached == 0.0


def test_plant_feet_invalid_arguments_raise_value_error(sample):
    nan = np.full((sample.motion.n_frames, 2, 2), np.nan)
    for name, value, message in (
        ("foot_contacts", np.zeros((3, 2), bool), r"have shape \(\d+, 2, 2\), got \(3, 2\)"),
        ("movable_legs", [True], r"have shape \(2,\), got \(1,\)"),
        ("movable_legs", True, r"have shape \(2,\), got \(\)"),
        ("min_heights", np.zeros((3, 2)), r"have shape \(\d+, 2, 2\), got \(3, 2\)"),
        ("min_heights", nan, "be numbers, got NaN"),
    ):
        with pytest.raises(ValueError, match=f"`{name}` must {message}"):
            plant_feet(sample.motion, **{name: value})
    other = Motion(Skeleton(["a"], [-1], [[0, 0, 0]]), 1, [[[0, 0, 0, 1.0]]], [[[0, 0, 0.0]]])
    for call in (plant_feet, support_polygons):
        with pytest.raises(SkeletonMismatchError, match="`floor_reference` lacks"):
            call(sample.motion, floor_reference=other)
        with pytest.raises(TypeError, match="`floor_reference` must be a Motion, got str"):
            call(sample.motion, floor_reference="a.bvh")


def test_plant_feet_fast_frames_of_a_contact_are_not_planted(sample):
    """As at a seam between donors whose feet stand far apart: the root would be pulled away."""
    motion = sample.motion[:240]
    everywhere = np.ones((240, 2, 2), bool)
    still, report = plant_feet(motion, everywhere)
    points, height = Ground.of(motion).points(motion), mass_model(motion.skeleton).height
    moved = np.linalg.norm(Ground.of(motion).points(still) - points, axis=-1) / height
    speeds = np.linalg.norm(np.gradient(points, axis=0), axis=-1) * motion.rate / height
    assert report.plants > 4
    assert moved[speeds > 1.5].max() < 0.15
    assert report.moved_root < 0.1


@settings(max_examples=12, deadline=None)
@given(SEEDS, st.floats(0.01, 0.04))
def test_plant_feet_min_heights_lift_swinging_feet(sample, seed, drop):
    """A figure that sinks into the floor: its feet keep their heights, up to the clearance."""
    start = int(np.random.default_rng(seed).integers(0, sample.motion.n_frames - 200))
    motion = sample.motion[start : start + 200]
    stands, high = (
        own(sample.motion)[start : start + 200] for own in (detect_contacts, foot_heights)
    )
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
    # Far from plants, where neither a plant nor its fade changes a foot.
    free = np.stack([~dilate(own, 4) for own in stands.any(axis=2).T], axis=1)
    lacks = [np.maximum(np.minimum(high, 0.05) - own, 0.0)[free] for own in low]
    # The sum is in skeleton heights times frames. 1e-4 is 0.2 mm of a person in one frame: so
    # small a deficit is no drag, and the smoothing of the lift determines its ratio.
    assert lacks[1].sum() <= 0.3 * lacks[0].sum() + 1e-4
    assert (low[1] >= low[0] - 1e-3).all()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", distinct_recordings(), ids=lambda path: path.stem[:30])
def test_plant_feet_every_recorded_skeleton_fixes_feet(path):
    motion = read_bvh(path, strict=False)[:240]
    still, report = plant_feet(motion)
    assert report.skate_after <= report.skate_before + 0.01
    assert_no_deeper(still, motion, Ground.of(motion))
    stands, height = detect_contacts(motion), mass_model(motion.skeleton).height
    held = stands[1:] & stands[:-1]
    points = Ground.of(motion).points(still)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1) / height
    if report.unreached_frames == 0:
        assert steps[held].max(initial=0) < 1e-3
    assert np.isfinite(still.rotations).all()
