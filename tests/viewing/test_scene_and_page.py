"""Pages: their data equals the motions, and no name can break out of the page."""

import base64
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import mograft as mg
import mograft.constraints as mc
from mograft import graft, segment, view
from mograft.motion import rotations
from mograft.viewing.encoding import encode_scene, quantize
from mograft.viewing.figure import ShownConstraint
from mograft.viewing.geometry import DrawnSkeleton
from mograft.viewing.scene import Scene
from tests import strategies
from tests.hierarchies import under_world_root
from tests.strategies import HOSTILE_NAMES
from tests.viewing.page_content import (
    Tags,
    clip_positions,
    dequantize,
    node_positions,
    page_data,
    shown,
)


@given(
    arrays(float, (9, 4), elements=st.floats(-1e6, 1e6)), st.floats(1e-6, 1e3), st.integers(1, 3)
)
def test_quantize_error_is_at_most_half_a_step(values, unit, n_first):
    tracks = [values[:, :n_first], values[:, n_first:]]
    steps, pose = quantize(tracks, (unit, 2 * unit))
    got = dequantize(np.repeat(steps, [n_first, 4 - n_first]), pose)
    for index, (own, step) in enumerate(zip(tracks, steps, strict=True)):
        columns = slice(n_first) if index == 0 else slice(n_first, None)
        assert np.abs(got[:, columns] - own).max() <= 0.5 * step * (1 + 1e-6)
        assert (index + 1) * unit <= step <= max((index + 1) * unit, np.abs(own).max() / 4e6)


@given(strategies.motions(max_frames=20), st.floats(1e-3, 1e3))
def test_view_positions_equal_those_of_the_motion(motion, size):
    scaled = replace(
        motion,
        skeleton=motion.skeleton.with_offsets(motion.skeleton.offsets * size),
        positions=motion.positions * size,
    )
    clip = shown(scaled)["clips"][0]
    want = node_positions(scaled) @ DrawnSkeleton.of(scaled).to_y_up.T
    got = clip_positions(clip)[:, : want.shape[1]]
    # A step of 2^-17 turns a bone by at most 2e-5 radians; the chain of bones adds up.
    reach = np.abs(scaled.positions).sum(axis=(1, 2)).max() + np.abs(scaled.skeleton.offsets).sum()
    steps = len(clip["moving"]) * clip["units"][1]
    np.testing.assert_allclose(got, want, atol=2e-5 * motion.n_joints * reach + steps)
    for row in clip["rows"]:
        assert (row["start"][0], row["stop"][-1]) == (0, motion.n_frames - 1)


@pytest.mark.parametrize(
    "right_angles", [(0, 0, 0), (1, 0, 0), (0, 0, -1), (0, 0, 1), (2, 0, 0), (-1, 0, 0)]
)
def test_view_any_up_axis_gives_upright_unmirrored_figure(motion, right_angles):
    short = motion[:40]
    turned = strategies.turn_motion(short, rotations.exp(0.5 * np.pi * np.array(right_angles)))
    got, plain = (clip_positions(shown(m)["clips"][0]) for m in (turned, short))
    # Heights agree, and seen from above it is the same figure, in another direction.
    np.testing.assert_allclose(got[..., 1], plain[..., 1], atol=0.1)
    seen, expected = (own[..., 0] + 1j * own[..., 2] for own in (got, plain))
    ahead = np.vdot(expected, seen)
    np.testing.assert_allclose(seen, expected * ahead / abs(ahead), atol=0.1)


@pytest.mark.parametrize("is_moving", [False, True])
def test_drawn_skeleton_world_root_adds_no_bone(motion, is_moving):
    plain = DrawnSkeleton.of(motion)
    rooted = DrawnSkeleton.of(under_world_root(motion, moving_root=is_moving))
    assert rooted.parents == [-1, *(p + 1 if p >= 0 else -1 for p in plain.parents)]
    np.testing.assert_allclose(rooted.positions[:, 1:], plain.positions, atol=1e-9)
    np.testing.assert_allclose(rooted.positions[:, 0], plain.positions[:, 0], atol=1e-9)
    assert rooted.root == plain.root + 1
    assert rooted.tips == [tip + 1 for tip in plain.tips]
    assert [(*own.end, own.radius, own.kind) for own in rooted.bones] == [
        (*own.end, pytest.approx(own.radius), own.kind) for own in plain.bones
    ]
    assert (rooted.height, rooted.floor) == pytest.approx((plain.height, plain.floor))


