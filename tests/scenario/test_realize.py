"""Realized scenarios: root motion, kept numbers, and root speeds."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mograft import Library, graft
from mograft.body.mass import mass_model
from mograft.motion import rotations
from mograft.scenario import Scenario, transitions, walk
from tests.hierarchies import DANCES, recording, with_joint_above_root


@pytest.mark.parametrize("seam", ["offset", "inertial", "displacement"])
def test_realize_root_ends_at_the_sum_of_graph_displacements(library, seam):
    """With any seam treatment; the limit of the yaw rate may change the heading by 1e-4 rad."""
    bare = replace(library, config=replace(library.config, feet="never", seam=seam))
    graph = transitions(bare)
    walked = Scenario(walk(bare, 60.0, 2, graph=graph), None, np.array([5.0, 0.0, 7.0]), 0.4)
    at = np.searchsorted(graph.segments, walked.segments)
    assert (np.diff(walked.segments) != 1).sum() >= 20
    turn, spot = walked.turn, walked.place
    turned, places = (
        own[:, library.root] for own in graft(bare, scenario=walked).base.world_transforms()
    )
    for place, then in pairwise(at):
        edges = graph.edges_from(int(place))
        edge = edges.start + int(np.flatnonzero(graph.targets[edges] == then)[0])
        on = graph.displacements[place] + graph.seam_displacements[edge]
        spot = spot + rotations.rotate(rotations.from_axis_angle([0, 1, 0], turn), on)
        turn += graph.yaw_changes[edge]
    heading = rotations.from_axis_angle([0, 1, 0], turn)
    spot = spot + rotations.rotate(heading, graph.displacements[at[-1]])
    assert np.linalg.norm((places[-1] - spot)[[0, 2]]) < 0.03 * mass_model(library.skeleton).height
    last = library.segments.stop[walked.segments[-1]]
    captured = library.clips[0].world_transforms()[0][last, library.root]
    apart = rotations.multiply(turned[-1], rotations.inverse(captured))
    off = rotations.multiply(rotations.inverse(heading), apart)
    assert rotations.angle(off, rotations.IDENTITY) < 1e-4


def test_graft_scenario_of_all_segments_in_order_equals_graft_on_clip(library):
    """The realized base equals the clip bit for bit, and so does the graft."""
    own = library.segments.of_clip(0)
    new, plain = graft(library, scenario=own, seed=3), graft(library, seed=3)
    np.testing.assert_array_equal(new.base.rotations, plain.base.rotations)
    np.testing.assert_array_equal(new.base.positions, plain.base.positions)
    np.testing.assert_array_equal(new.motion.rotations, plain.motion.rotations)


def test_graft_scenario_joint_above_root_moves_keeps_world_positions(library):
    """In one of three clips half of the root's travel is that of a joint above it."""
    clip = library.clips[0][:600]
    still = with_joint_above_root(clip, 0.0)
    moving = with_joint_above_root(clip, 0.5)
    clips = {"a": still, "b": still, "c": moving}
    several = Library.build([replace(own, name=name) for name, own in clips.items()])
    assert several.root == 1
    base = graft(several, scenario=several.segments.of_clip(2)).base
    expected = moving.world_positions()[:, 1:]
    np.testing.assert_allclose(base.world_positions()[:, 1:], expected, atol=1e-6)


def speeds(motion, root, up):
    """The root's speed over the floor and its yaw rate, per frame."""
    turned, placed = motion.world_transforms()
    steps = np.linalg.norm(np.delete(np.diff(placed[:, root], axis=0), up, axis=1), axis=1)
    turns = rotations.multiply(turned[1:, root], rotations.inverse(turned[:-1, root]))
    yaws = rotations.log(rotations.twist(turns, up))
    return steps, np.linalg.norm(yaws, axis=1)


@pytest.mark.filterwarnings("ignore")  # of faults in the recordings
@pytest.mark.parametrize("name", ["dancer", *DANCES])
def test_graft_one_minute_walk_root_is_no_faster_than_its_segments(name, library):
    """The bound is over the segments of the walk; it holds after feet are planted."""
    if name != "dancer":
        library = Library.build(recording(name))
    graph, cut = transitions(library), library.segments
    captured = speeds(library.clips[0], library.root, library.up)
    for seed in (1, 2, 3):
        new = graft(library, scenario=walk(library, 60.0, seed, graph=graph))
        assert new.motion.duration >= 60.0 - 1e-6
        used = np.zeros(library.clips[0].n_frames - 1, bool)
        for segment in new.scenario:
            used[cut.start[segment] : cut.stop[segment]] = True
        for own, most in zip(speeds(new.motion, library.root, library.up), captured, strict=True):
            assert own.max() <= most[used].max() * (1 + 1e-9)


def test_scenario_invalid_arguments_raise_value_error(library):
    n, clip = len(library.segments), library.clips[0]
    for message, call in (
        ("`segments` must contain at least one segment, got none", lambda: Scenario([])),
        ("values of `lengths` must be at least 1, got 0", lambda: Scenario([1, 2], [3, 0])),
        (f"must .* 0 to {n - 1}, got {n}", lambda: graft(library, scenario=[0, n])),
        (f"must .* 0 to {n - 1}, got {n}", lambda: graft(library, scenario=Scenario([n]))),
        ("must contain at least one segment, got none", lambda: graft(library, scenario=[])),
        ("not be given together with `scenario`", lambda: graft(library, clip, scenario=[0])),
    ):
        with pytest.raises(ValueError, match=message):
            call()
