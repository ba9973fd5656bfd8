"""Balance: what the body weighs, what it stands on, and verdicts that know no place."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.spatial import ConvexHull

from mograft import InsufficientDataError, Motion, Segments, Skeleton, read_bvh, segment
from mograft.body.mass import center_of_mass, mass_model
from mograft.dancer import dance
from mograft.evaluation.balance import (
    RULES,
    Balance,
    balance_row,
    convex_hull,
    dynamic_balance,
    signed_distance,
    static_balance,
    support,
)
from mograft.motion import rotations
from tests.strategies import SEEDS
from tests.synthesis.test_real_motion import at

DANCE = dance(seed=3, strides=1).motion[:400]


def moved(motion, scale=1.0, turn=0.0, place=(0.0, 0.0, 0.0)):
    """The motion in another unit, with another heading, elsewhere on the floor."""
    skeleton = motion.skeleton
    quats, places = motion.rotations.copy(), motion.positions * scale
    yaw = rotations.exp(np.array([0.0, turn, 0.0]))
    quats[:, 0] = rotations.multiply(yaw, quats[:, 0])
    places[:, 0] = rotations.rotate(yaw, places[:, 0]) + np.asarray(place) * scale
    sites = [replace(site, offset=np.asarray(site.offset) * scale) for site in skeleton.end_sites]
    other = replace(skeleton, offsets=skeleton.offsets * scale, end_sites=tuple(sites))
    return replace(motion, skeleton=other, rotations=quats, positions=places, channel_values=None)


def planes(min_size=1, max_size=12):
    number = st.floats(-5, 5, width=32) | st.integers(-3, 3).map(float)
    return npst.arrays(
        np.float64, st.tuples(st.integers(min_size, max_size), st.just(2)), elements=number
    )


@given(planes(3))
def test_the_hull_is_that_of_scipy(points):
    ours = convex_hull(points)
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
    if spread < 1e-6:
        return  # all on a line: SciPy's Qhull wants an area
    theirs = ConvexHull(points)
    area = 0.5 * np.sum(ours[:, 0] * np.roll(ours[:, 1], -1) - np.roll(ours[:, 0], -1) * ours[:, 1])
    assert area == pytest.approx(theirs.volume, abs=1e-9)  # and so it is counterclockwise
    assert {tuple(p) for p in ours.tolist()} <= {tuple(p) for p in points.tolist()}
    outside = theirs.equations[:, :2] @ ours.T + theirs.equations[:, 2:]
    assert outside.max() < 1e-9
    for vertex in points[theirs.vertices]:
        assert np.linalg.norm(ours - vertex, axis=1).min() < 1e-6


@given(planes(1), planes(1, 1))
def test_the_distance_to_the_hull_is_that_to_its_nearest_edge(points, probe):
    hull = convex_hull(points)
    n = len(hull)
    found = signed_distance(hull[None], np.array([n]), probe)[0]
    along = np.linspace(0, 1, 400)[:, None]
    edges = [a + along * (b - a) for a, b in zip(hull, np.roll(hull, -1, axis=0), strict=True)]
    brute = np.linalg.norm(np.concatenate(edges) - probe, axis=1).min()
    assert abs(found) <= brute + 1e-9
    assert abs(found) >= brute - 0.03 - 1e-9  # half a step between samples
    if n > 2:
        crosses = [
            (b - a)[0] * (probe[0] - a)[1] - (b - a)[1] * (probe[0] - a)[0]
            for a, b in zip(hull, np.roll(hull, -1, axis=0), strict=True)
        ]
        if min(crosses) > 1e-9:
            assert found < 0
        if min(crosses) < -1e-9:
            assert found > 0
    else:
        assert found >= 0


def test_filling_up_a_polygon_changes_no_distance():
    rng = np.random.default_rng(0)
    for _ in range(50):
        hull = convex_hull(rng.normal(size=(8, 2)))
        probe = rng.normal(size=(1, 2))
        full = hull[np.minimum(np.arange(12), len(hull) - 1)]
        size = np.array([len(hull)])
        assert signed_distance(full[None], size, probe) == signed_distance(hull[None], size, probe)
    assert np.isnan(signed_distance(np.zeros((1, 3, 2)), np.array([0]), np.zeros((1, 2)))).all()


@settings(max_examples=15)
@given(st.floats(0.01, 100), st.floats(-3, 3), st.floats(-9, 9), st.floats(-9, 9))
def test_verdicts_know_no_scale_heading_or_place(scale, turn, x, z):
    cut = segment(DANCE)
    other = moved(DANCE, scale, turn, (x * 100, 0.0, z * 100))
    for measure in (static_balance, dynamic_balance):
        one, two = measure(DANCE), measure(other)
        np.testing.assert_allclose(two.distance, one.distance, atol=1e-7)
        sure = one.grounded & (np.abs(np.where(one.grounded, one.distance, 1)) > 1e-6)
        if not sure[one.grounded].all():
            continue
        for rule in RULES:
            np.testing.assert_array_equal(
                one.unbalanced(cut, rule)[0], two.unbalanced(cut, rule)[0]
            )


@given(SEEDS)
def test_masses_sum_to_one_and_the_centre_is_among_the_joints(seed):
    rng = np.random.default_rng(seed)
    frame = DANCE[int(rng.integers(DANCE.n_frames)) :][:1]
    known = mass_model(frame.skeleton)
    assert known.mass.sum() == pytest.approx(1.0, abs=1e-12)
    turns, joints = frame.world_transforms()
    ends = joints + rotations.rotate(turns, known.bone)
    low = np.minimum(joints, ends)[0].min(axis=0)
    high = np.maximum(joints, ends)[0].max(axis=0)
    center = center_of_mass(frame)[0]
    assert (center >= low).all()
    assert (center <= high).all()


def test_a_lifted_clip_is_all_flight_if_the_floor_is_given():
    known = mass_model(DANCE.skeleton)
    low = DANCE.world_positions()[:, :, 1]
    jump = float(np.ptp(low)) + 0.04 * known.height
    lifted = moved(DANCE, place=(0.0, jump, 0.0))
    cut = segment(DANCE)
    for measure in (static_balance, dynamic_balance):
        above = measure(lifted, like=DANCE)
        assert not above.grounded.any()
        assert np.isnan(above.distance).all()
        unbalanced, flight = above.unbalanced(cut)
        assert flight.all()
        assert not unbalanced.any()
    with pytest.raises(InsufficientDataError, match="flight"):
        balance_row("x", [above], [[above]], [np.ones((1, len(cut)), bool)], [cut])
    # Its own floor is the one that it seems to stand on.
    assert support(lifted).touching.any()


def upright(lean=0.0):
    """A figure that stands as its dance began, bent at the spine."""
    still = DANCE[:1]
    quats = np.repeat(still.rotations, 40, axis=0)
    hips = rotations.exp(np.array([lean, 0.0, 0.0]))
    names = DANCE.skeleton.names
    (chest,) = (c for c in DANCE.skeleton.children[0] if names[c] == "Spine")
    quats[:, chest] = rotations.multiply(hips, quats[:, chest])
    places = np.repeat(still.positions, 40, axis=0)
    return replace(DANCE, rotations=quats, positions=places, channel_values=None)


def test_who_stands_still_has_one_balance_and_who_leans_over_falls():
    still = static_balance(upright(), like=DANCE)
    moving = dynamic_balance(upright(), like=DANCE)
    np.testing.assert_allclose(moving.distance, still.distance, atol=1e-9)
    far = static_balance(upright(-1.4), like=DANCE)
    assert still.distance[0] < 0 < far.distance[0]
    cut = Segments([0, 10], [10, 39])
    for rule in RULES:
        assert not still.unbalanced(cut, rule)[0].any()
        assert far.unbalanced(cut, rule)[0].all()
        assert not far.unbalanced(cut, rule, margin=float(far.distance[0]) + 1e-9)[0].any()


@pytest.mark.parametrize("pull", [-300.0, 150.0, 600.0])
def test_who_speeds_up_must_lean_into_it(pull):
    # On a cart that speeds up evenly the zero-moment point stays behind the centre of mass.
    still = upright()
    time = np.arange(still.n_frames) * still.frame_time
    places = still.positions.copy()
    places[:, 0, 2] += 0.5 * pull * time**2
    cart = replace(still, positions=places)
    ground = support(cart, like=DANCE)
    height = mass_model(still.skeleton).height
    center = center_of_mass(cart)
    gravity = 9.81 * height / 1.75
    behind = center.copy()
    behind[:, 2] -= (center[:, 1] - ground.floor) * pull / gravity
    want = signed_distance(ground.polygons, ground.sizes, behind[:, ground.axes]) / height
    found = dynamic_balance(cart, like=DANCE)
    np.testing.assert_allclose(found.distance, want, atol=1e-6)


@given(npst.arrays(np.float64, 30, elements=st.sampled_from([-0.1, 0.1, np.nan])))
def test_rules_are_ordered_and_count_grounded_frames_alone(distance):
    own = Balance("static", distance, np.isfinite(distance), "rods", ())
    cut = Segments([0, 7, 15], [7, 15, 29])
    every, most, some = (own.unbalanced(cut, rule)[0] for rule in RULES)
    assert (every <= most).all()
    assert (most <= some).all()
    for index, (start, stop) in enumerate(zip(cut.start, cut.stop, strict=True)):
        frames = distance[start : stop + 1]
        frames = frames[np.isfinite(frames)]
        assert own.unbalanced(cut)[1][index] == (len(frames) == 0)
        assert every[index] == (len(frames) > 0 and (frames > 0).all())
        assert most[index] == ((frames > 0).sum() > len(frames) / 2)
        assert some[index] == (frames > 0).any()


def test_the_support_is_over_both_feet_and_as_wide_as_they_are():
    ground = support(DANCE)
    known = mass_model(DANCE.skeleton)
    joints = DANCE.world_positions()
    for frame in np.flatnonzero(ground.touching.all(axis=1))[::20]:
        polygon = ground.polygons[frame][: ground.sizes[frame]]
        for index, foot in enumerate(known.feet):
            assert ground.touching[frame, index]
            place = joints[frame, foot.ankle][list(ground.axes)][None]
            near = signed_distance(polygon[None], np.array([len(polygon)]), place)[0]
            assert near < 0.12 * known.height  # a foot, where its toe alone stands


def test_without_legs_balance_is_refused():
    pole = Skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [0, 1, 0]])
    motion = Motion(pole, 1 / 30, np.tile([0.0, 0, 0, 1], (20, 2, 1)), np.zeros((20, 2, 3)))
    with pytest.raises(InsufficientDataError, match="no leg"):
        static_balance(motion)
    with pytest.raises(InsufficientDataError, match="frames to differentiate"):
        dynamic_balance(DANCE[:3], like=DANCE)
    with pytest.raises(ValueError, match="20 frames"):
        static_balance(DANCE[:20], on=support(DANCE[:10], like=DANCE))
    with pytest.raises(ValueError, match="rule"):
        static_balance(DANCE).unbalanced(segment(DANCE), "most")


def test_rates_are_those_of_counting():
    rng = np.random.default_rng(4)
    cuts = [Segments([0, 5, 9], [5, 9, 14]), Segments([0, 4], [4, 9])]

    def any_balance(n):
        distance = rng.choice([-1.0, 1.0], n)
        return Balance("static", distance, np.ones(n, bool), "rods", ())

    own = [any_balance(15), any_balance(10)]
    made = [[any_balance(n) for _ in range(3)] for n in (15, 10)]
    changed = [rng.random((3, len(cut))) < 0.5 for cut in cuts]
    row = balance_row("x", own, made, changed, cuts, "any")
    after = np.concatenate(
        [
            [b.unbalanced(cut, "any")[0] for b in several]
            for several, cut in zip(made, cuts, strict=True)
        ],
        axis=1,
    )
    before = np.concatenate([b.unbalanced(cut, "any")[0] for b, cut in zip(own, cuts, strict=True)])
    new = np.concatenate(changed, axis=1)
    assert row.rate.value == after.mean()
    assert row.changed.value == after[new].mean()
    gaps = (after.astype(float) - before)[new]
    assert row.difference.value == pytest.approx(gaps.mean())
    assert row.rate.n == after.size
    assert row.difference.n == new.sum()


def test_an_animal_is_weighed_by_its_bones():
    quadruped = read_bvh(at("synthetic_quadruped/quadruped_trot.bvh"))
    own = static_balance(quadruped)
    assert own.model == "rods"
    assert own.grounded.any()
    assert support(quadruped).touching.shape[1] == 4
