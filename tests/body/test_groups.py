"""Properties of joint groups and their TOML files, and the presets on recordings."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import JointGroups, subtree
from mograft.body.anatomy import anatomy
from mograft.body.groups import PRESETS
from tests import hierarchies


def names_of(skeleton, joints):
    return [skeleton.names[joint] for joint in joints]


def small_skeleton():
    return hierarchies.skeleton_from_text("Hips {Spine > Head | LeftLeg > LeftFoot | RightLeg}")[0]


# Presets that need parts which a skeleton does not have.
MISSING_PARTS = {
    "skel_pybvh/full_precision_frame_time": {
        "lower_upper": "legs",
        "lower_torso_arms": "legs and arms",
        "lower_torso_larm_rarm": "legs and left arm and right arm",
        "lower_torso_head_larm_rarm": "legs and torso and left arm and right arm",
    },
    "skel_pybvh/rotation_first_root": {
        "lower_torso_arms": "arms",
        "lower_torso_larm_rarm": "left arm and right arm",
        "lower_torso_head_larm_rarm": "left arm and right arm",
    },
    "skel_snu_wd2/wd2_spiral_walk_slow02": {"lower_torso_head_larm_rarm": "neck or head"},
}


def test_preset_of_human_has_expected_joints():
    skeleton = hierarchies.human()
    arm = ["Collar", "Shoulder", "Elbow", "Wrist"]
    left, right = [f"Left{part}" for part in arm], [f"Right{part}" for part in arm]
    expected = {
        "lower_upper": [["Chest", "Neck", "Head", *left, *right]],
        "lower_torso_arms": [["Chest", "Neck", "Head"], left + right],
        "lower_torso_larm_rarm": [["Chest", "Neck", "Head"], left, right],
        "lower_torso_head_larm_rarm": [["Chest"], ["Neck", "Head"], left, right],
    }
    for preset, expected_names in expected.items():
        groups = JointGroups.preset(preset, skeleton)
        found = groups.resolve(skeleton)
        assert "_".join(found) == preset
        assert groups.base == "lower"
        upper = [sorted(names_of(skeleton, joints)) for joints in list(found.values())[1:]]
        assert upper == [sorted(names) for names in expected_names]


def check_preset(skeleton, preset):
    """A preset has every joint once and an arm of one side on one joint, or names missing parts.

    Return the names of the missing parts.
    """
    body = anatomy(skeleton)
    try:
        groups = JointGroups.preset(preset, skeleton)
    except ValueError as error:
        missing = re.search("needs (.*), found none", str(error))[1]
        assert ("legs" in missing) == (not body.joints("thigh", "shank", "foot"))
        return missing
    found = groups.resolve(skeleton)
    assert sorted(np.concatenate(list(found.values()))) == list(range(skeleton.n_joints))
    assert "_".join(found) == preset
    assert all((np.diff(joints) > 0).all() and len(joints) for joints in found.values())
    assert 0 in found["lower"]
    for side, group in (("left", "larm"), ("right", "rarm")):
        if group in found:
            assert {body.sides[joint] for joint in found[group]} == {side}
            tops = {int(skeleton.parents[joint]) for joint in found[group]} - {*found[group]}
            assert len(tops) == 1  # an arm hangs on one joint
    return None


@given(hierarchies.skeletons(), st.sampled_from(sorted(PRESETS)))
def test_presets_of_any_skeleton_are_disjoint_and_complete(skeleton, preset):
    check_preset(skeleton, preset)


@hierarchies.each_recording()
def test_presets_of_recordings_are_disjoint_and_complete(path):
    for preset in PRESETS:
        missing = check_preset(hierarchies.read_hierarchy(path), preset)
        assert missing == MISSING_PARTS.get(hierarchies.clip_name(path), {}).get(preset)


@given(hierarchies.skeletons(names=st.text(st.characters(), max_size=6)), st.data())
def test_groups_toml_round_trips(skeleton, data):
    indices = data.draw(st.lists(st.sampled_from(range(skeleton.n_joints)), min_size=1))
    text = st.text(st.characters(exclude_categories=["Cs"]), max_size=6)
    groups = JointGroups(
        {
            data.draw(text): indices,
            "ü\\ü\x7f\n": [subtree(0), "a", subtree(data.draw(text)), data.draw(text)],
            data.draw(text) + "!": [name for name in skeleton.names if _encodes(name)] or [0],
        },
        base="ü\\ü\x7f\n",
    )
    written_text = groups.to_toml()
    assert JointGroups.from_toml(written_text) == groups
    assert written_text.encode().decode() == written_text


def _encodes(name):
    return not any("\ud800" <= letter <= "\udfff" for letter in name)


def test_preset_duplicate_names_use_indices():
    skeleton = hierarchies.with_names(
        hierarchies.human(), lambda _, own: "Head" if own in ("Head", "LeftAnkle") else own
    )
    groups = JointGroups.preset("lower_torso_head_larm_rarm", skeleton)
    found = JointGroups.from_toml(groups.to_toml()).resolve(skeleton)
    ankle, head = (joint for joint, name in enumerate(skeleton.names) if name == "Head")
    assert ankle in found["lower"]
    assert head in found["head"]


def test_preset_markers_belong_to_group_of_parent():
    skeleton, _ = hierarchies.skeleton_from_text(
        "joint_Root {Prop | Hips {LeftUpLeg {LeftLeg | Sticker} | Spine {Gadget | Tail |"
        " LeftArm > Watch}}}"
    )
    found = JointGroups.preset("lower_torso_arms", skeleton).resolve(skeleton)
    assert {name: names_of(skeleton, joints) for name, joints in found.items()} == {
        "lower": ["joint_Root", "Prop", "Hips", "LeftUpLeg", "LeftLeg", "Sticker"],
        "torso": ["Spine", "Gadget", "Tail"],
        "arms": ["LeftArm", "Watch"],
    }


def test_groups_accept_names_globs_indices_and_subtrees():
    groups = JointGroups(
        {"feet": ["*Foot", 5], "lower": ["Hips", "LeftLeg"], "upper": [subtree("Sp?ne")]}
    )
    found = groups.resolve(small_skeleton())
    expected = {"feet": [4, 5], "lower": [0, 3], "upper": [1, 2]}
    assert {name: joints.tolist() for name, joints in found.items()} == expected
    assert found["feet"].dtype == np.int64
    assert groups.names == ("feet", "lower", "upper")
    assert repr(groups) == (
        "JointGroups(feet: *Foot 5; lower: Hips LeftLeg; upper: subtree('Sp?ne'); base lower)"
    )


def test_resolve_invalid_entry_names_it():
    legs = ["Hips", "LeftLeg", "LeftFoot", "RightLeg"]
    for lower, upper, message in (
        (legs, ["Spin", "Head"], "'upper': no joint is named 'Spin'; did you mean 'Spine'"),
        (["Hips"], ["*Wing*"], r"no joint is named '\*Wing\*'; joints are Hips, Spine, Head, Le"),
        (
            [subtree("Hips")],
            [subtree("Spine")],
            "joint Spine must be in one group, got 'lower' and 'upper'",
        ),
        (["Hips"], [subtree("Spine")], "got none for LeftLeg, LeftFoot, RightLeg"),
        (["Hips", 6], ["Spine"], "'lower': joint index must be 0 to 5, got 6"),
        ([subtree("Tail")], ["Spine"], "no joint is named 'Tail'"),
    ):
        with pytest.raises(ValueError, match=message):
            JointGroups({"lower": lower, "upper": upper}).resolve(small_skeleton())


def test_groups_invalid_arguments_raise():
    for groups, base, message in (
        ({"lower": ["a"]}, "lower", r"at least two entries, a base.*got \['lower'\]"),
        ({"lower": ["a"], "upper": []}, "lower", "'upper' must have at least one"),
        ({"legs": ["a"], "arms": ["b"]}, "lower", "`base` must be one of legs, arms"),
        ({"a": ["x"], "b": ["y"]}, ["a"], r"`base` must be one of a, b, got \['a'\]"),
        ({"lower": "Hips", "upper": ["b"]}, "lower", "'lower' must be a list"),
        ({"lower": [1.5], "upper": ["b"]}, "lower", "'lower' must contain names.*1.5"),
        ({"lower": [True], "upper": ["b"]}, "lower", "must contain names"),
        ({1: ["a"], "lower": ["b"]}, "lower", "group names must be str, got 1"),
        (["a", "b"], "lower", "`groups` must map group names to joints"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            JointGroups(groups, base=base)


def test_groups_entry_types_are_checked():
    groups = JointGroups({"lower": np.array([0, 1]), "upper": [2]})
    assert groups.to_toml().count("    0,") == 1
    assert subtree(np.int64(1)) == subtree(1)
    with pytest.raises(TypeError, match=r"`joint` must be a name or an index, got \['Spine'\]"):
        subtree(["Spine"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("base = \n", "groups: not valid TOML: .*line 1"),
        ('base = "a"\n', r"must contain a table \[groups\].*got base"),
        ('speed = 1\n[groups]\na = ["x"]\n', r"must contain a table \[groups\].*got speed, groups"),
        (
            '[groups]\na = "x"\nlower = ["b"]\n',
            "groups: group 'a' must be a list of joints, got 'x'",
        ),
        ('[groups]\na = [1.5]\nlower = ["b"]\n', "group 'a' must contain names, indices or"),
        ('[groups]\na = [{subtree = true}]\nlower = ["b"]\n', "group 'a' must contain names"),
        ('[groups]\nlower = ["b"]\n', "groups: `groups` must have at least two"),
        ('base = ["b"]\n[groups]\na = ["b"]\nb = ["c"]\n', r"`base` must be one of.*got \['b'\]"),
    ],
)
def test_from_toml_invalid_text_raises_value_error(text, message):
    with pytest.raises(ValueError, match=message):
        JointGroups.from_toml(text)


def test_from_toml_errors_name_the_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\n")
    with pytest.raises(ValueError, match=r"mine\.toml: not UTF-8"):
        JointGroups.from_toml(path)
    with pytest.raises(FileNotFoundError):
        JointGroups.from_toml(tmp_path / "none.toml")


@pytest.mark.parametrize("name", ["upper_lower", ["lower_upper"]])
def test_preset_unknown_name_raises_value_error(name):
    message = f"`preset` must be one of lower_upper, .*got {re.escape(repr(name))}"
    with pytest.raises(ValueError, match=message):
        JointGroups.preset(name, hierarchies.human())