@pytest.mark.parametrize("length", [7, 5000])
def test_drawn_skeleton_any_block_of_frames_has_positions_of_the_motion(
    motion, monkeypatch, length
):
    floor = DrawnSkeleton.of(motion).floor
    monkeypatch.setattr("mograft.motion.motion._FRAMES_PER_BLOCK", length)
    found, world = DrawnSkeleton.of(motion), motion.world_positions()
    np.testing.assert_array_equal(found.positions[:, : motion.n_joints], world @ found.to_y_up.T)
    assert found.floor == floor


def standing(skeleton):
    """Return one frame in the rest pose."""
    quats = np.tile([0.0, 0.0, 0.0, 1.0], (1, skeleton.n_joints, 1))
    return mg.Motion(skeleton, 0.1, quats, skeleton.offsets[None])


def test_view_eyes_are_thinner_than_head(motion):
    skeleton = motion.skeleton
    head = skeleton.index("Head")
    with_eyes = mg.Skeleton(
        [*skeleton.names, "LeftEye"],
        [*skeleton.parents, head],
        np.concatenate([skeleton.offsets, [[3, 8, 8]]]),
        end_sites=(mg.EndSite(head, [0, 20, 0]), mg.EndSite(18, [0, 0, 2])),
    )
    bones = shown(standing(with_eyes))["clips"][0]["bones"]
    radii = {(bone[0], bone[5]): bone[4] for bone in bones}
    assert radii[18, ""] < 0.3 * radii[head, "head"]
    assert [bone[4] for bone in bones if bone[1:4] == [3, 8, 8]] == [radii[18, ""]]
    # A head without an end site has one nevertheless.
    headless = standing(replace(with_eyes, end_sites=(mg.EndSite(18, [0, 0, 2]),)))
    clip = shown(headless)["clips"][0]
    joint, *top = clip["ends"][-1]
    assert joint == head
    assert np.linalg.norm(top) > 1
    assert "head" in [bone[5] for bone in clip["bones"] if bone[1:4] == top]


def test_drawn_skeleton_trunk_without_neck_reaches_the_shoulders(motion):
    skeleton = motion.skeleton
    spine = skeleton.index("Neck")
    kept = [j for j in range(skeleton.n_joints) if j not in (spine, skeleton.index("Head"))]
    rows = {joint: row for row, joint in enumerate(kept)}
    parents = [rows.get(int(skeleton.parents[j]), -1) for j in kept]
    names = [skeleton.names[j] for j in kept]
    robot = mg.Skeleton(names, parents, skeleton.offsets[kept])
    drawn = DrawnSkeleton.of(standing(robot))
    widths = {own.joint: own.radius for own in drawn.bones if own.end[1] > 0}
    chest = rows[int(skeleton.parents[spine])]
    assert widths[chest] == pytest.approx(0.075 * drawn.height)


def test_view_feet_and_hands_have_shapes(motion):
    shapes = {bone[0]: bone[5] for bone in shown(motion[:5])["clips"][0]["bones"]}
    for side in ("Left", "Right"):
        for part, shape in (("Foot", "foot"), ("Hand", "hand"), ("UpLeg", "")):
            assert shapes[motion.skeleton.index(f"{side}{part}")] == shape


def test_view_graft_follows_base_and_lists_donors(motion, new):
    data = shown(motion, new)
    assert [clip["name"] for clip in data["clips"]] == ["dance", "dance_graft0"]
    base, grafted = data["clips"]
    assert [row["group"] for row in base["rows"]] == ["lower", "upper"]
    (row,) = grafted["rows"]
    upper = new.substitutions  # the only exchanged group
    assert row["start"] == [s.start for s in upper]
    assert row["stop"] == [s.stop for s in upper]
    assert row["first"] == [s.donor_start for s in upper]
    assert row["last"] == [s.donor_stop for s in upper]
    assert [source < 0 for source in row["source"]] == [s.is_own for s in upper]
    assert row["cluster"] == [int(new.library.labels["upper"][s.donor]) for s in upper]
    angles = {seam.frame: np.degrees(seam.gap) for seam in new.seams}
    for index, start in enumerate(row["start"]):
        want = angles.get(start)
        assert row["before"][index] == (None if want is None else pytest.approx(want, abs=0.006))
    assert data["donors"] == ["dance"]
    joints = new.library.joints("upper")
    assert {grafted["groups"][grafted["group"][joint]] for joint in joints} == {"upper"}


