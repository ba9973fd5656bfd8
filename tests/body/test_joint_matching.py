"""Joints of published skeletons matched by anatomy."""

import numpy as np
import pytest

import mograft as mg
from mograft.body.joint_matching import match_joints
from mograft.dancer import dance
from mograft.io.kimodo import SKELETONS
from mograft.io.smpl.body_models import MODELS, stand_in
from tests.hierarchies import human, skeleton_from_text

CMU = (
    "Hips {LHipJoint > LeftUpLeg > LeftLeg > LeftFoot > LeftToeBase"
    " | RHipJoint > RightUpLeg > RightLeg > RightFoot > RightToeBase"
    " | LowerBack > Spine > Spine1 {Neck > Neck1 > Head"
    " | LeftShoulder > LeftArm > LeftForeArm > LeftHand {LeftFingerBase > LeftHandIndex1 | LThumb}"
    " | RightShoulder > RightArm > RightForeArm > RightHand"
    " {RightFingerBase > RightHandIndex1 | RThumb}}}"
)


def published_skeletons():
    """Skeletons whose joints have published names."""
    skeletons = {"CMU": skeleton_from_text(CMU)[0], "human": human()}
    skeletons |= {"dance": dance(strides=1).motion.skeleton}
    skeletons |= {model.name: stand_in(model) for model in MODELS}
    return skeletons | {
        f"Kimodo {n}": mg.Skeleton(k.joints, k.parents, np.ones((n, 3)))
        for n, k in SKELETONS.items()
        if k.name != "G1"
    }


SKELETONS_BY_NAME = published_skeletons()


def pairs(skeleton, other):
    sources = enumerate(match_joints(skeleton, other).sources.tolist())
    return {skeleton.names[joint]: other.names[own] for joint, own in sources if own >= 0}


@pytest.mark.parametrize("other", SKELETONS_BY_NAME)
@pytest.mark.parametrize("name", SKELETONS_BY_NAME)
def test_match_joints_is_symmetric_and_keeps_ancestry(name, other):
    first, second = SKELETONS_BY_NAME[name], SKELETONS_BY_NAME[other]
    match = match_joints(first, second)
    found = pairs(first, second)
    assert found == {own: theirs for theirs, own in pairs(second, first).items()}
    if name == other:  # CMU: base joints of fingers of no named kind
        assert len(found) >= first.n_joints - 2
        assert all(own == theirs for own, theirs in found.items())
    assert {*match.absent} == {*first.names} - {*found}
    assert {*match.dropped} == {*second.names} - {*found.values()}
    for joint, source in enumerate(match.sources.tolist()):
        for above in first.ancestors(joint):
            if source >= 0 and match.sources[above] >= 0:
                assert match.sources[above] in second.ancestors(source)


@pytest.mark.parametrize(
    ("name", "other", "expected"),
    [
        (
            "SMPL-H",
            "Kimodo 77",
            "pelvis=Hips spine1=Spine1 spine2=Spine2 spine3=Chest neck=Neck2 head=Head"
            " left_collar=LeftShoulder left_shoulder=LeftArm left_elbow=LeftForeArm"
            " right_wrist=RightHand left_hip=LeftLeg left_knee=LeftShin right_ankle=RightFoot"
            " right_foot=RightToeBase left_thumb1=LeftHandThumb1 right_pinky3=RightHandPinkyEnd",
        ),
        (
            "CMU",
            "SMPL-X",
            "Hips=pelvis LeftUpLeg=left_hip RightLeg=right_knee LeftToeBase=left_foot"
            " LowerBack=spine1 Spine=spine2 Spine1=spine3 Neck1=neck Head=head"
            " RightShoulder=right_collar LeftArm=left_shoulder RightForeArm=right_elbow"
            " LeftHand=left_wrist LThumb=left_thumb1 RightHandIndex1=right_index1",
        ),
        ("SMPL-X", "Kimodo 30", "jaw=Jaw left_eye_smplhf=LeftEye right_eye_smplhf=RightEye"),
    ],
)
def test_match_joints_published_names_give_expected_pairs(name, other, expected):
    found = pairs(SKELETONS_BY_NAME[name], SKELETONS_BY_NAME[other])
    for pair in expected.split():
        own, theirs = pair.split("=")
        assert found.get(own) == theirs


def test_match_joints_never_reverses_ancestry():
    foot = "{S}Leg {{S}Foot | {S}ToeBase}"  # a toe beside the foot, not below it
    legs = " | ".join(f"{side}UpLeg > {foot.replace('{S}', side)}" for side in ("Left", "Right"))
    arms = " | ".join(f"{side}Arm > {side}ForeArm > {side}Hand" for side in ("Left", "Right"))
    other, _ = skeleton_from_text(f"Hips {{{legs} | Spine {{Head | {arms}}}}}")
    found = pairs(SKELETONS_BY_NAME["Kimodo 30"], other)
    assert found["LeftFoot"] == "LeftFoot"
    assert "LeftToeBase" not in found


def test_match_joints_describe_lists_absent_and_dropped_joints():
    match = match_joints(SKELETONS_BY_NAME["SMPL"], SKELETONS_BY_NAME["CMU"])
    assert match.describe() == (
        "kept at rest: left_hand, right_hand; dropped: LHipJoint, RHipJoint, Neck, "
        "LeftFingerBase, LeftHandIndex1, LThumb, RightFingerBase, RightHandIndex1, RThumb"
    )
    same = match_joints(SKELETONS_BY_NAME["SMPL"], SKELETONS_BY_NAME["SMPL"])
    assert same.describe() == ""


def test_match_joints_other_figure_raises_skeleton_mismatch_error():
    message = r"a\.glb cannot be matched by anatomy: .* no joints that correspond to "
    for text, missing in (
        ("root > a > b", "left_hip, right_hip"),
        ("Hips {LeftUpLeg > LeftLeg > LeftFoot | Spine > Head}", "right_hip"),
    ):
        with pytest.raises(mg.SkeletonMismatchError, match=message + missing):
            match_joints(SKELETONS_BY_NAME["SMPL"], skeleton_from_text(text)[0], "a.glb")
