"""`bend`: arcs and ways round obstacles, planted feet, unchanged frames, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util.runs import find_runs
from mograft.body.capsules import Poses
from mograft.body.contacts import Ground, detect_contacts
from mograft.constraints import Avoid, Box, Capsule, Sphere
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.scenario import bend
from tests.strategies import assert_same_rotations, few_examples, transform_motion

HEIGHT = 170.0


@pytest.fixture(scope="module")
def walk():
    """A walk of 4.4 heights in the direction of z."""
    return dance(strides=8).motion[2040:2281]


def heading_change(bent, walk):
    """The turn about y of the root in each frame, in radians."""
    root = walk.locomotion_root()
    quats = [motion.world_track(root)[0] for motion in (bent, walk)]
    turns = rotations.twist(rotations.multiply(quats[0], rotations.inverse(quats[1])), 1)
    return rotations.log(turns)[:, 1]


def largest_slide(motion, contacts):
    """The longest way of a heel or toe during a contact, in skeleton heights."""
    ground = Ground.of(motion)
    points = ground.points(motion) / ground.height
    ways = [
        np.linalg.norm(np.diff(points[start:stop, leg, point], axis=0), axis=1).sum()
        for leg, point in np.ndindex(contacts.shape[1:])
        for start, stop in find_runs(contacts[:, leg, point]).tolist()
    ]
    return max(ways)


def own_motion(motion):
    """Local rotations of the joints that are neither the root nor in a leg."""
    names = ("Hips", "Leg", "Foot")
    kept = [j for j, name in enumerate(motion.skeleton.names) if not any(n in name for n in names)]
    return motion.rotations[:, kept]


@few_examples(12)
@given(st.floats(-2.0, 2.0))
def test_bend_turns_last_frame_and_keeps_body_and_plants(walk, turn):
    bent = bend(walk, turn)
    change = heading_change(bent, walk)
    assert change[0] == pytest.approx(0.0, abs=1e-9)
    assert change[-1] == pytest.approx(turn, abs=1e-9)
    # A positive turn leads to the left: the figure walks along z, and x points to its left.
    if abs(turn) > 0.1:
        root = walk.locomotion_root()
        aside = (bent.positions - walk.positions)[-1, root, 0]
        assert np.sign(aside) == np.sign(turn * walk.positions[-1, root, 2])
    assert_same_rotations(own_motion(bent), own_motion(walk))
    contacts = detect_contacts(walk)
    assert largest_slide(bent, contacts) <= largest_slide(walk, contacts)
    assert mg.foot_skate(bent) <= mg.plant_feet(walk)[1].skate_after + 0.05


@few_examples(12)
@given(st.floats(0.35, 0.8), st.floats(-20.0, 20.0), st.floats(5.0, 30.0), st.sampled_from("scb"))
def test_bend_avoids_obstacles_and_keeps_frames_before_them(walk, share, aside, size, shape):
    frame = int(share * walk.n_frames)
    x, _, z = walk.world_positions()[frame, walk.locomotion_root()]
    x += aside
    obstacle = {
        "s": Sphere((x, 90.0, z), size),
        "c": Capsule((x, 0.0, z), (x, 200.0, z), size),
        "b": Box((x, 80.0, z), (size, 80.0, 0.5 * size)),
    }[shape]
    bent = bend(walk, avoid=[Avoid(obstacle)])
    poses = Poses.from_motion(bent)
    distances, _ = obstacle.distances(poses, np.arange(len(poses.capsules)))
    assert distances.min() >= 0.0
    changed = (bent.rotations != walk.rotations).any(axis=(1, 2))
    root, headings = walk.locomotion_root(), heading_change(bent, walk)
    assert changed.argmax() >= (np.abs(headings) > 1e-12).argmax() - 1.5 * walk.rate
    assert np.abs(np.diff(headings)).max() < 0.2
    before = np.abs(np.diff(walk.positions[:, root], axis=0)).max()
    assert np.abs(np.diff(bent.positions[:, root], axis=0)).max() < 1.1 * before
    assert mg.foot_skate(bent) <= mg.plant_feet(walk)[1].skate_after + 0.05


def test_bend_without_turn_and_contact_returns_same_motion(walk):
    far = Avoid(Sphere((1000.0, 0.0, 0.0), 10.0))
    assert bend(walk) is walk
    assert bend(walk, 0.0, [far]) is walk
    # An obstacle that is there at another time only.
    x, _, z = walk.world_positions()[100, walk.locomotion_root()]
    assert bend(walk, avoid=[Avoid(Sphere((x, 90.0, z), 10.0), frames=(0, 30))]) is walk


@few_examples(6)
@given(st.floats(-3.0, 3.0), st.floats(-1.5, 1.5))
def test_bend_turned_motion_gives_turned_result(walk, yaw, turn):
    moved = transform_motion(walk, yaw=yaw)
    expected = transform_motion(bend(walk, turn), yaw=yaw)
    np.testing.assert_allclose(
        bend(moved, turn).world_positions(), expected.world_positions(), atol=1e-6 * HEIGHT
    )


def test_bend_bad_arguments_are_named(walk):
    first, later = (walk.world_positions()[k, walk.locomotion_root()] for k in (0, 150))
    near = Sphere((first[0], 90.0, first[2]), 10.0)
    wide = Box((later[0], 90.0, later[2]), (900.0, 90.0, 10.0))
    for arguments, message in (
        (([walk],), "`motion`"),
        ((walk, 0.0, [near]), "`avoid`"),
        ((walk, 50.0), r"`turn` must be at most \d+ degrees on this path of"),
        ((walk, 0.0, [Avoid(near)]), "0 heights before the first contact are too few"),
        ((walk, 0.0, [Avoid(wide)]), "a shift of 2 skeleton heights to a side is not enough"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            bend(*arguments)