def test_view_candidates_equal_library_candidates(new, library):
    data = shown(new)
    table = data["candidates"][data["clips"][1]["candidates"]]["upper"]
    assert data["clips"][0]["candidates"] is None
    upper = new.substitutions
    want = [mg.candidates(library, s.segment, "upper").allowed for s in upper]
    assert table["total"] == [len(allowed) for allowed in want]
    assert table["counts"] == [min(len(allowed), 20) for allowed in want]
    listed = [(s, own) for s, allowed in zip(upper, want, strict=True) for own in allowed[:20]]
    assert table["first"] == [own.start for _, own in listed]
    assert table["last"] == [own.stop for _, own in listed]
    assert table["own"] == [own.segment == s.segment for s, own in listed]
    assert {data["donors"][i] for i in table["source"]} == {"dance"}
    for key, values in (
        ("cost", [own.cost for _, own in listed]),
        ("stretch", [own.stretch for _, own in listed]),
        ("before", np.degrees([own.gap_before for _, own in listed])),
        ("after", np.degrees([own.gap_after for _, own in listed])),
    ):
        np.testing.assert_allclose(table[key], values, atol=6e-5)


@given(st.integers(1, 400_000))
@settings(max_examples=15)
def test_encode_scene_donor_frames_stay_within_budget(two_takes, max_rotations):
    """Frames of donors are runs of those that are listed, and at most a fifteenth of all."""
    library, new = two_takes
    data = encode_scene(Scene.of([new]), max_rotations)
    table = data["candidates"][0]["upper"]
    pairs = zip(table["source"], table["first"], table["last"], strict=True)
    listed = {
        frame
        for source, first, last in pairs
        for frame in range(first, last + 1)
        if data["donors"][source] == "take1"
    }
    kept = 0
    for name, window in data["windows"].items():
        assert name == "take1"
        spans = list(zip(window["start"], window["stop"], strict=True))
        frames = {frame for first, last in spans for frame in range(first, last + 1)}
        assert frames <= listed
        assert window["kept"] == len(frames) == sum(b - a + 1 for a, b in spans)
        kept += window["kept"] * library.skeleton.n_joints
    assert kept <= max_rotations // 15
    if max_rotations // 15 >= len(listed) * library.skeleton.n_joints:
        assert kept == len(listed) * library.skeleton.n_joints


@pytest.fixture(scope="module")
def two_takes(takes):
    library = mg.Library.build(takes)
    return library, graft(library, "take0", seed=1)


def test_view_grafts_of_one_base_share_candidates(library):
    data = shown(*mg.graft_many(library, count=3, seed=1))
    assert [clip["candidates"] for clip in data["clips"]] == [None, 0, 0, 0]
    assert len(data["candidates"]) == 1


def test_view_candidates_of_scenario_have_no_cost(library):
    new = graft(library, scenario=library.segments.of_clip(0)[:12])
    data = shown(new)
    table = data["candidates"][0]["upper"]
    assert len(table["counts"]) == len(new.substitutions)
    assert {*table["cost"], *table["before"], *table["stretch"]} == {None}


