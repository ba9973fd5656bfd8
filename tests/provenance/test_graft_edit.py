"""Edits of a graft: named segments change, all other frames stay bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft._util.runs import dilate
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.transplant import seam_reach
from mograft.config import CHOICES
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.provenance.graft_edit import changed_positions
from mograft.provenance.graft_revision import constrain, regenerate
from mograft.solve.plan import GraftPlan
from tests.provenance.checks import assert_replays
from tests.strategies import SEEDS, few_examples


@pytest.fixture(scope="module")
def library():
    motion = dance(seed=1, strides=2).motion[:1200]
    return mg.Library.build([motion[:700], replace(motion[700:], name="second")])


@pytest.fixture(scope="module")
def several(library):
    """Return a library of the same clips with three exchanged groups."""
    return mg.Library.build(list(library.clips), "lower_torso_larm_rarm")


def changed_frames(graft, edited):
    """Return the mask of the frames whose numbers differ, those of a BVH file included."""
    numbers = [
        (own.channel_numbers(), own.rotations, own.positions)
        for own in (graft.motion, edited.motion)
    ]
    pairs = zip(*numbers, strict=True)
    return np.any(
        [(one != other).reshape(len(one), -1).any(axis=1) for one, other in pairs], axis=0
    )


def frames_within_reach(graft, edited):
    """Return the mask of the frames within `seam_reach` of changed segments.

    A seam treatment that spans segments also changes the segments beside them.
    """
    config = graft.library.config
    reach = int(np.ceil(seam_reach(config) * graft.motion.rate))
    near = np.zeros(graft.motion.n_frames, bool)
    changed = changed_positions(graft.donors, edited.donors)
    if SEAM_TREATMENTS[config.seam].spans_segments:
        changed = dilate(changed)
    segments = graft.substitutions[: len(changed)]
    for own, is_changed in zip(segments, changed.tolist(), strict=True):
        if is_changed:
            near[max(own.start - reach, 0) : own.stop + reach + 1] = True
    return near


@st.composite
def edits(draw, graft, groups):
    """Draw edits at distinct segments; return them with what they name."""
    n = len(next(iter(graft.donors.values())))
    cut, n_segments = [own[1:3] for own in graft.substitutions[:n]], len(graft.library.segments)
    numbers = draw(st.lists(st.integers(0, n - 1), min_size=1, max_size=5, unique=True))
    made, named = [], {}
    for number in numbers:
        group = draw(st.sampled_from([None, *groups])) if len(groups) > 1 else None
        donor = draw(st.integers(0, n_segments - 1))
        kind = draw(st.sampled_from(["use", "ban", "ban donor", "ban frames", "keep"]))
        if kind == "use":
            made.append(mc.Use(number, donor, group=group))
        elif kind == "keep":
            made.append(mc.KeepOriginal(frames=cut[number], group=group))
        elif kind == "ban frames":
            made.append(mc.Ban(frames=cut[number], group=group))
        else:
            banned = donor if kind == "ban donor" else None
            made.append(mc.Ban(number, banned, group=group))
        named[number] = (kind, groups if group is None else [group], donor)
    return made, named


@pytest.mark.filterwarnings("ignore:.*no other candidate")
@pytest.mark.parametrize("name", ["library", "several"])
@few_examples(8)
@given(data=st.data())
def test_replace_changes_named_segments_only(request, name, data):
    library = request.getfixturevalue(name)
    config = replace(
        library.config,
        choice=data.draw(st.sampled_from(CHOICES["choice"])),
        seam=data.draw(st.sampled_from(CHOICES["seam"])),
    )
    graft = mg.graft(library.relabelled(config), seed=data.draw(SEEDS))
    made, named = data.draw(edits(graft, list(graft.donors)))
    edited = mg.edit(graft, *made, seed=data.draw(st.one_of(st.none(), SEEDS)))
    candidates = GraftPlan.build(graft.library, None, None, ()).problem.candidates
    for group, before in graft.donors.items():
        after = edited.donors[group]
        for position in range(len(before)):
            kind, groups, donor = named.get(position, ("", [], 0))
            if group not in groups:
                assert after[position] == before[position]
            elif kind == "use":
                assert after[position] == donor
            elif kind == "keep":
                assert after[position] == graft.substitutions[position].segment
            elif kind == "ban donor":
                assert after[position] != donor or edited.violations
            elif (candidates[group][position] != before[position]).any():
                assert after[position] != before[position] or edited.violations
    assert_replays(edited)
    if config.seam == "paper":  # a seam is also changed by the seams beside it
        return
    assert not (changed_frames(graft, edited) & ~frames_within_reach(graft, edited)).any()


@pytest.mark.parametrize("seed", range(4))
def test_replace_of_root_group_moves_later_root_rigidly(root_library, seed):
    graft = mg.graft(root_library, seed=seed)
    rng = np.random.default_rng(seed)
    number = int(rng.choice(np.flatnonzero(graft.alternatives["lower"] > 2)[:60]))
    edited = mg.edit(graft, mc.Ban(number))
    assert changed_positions(graft.donors, edited.donors).any()
    near = frames_within_reach(graft, edited)
    first, last = np.flatnonzero(near)[[0, -1]]
    root = root_library.root
    others = np.setdiff1d(np.arange(graft.motion.n_joints), [root])
    quats, new = graft.motion.rotations, edited.motion.rotations
    np.testing.assert_array_equal(quats[~near][:, others], new[~near][:, others])
    np.testing.assert_array_equal(quats[:first, root], new[:first, root])
    heights = [
        own.positions[last + 1 :, root, root_library.up] for own in (graft.motion, edited.motion)
    ]
    np.testing.assert_allclose(*heights, atol=1e-6 * graft.motion.positions.max())
    later = slice(last + 1, None)
    turns = rotations.multiply(new[later, root], rotations.inverse(quats[later, root]))
    angles = [rotations.log(rotations.multiply(rotations.inverse(turns[:1]), own)) for own in turns]
    assert np.abs(angles).max(initial=0.0) < 1e-5
    assert_replays(edited)


def test_replace_with_planted_feet_joins_the_motions(root_library):
    library = replace(root_library, config=replace(root_library.config, feet="auto"))
    graft = mg.graft(library, seed=1)
    number = int(np.flatnonzero(graft.alternatives["lower"] > 2)[30])
    edited = mg.edit(graft, mc.Ban(number))
    assert changed_positions(graft.donors, edited.donors).any()
    assert edited.feet is not None
    first = int(np.flatnonzero(changed_frames(graft, edited))[0])
    assert first > graft.substitutions[number].start - 150
    assert_replays(edited)


def test_replace_same_edit_gives_same_bytes_and_edits_add_up(library):
    graft = mg.graft(library, seed=2)
    first = mg.edit(graft, mc.Use(5, 40))
    assert not changed_frames(first, mg.edit(graft, mc.Use(5, 40))).any()
    second = mg.edit(first, mc.Use(50, 41))
    assert (second.donors["upper"][5], second.donors["upper"][50]) == (40, 41)
    assert not (changed_frames(first, second) & ~frames_within_reach(first, second)).any()
    assert [len(own["replaced"]) for own in mg.graft_record(second)["edits"]] == [1, 1]
    assert_replays(second)


def test_replace_supersedes_earlier_constraints(library):
    segments = library.segments
    keep = mc.KeepOriginal(frames=(int(segments.start[4]), int(segments.stop[8])))
    graft = mg.graft(library, constraints=[keep, mc.Use(12, 40)], seed=1)
    edited = mg.edit(graft, mc.Use(6, 41), mc.KeepOriginal(frames=graft.substitutions[12][1:3]))
    assert edited.donors["upper"][[4, 5, 6, 7, 8, 12]].tolist() == [4, 5, 41, 7, 8, 12]
    assert not edited.violations
    again = mg.edit(edited, mc.Ban(6), mc.Ban(12))
    assert again.donors["upper"][6] != 41
    assert again.donors["upper"][[4, 5, 7, 8]].tolist() == [4, 5, 7, 8]
    assert not again.violations


def test_replace_ban_of_present_donor_stays_in_force(library):
    graft = mg.graft(library, seed=3)
    is_exchanged = [not own.is_own for own in graft.substitutions]
    position = int(np.flatnonzero(is_exchanged & (graft.alternatives["upper"] > 3))[0])
    seen = [int(graft.donors["upper"][position])]
    for _ in range(3):
        graft = mg.edit(graft, mc.Ban(position))
        seen.append(int(graft.donors["upper"][position]))
    assert len(set(seen)) == 4


def test_replace_contradictory_edits_are_violations(library):
    edited = mg.edit(mg.graft(library, seed=1), mc.Use(5, 40), mc.Ban(5, 40))
    assert edited.donors["upper"][5] == 5
    assert [type(own.constraint).__name__ for own in edited.violations] == ["Use"]


def test_replace_keeps_pose_constraints_of_the_graft(library):
    target = mg.graft(library, seed=3).motion.world_positions()[100]
    hand = library.skeleton.index("LeftHand")
    reach = mc.Reach("LeftHand", tuple(target[hand].tolist()), 100, 0.05)
    graft = mg.graft(library, constraints=[reach], seed=1)
    assert not graft.violations
    edited = mg.edit(graft, mc.Ban(frames=(80, 120)))
    assert edited.request.constraints[0] == reach
    poses = edited.motion.world_positions()[100, hand]
    height = mg.Poses.from_motion(edited.motion).height
    assert (np.linalg.norm(poses - target[hand]) <= 0.05 * height) == (not edited.violations)


def test_replace_ban_without_other_candidate_warns(library):
    config = replace(library.config, neighbourhood="cluster")
    graft = mg.graft(library.relabelled(config), seed=1)
    number = int(np.flatnonzero(graft.alternatives["upper"] == 0)[0])
    with pytest.warns(UserWarning, match="1 of 1 banned segments have no other candidate"):
        edited = mg.edit(graft, mc.Ban(number))
    assert not edited.violations
    assert not changed_frames(graft, edited).any()
    every = mc.Ban(frames=(0, graft.motion.n_frames - 1))
    n, message = len(graft.substitutions), "of {} banned segments have no other candidate"
    with pytest.warns(UserWarning, match=message.format(n)):
        edited = mg.edit(graft, every)
    assert not edited.violations
    differ = edited.donors["upper"] != graft.donors["upper"]
    assert (differ == (graft.alternatives["upper"] > 0)).all()


def test_replace_in_scenario_numbers_segments_of_the_scenario(library):
    graft = mg.graft(library, scenario=[30, 31, 5, 6, 60, 61], seed=1)
    edited = mg.edit(graft, mc.Use(2, 40))
    assert edited.donors["upper"][2] == 40
    assert_replays(edited)


@pytest.mark.parametrize(
    ("edits", "options", "message"),
    [
        ([], {}, "`edits` must be one constraint or more"),
        ([mc.Use(999, 3)], {}, "`segment` of Use must be 0 to"),
        ([mc.Ban(999)], {}, "`segment` of Ban must be 0 to"),
        ([mc.Ban(frames=(9000, 9010))], {}, "`frames` must be within 0 to 699, got 9000-"),
        ([mc.KeepOriginal(frames=(9000, 9010))], {}, "`frames` must be within .*, got 9000-"),
        ([mc.Use(3, ("secnd", 0, 9))], {}, "did you mean 'second'"),
        ([mc.Ban(3, group="uper")], {}, "`group` of Ban must be .*; did you mean 'upper'"),
        (["knee"], {}, "edits must be constraints"),
        ([mc.Use(3, 4, weight=1.0)], {}, "hard"),
        ([mc.Use(3, 4)], {"seed": -1}, "`seed`"),
    ],
)
def test_replace_invalid_edit_raises(library, edits, options, message):
    with pytest.raises((TypeError, ValueError), match=message):
        mg.edit(mg.graft(library, seed=1), *edits, **options)


def test_revision_of_graft_from_files_needs_the_library(library, tmp_path):
    mg.write_bvh(library.clips[0][:300], tmp_path / "a.bvh")
    graft = mg.replay(mg.graft_record(mg.graft(mg.Library.build(tmp_path / "a.bvh"), seed=1)))
    for revise, *arguments in (
        (mg.edit, mc.Ban(3)),
        (mg.change, "upper", (50, 80)),
        (constrain, []),
        (regenerate, [("upper", (0, 9))], 0),
    ):
        with pytest.raises(ValueError, match="the whole library is needed"):
            revise(graft, *arguments)