@pytest.mark.parametrize("turn", [[np.pi / 2, 0, 0], [0, 0, -np.pi / 2]])
def test_view_objects_stand_beside_the_figure_for_any_up_axis(motion, turn):
    """Objects that are rotated with the motion have the same place on the page."""
    short = motion[:40]
    whole = rotations.exp(np.array(turn, float))
    turned = strategies.turn_motion(short, whole)

    def move(position):
        return tuple(rotations.rotate(whole, np.array(position, float)))

    def constraints(of_motion, move, orientation):
        return [
            mc.Avoid(mc.Sphere(move((10, 100, 50)), 30), frames=(3, 8)),
            mc.Avoid(mc.Capsule(move((0, 0, 50)), move((0, 90, 50)), 10)),
            mc.KeepOut("LeftHand", mc.Box(move((10, 20, 30)), (4, 5, 6), orientation)),
            mc.Avoid(mc.HalfSpace(move((0, 0, 120)), move((0, 0, -1)))),
            mc.Avoid(mc.Character(of_motion, move((80, 0, 0)), yaw=0.5, delay=0.3)),
            mc.Reach("LeftHand", move((30, 140, 20)), frame=12),
            mc.Face(move((0, 150, 300))),
            mc.AvoidSelf(),
        ]

    def encode(own, move, orientation):
        shown = [ShownConstraint(c, own) for c in constraints(own, move, orientation)]
        return encode_scene(replace(Scene.of([own]), constraints=tuple(shown)))["objects"]

    plain = encode(short, tuple, (0, 0, 0, 1))
    got = encode(turned, move, tuple(whole))
    kinds = ["sphere", "capsule", "box", "plane", "figure", "target", "target"]
    assert [own["kind"] for own in plain] == [own["kind"] for own in got] == kinds
    for old, new in zip(plain, got, strict=True):
        assert (old["label"], old["frames"]) == (new["label"], new["frames"])
        for key in old.keys() - {"kind", "label", "frames", "clip", "turn"}:
            np.testing.assert_allclose(new[key], old[key], rtol=1e-5, atol=1e-3, err_msg=key)
        # The axis of a capsule or plane; a box has two more.
        for axis in {"capsule": [1], "plane": [2], "box": [0, 1, 2]}.get(old["kind"], []):
            axes = [rotations.rotate(np.array(own["turn"]), np.eye(3)[axis]) for own in (old, new)]
            np.testing.assert_allclose(*axes, atol=1e-5)
    characters = [clip_positions(own[4]["clip"]) for own in (plain, got)]
    np.testing.assert_allclose(*characters, atol=0.02)
    turn = rotations.exp(np.array([0, 0.5, 0]))
    world = rotations.rotate(np.broadcast_to(turn, (40, 18, 4)), short.world_positions())
    np.testing.assert_allclose(characters[0][:, :18], world + np.array([80, 0, 0]), atol=0.02)
    assert plain[5]["joint"] == motion.skeleton.index("LeftHand")
    assert plain[6]["joint"] == motion.skeleton.index("Head")
    labels = [own["label"] for own in plain[:1] + plain[5:]]
    assert labels == ["frames 3\N{EN DASH}8", "LeftHand, frame 12", "face"]


def test_view_character_has_own_pose_data(motion, library):
    near = mc.Character(motion[:50], (200, 0, 0))
    new = graft(library, constraints=[mc.Avoid(near, weight=1.0), mc.Avoid(near, weight=1.0)])
    (own,) = shown(new)["objects"]
    assert (own["clip"]["frames"], own["clip"]["data"]) == (50, "mograft-poses-2")


def test_view_shows_at_most_twelve_figures_at_first(motion):
    short = [replace(motion[:10], name=f"m{i}") for i in range(14)]
    data = shown(*short)
    assert (data["shown"], len(data["clips"])) == (12, 14)


def test_scene_same_motion_appears_once_and_names_are_unique(motion, new, library):
    names = [figure.name for figure in Scene.of([new, motion, new, library]).figures]
    assert names == ["dance", "dance_graft0"]
    twice = [motion, replace(motion[:50])]
    assert [figure.name for figure in Scene.of(twice).figures] == ["dance", "dance (2)"]


def test_view_motion_has_segments_and_preset_groups(motion):
    clip = shown(motion)["clips"][0]
    assert clip["groups"] == ["lower", "torso", "larm", "rarm"]
    (row,) = clip["rows"]
    assert row["start"] == segment(motion).start.tolist()
    assert set(row["cluster"]) == {-1}
    energy = mg.kinetic_energy(motion)
    assert abs(np.corrcoef(clip["energy"], energy[: len(clip["energy"])])[0, 1]) > 0.8
    custom = mg.JointGroups.preset("lower_upper", motion.skeleton)
    for groups in ("lower_upper", custom):
        got = shown(motion, groups=groups)["clips"][0]
        assert got["groups"] == ["lower", "upper"]


def test_view_single_frame_of_unknown_body_succeeds():
    rod = mg.Skeleton(["x"], [-1], [[0, 0, 0]], end_sites=(mg.EndSite(0, [0, 0, 0]),))
    (clip,) = shown(standing(rod))["clips"]
    assert (clip["rows"], clip["groups"], clip["name"]) == ([], ["body"], "motion")


def test_encode_scene_long_motion_stores_every_nth_frame_and_note(motion):
    scene = Scene.of([motion])
    data = encode_scene(scene, max_rotations=motion.n_frames * motion.n_joints // 3 + 1)
    clip = data["clips"][0]
    assert clip["step"] == 3
    assert clip["frames"] == motion.n_frames
    assert "every 3rd frame" in data["note"]
    whole = encode_scene(scene)["clips"][0]
    np.testing.assert_allclose(clip_positions(clip), clip_positions(whole)[::3], atol=0.02)
    assert encode_scene(scene)["note"] == ""


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_view_hostile_names_add_no_tags(motion, name):
    skeleton = replace(motion.skeleton, names=(name, *motion.skeleton.names[1:]))
    evil = replace(motion[:30], skeleton=skeleton, name=name)
    groups = mg.JointGroups(
        {name or "g": ["*Leg", "*Foot", 0], "rest": list(range(7, 18))}, name or "g"
    )
    page = view(evil, groups=groups, show=False)
    harmless = view(motion[:30], show=False)
    tags = [tag for tag, _ in Tags(page.html).found]
    assert tags == [tag for tag, _ in Tags(harmless.html).found]
    assert page_data(page)["clips"][0]["name"] == (name or "motion")
    ((tag, outer),) = Tags(page._repr_html_()).found
    assert (tag, outer["srcdoc"], outer["sandbox"]) == ("iframe", page.html, "allow-scripts")
    assert set(outer) == {"sandbox", "srcdoc", "title", "style"}
    assert [tag for tag, _ in Tags(evil._repr_html_()).found] == ["iframe"]


def test_page_policy_allows_only_its_script_and_style(motion):
    page = view(motion[:30], title="A & B", show=False)
    found = Tags(page.html).found
    policy = next(a["content"] for _, a in found if a.get("http-equiv"))
    assert policy.startswith("default-src 'none'")
    for tag in ("script", "style"):
        text = re.search(rf"<{tag}>(.*?)</{tag}>", page.html, re.DOTALL)[1]
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    assert "unsafe" not in policy
    assert not [a for _, a in found if "style" in a or any(k.startswith("on") for k in a)]
    assert not [a for _, a in found if "src" in a or "href" in a]
    assert "<title>A &amp; B</title>" in page.html


def test_page_save_writes_file_and_refuses_to_overwrite(motion, tmp_path):
    page = view(motion[:30], show=False)
    path = page.save(tmp_path / "page.html")
    assert path.read_text(encoding="utf-8") == page.html
    with pytest.raises(FileExistsError, match=r"page\.html exists; force=True"):
        page.save(path)
    page.save(path, force=True)
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]
    assert repr(page).startswith("Page('dance', ")


def test_view_invalid_items_raise(motion):
    expected = "`items` must be motions, grafts, libraries, scenes or paths, got 3"
    for items, groups, error, message in (
        ([3], None, TypeError, expected),
        ([], None, ValueError, "`items` must contain at least one motion"),
        ([motion], "wings", ValueError, "`preset` must be one of"),
    ):
        with pytest.raises(error, match=message):
            view(*items, groups=groups, show=False)


def test_view_show_opens_browser(motion, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or False)
    view(motion[:30], show=False)
    view(motion[:30])  # Not in a terminal.
    assert not opened
    view(motion[:30], show=True)
    assert opened[0].startswith("file:///")
    assert "no browser" in capsys.readouterr().err


def test_view_command_writes_and_opens_page(motion, tmp_path, monkeypatch, succeed):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    mg.write_bvh(motion[:60], tmp_path / "a.bvh")
    page = tmp_path / "page.html"
    assert succeed("view", tmp_path, "-o", page)[0].strip() == str(page)
    assert not opened
    out, _ = succeed("view", tmp_path / "a.bvh", "-o", page, "--force", "--open", "--json")
    assert json.loads(out) == {"schema": "mograft.view/1", "file": str(page), "title": "a"}
    assert opened == [page.as_uri()]
    succeed("view", tmp_path / "a.bvh")
    assert len(opened) == 2
