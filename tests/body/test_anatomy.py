"""Properties of body parts and sides of joints, and tables of naming schemes."""

import re
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Skeleton
from mograft.body.anatomy import anatomy, feature_joints
from mograft.body.joint_names import ARM, LEG, OPPOSITE_SIDE, PARTS
from tests import hierarchies

MARKS = ("%Side", "%side", "%S", "%s", "%_S", "%.S")
LIMBS = {
    "left": ("Left", "left", "L", "l", "_L", ".L"),
    "right": ("Right", "right", "R", "r", "_R", ".R"),
}
# The marks stand for each side in turn; a joint with a mark is doubled, with all below it.
SCHEMES = {
    "motionbuilder": "Hips=pelvis {Spine=trunk > Spine1=trunk {Neck=neck > Head=head"
    " | %SideShoulder=clavicle > %SideArm=upper_arm > %SideForeArm=forearm > %SideHand=hand"
    " {%SideHandThumb1=finger | %SideInHandIndex=finger > %SideHandIndex1=finger}"
    " | }| %SideUpLeg=thigh > %SideLeg=shank > %SideFoot=foot > %SideToeBase=toe}",
    "mixamo": "mixamorig:Hips=pelvis {mixamorig:Spine=trunk {mixamorig:Neck=neck >"
    " mixamorig:Head=head {mixamorig:HeadTop_End=head | mixamorig:%SideEye=head}"
    " | mixamorig:%SideShoulder=clavicle > mixamorig:%SideArm=upper_arm >"
    " mixamorig:%SideForeArm=forearm > mixamorig:%SideHand=hand}"
    " | mixamorig:%SideUpLeg=thigh > mixamorig:%SideLeg=shank > mixamorig:%SideFoot=foot}",
    "mixamo without colon": "mixamorigHips=pelvis {mixamorigSpine=trunk > mixamorigHead=head"
    " | mixamorig%SideUpLeg=thigh > mixamorig%SideLeg=shank"
    " | mixamorig%SideArm=upper_arm > mixamorig%SideForeArm=forearm}",
    "cmu": "Hips=pelvis {%SHipJoint=pelvis > %SideUpLeg=thigh > %SideLeg=shank >"
    " %SideFoot=foot > %SideToeBase=toe | LowerBack=trunk > Spine=trunk {Neck=neck >"
    " Neck1=neck > Head=head | %SideShoulder=clavicle > %SideArm=upper_arm >"
    " %SideForeArm=forearm > %SideHand=hand"
    " {%SideFingerBase=finger > %SideHandIndex1=finger | %SThumb=finger}}}",
    "cmu asf": "root=pelvis {%shipjoint=pelvis > %sfemur=thigh > %stibia=shank > %sfoot=foot >"
    " %stoes=toe | lowerback=trunk > upperback=trunk > thorax=trunk {lowerneck=neck >"
    " upperneck=neck > head=head | %sclavicle=clavicle > %shumerus=upper_arm >"
    " %sradius=forearm > %swrist=hand > %shand=hand {%sfingers=finger | %sthumb=finger}}}",
    "cmu for 3ds max": "Hips=pelvis {%SHipJoint=pelvis > %SideHip=thigh > %SideKnee=shank >"
    " %SideAnkle=foot > %SideToe=toe | lowerback=trunk > Chest=trunk {lowerneck=neck > Head=head"
    " | %SideCollar=clavicle > %SideShoulder=upper_arm > %SideElbow=forearm >"
    " %SideWrist=hand > %shand=hand > %SFingers=finger}}",
    "biped": "Bip01=other > Bip01 Pelvis=pelvis > Bip01 Spine=pelvis {Bip01 %S Thigh=thigh >"
    " Bip01 %S Calf=shank > Bip01 %S Foot=foot > Bip01 %S Toe0=toe"
    " | Bip01 Spine1=trunk > Bip01 Neck=neck {Bip01 Head=head"
    " | Bip01 %S Clavicle=clavicle > Bip01 %S UpperArm=upper_arm > Bip01 %S Forearm=forearm"
    " {Bip01 %S ForeTwist=forearm | Bip01 %S Hand=hand > Bip01 %S Finger0=finger}}}",
    "bandai": "joint_Root=other > Hips=pelvis {Spine=trunk > Chest=trunk {Neck=neck > Head=head"
    " | Shoulder%_S=clavicle > UpperArm%_S=upper_arm > LowerArm%_S=forearm > Hand%_S=hand}"
    " | UpperLeg%_S=thigh > LowerLeg%_S=shank > Foot%_S=foot > Toes%_S=toe}",
    "biovision": "Hips=pelvis {Chest=trunk > Chest4=trunk {Neck=neck > Head=head"
    " | %SideCollar=clavicle > %SideShoulder=upper_arm > %SideElbow=forearm > %SideWrist=hand}"
    " | %SideHip=thigh > %SideKnee=shank > %SideAnkle=foot > %SideToe=toe}",
    "poser": "hip=pelvis {abdomen=trunk > chest=trunk {neck=neck > head=head > %sideEye=head"
    " | %sCollar=clavicle > %sShldr=upper_arm > %sForeArm=forearm > %sHand=hand"
    " {%sThumb1=finger | %sMid1=finger}} | %sButtock=pelvis > %sThigh=thigh > %sShin=shank >"
    " %sFoot=foot}",
    "daz": "hip=pelvis {pelvis=pelvis > %sThighBend=thigh > %sThighTwist=thigh > %sShin=shank >"
    " %sFoot=foot > %sMetatarsals=toe > %sToe=toe > %sSmallToe4=toe > %sSmallToe4_2=toe"
    " | abdomenLower=trunk > chestLower=trunk {chestUpper=trunk {%sCollar=clavicle >"
    " %sShldrBend=upper_arm > %sShldrTwist=upper_arm > %sForearmBend=forearm >"
    " %sForearmTwist=forearm > %sHand=hand > %sCarpal1=finger > %sRing1=finger"
    " | neckLower=neck > head=head {lowerJaw=head > tongue01=head > MidNoseBridge=head"
    " | %sEar=head | %sNasolabialLower=head}} | %sPectoral=trunk}}",
    "games105": "RootJoint=pelvis {%sHip=thigh > %sKnee=shank > %sAnkle=foot > %sToeJoint=toe"
    " | pelvis_lowerback=trunk > lowerback_torso=trunk {torso_head=head"
    " | %sTorso_Clavicle=clavicle > %sShoulder=upper_arm > %sElbow=forearm > %sWrist=hand}}",
    "dfki": "FK_back1_jnt=pelvis {FK_back2_jnt=trunk {head_jnt=head > head_end_jnt=head"
    " | %S_shoulder_jnt=clavicle {%S_shoulderEnd_jnt=clavicle | %S_upArm_jnt=upper_arm >"
    " %S_lowArm_jnt=forearm > %S_hand_jnt=hand {%S_hand_end_jnt=hand | %S_handRoot_jnt=hand >"
    " %S_index_root_jnt=finger > %S_index_mid_jnt=finger > %S_index_end_jnt=finger}}}"
    " | %S_upLeg_jnt=thigh > %S_lowLeg_jnt=shank > %S_foot_jnt=foot > %S_toe_tip_jnt=toe}",
    "makehuman": "root=pelvis {pelvis%.S=pelvis > upperleg01%.S=thigh > upperleg02%.S=thigh >"
    " lowerleg01%.S=shank > foot%.S=foot > metatarsal1%.S=toe > toe1-1%.S=toe"
    " | spine05=trunk > spine01=trunk {clavicle%.S=clavicle > shoulder01%.S=clavicle >"
    " upperarm01%.S=upper_arm > upperarm02%.S=upper_arm > lowerarm01%.S=forearm > wrist%.S=hand"
    " > metacarpal1%.S=finger > finger2-1%.S=finger | neck01=neck > head=head {jaw=head >"
    " special04=head | levator02%.S=head}} | breast%.S=trunk}",
    "makehuman, older": "Root=pelvis {Spine1=trunk {Neck=neck > Head=head > __Jaw=head"
    " | __Clavicle%_S=clavicle > Clavicle%_S=clavicle > UpArm%_S=upper_arm > LoArm%_S=forearm >"
    " Hand%_S=hand > __Thumb1%_S=finger} | Hips=pelvis > UpLeg%_S=thigh > LoLeg%_S=shank >"
    " Foot%_S=foot > Toe%_S=toe}",
    "mass": "Character1_Hips=pelvis {Character1_Spine=trunk {Character1_%SideShoulder=clavicle"
    " {Character1_%SideArm=upper_arm {Character1_%SideForeArm=forearm"
    " {Character1_%SideHand=hand | %S_Radius_RIGMESH=forearm} | %S_Humerus_RIGMESH=upper_arm}"
    " | %S_Shoulder_RIGMESH=clavicle} | Character1_Head=head | Torso_RIGMESH=trunk}"
    " | Character1_%SideUpLeg=thigh {Character1_%SideLeg=shank {Character1_%SideFoot=foot"
    " {Character1_%SideToeBase=toe | %S_Talus_RIGMESH=foot} | %S_Tibia_RIGMESH=shank}"
    " | %S_Femur_RIGMESH=thigh} | Pelvis_RIGMESH=pelvis}",
    "biovision with markers": "Hips=pelvis {%SideHip=thigh {%SideKnee=shank > %SideAnkle=foot"
    " | %S_Femur_RIGMESH=thigh} | Chest=trunk > %SideCollar=clavicle > %SideShoulder=upper_arm"
    " {%SideElbow=forearm > %SideWrist=hand | %S_Humerus_RIGMESH=upper_arm}}",
    "vertebrae": "Pelvis=pelvis {J_%S_Hip=thigh > J_%S_Knee=shank > J_%S_Ankle=foot >"
    " J_%S_Bale=toe | J_L5=trunk > J_L1=trunk > J_T12=trunk > J_T1=trunk {J_C7=neck > J_C1=neck >"
    " J_Atlas=head | J_%S_Clavicle=clavicle > J_%S_Shoulder=upper_arm > J_%S_Elbow=forearm >"
    " J_%S_Hand=hand}}",
    "rolls": "Hips=pelvis {Spine=trunk {Neck=neck | %SideShoulder=clavicle > %SideArm=upper_arm >"
    " %SideArmRoll=upper_arm > %SideForeArm=forearm > %SideForeArmRoll=forearm >"
    " %SideHand=hand} | %SideUpLeg=thigh > %SideUpLegRoll=thigh > %SideLeg=shank >"
    " %SideLegRoll=shank > %SideFoot=foot > %SideFootPinky1=toe}",
    "ends of bones": "Hips=pelvis {Spine=trunk {Head=head > HeadEnd=head"
    " | %SideShoulder=clavicle > %SideArm=upper_arm > %SideForeArm=forearm"
    " {%SideHand=hand {%SideHandThumb1=finger | %SideForeArmEnd=hand} | %SideArmEnd=forearm}}"
    " | %SideUpLeg=thigh > %SideLeg=shank {%SideFoot=foot {%SideToeBase=toe >"
    " %SideToeBaseEnd=toe | %SideLegEnd=foot} | %SideUpLegEnd=shank}}",
    "woddy": "Hips=pelvis {Spine=trunk {HEad=head | %SideShoulder1=clavicle >"
    " %SideArm=upper_arm > %SideForeArm=forearm} | %SideUpLeg=thigh > %SideLeg=shank}",
    "unreal": "root=other {pelvis=pelvis {spine_01=trunk {neck_01=neck > head=head"
    " | clavicle_%s=clavicle > upperarm_%s=upper_arm {upperarm_twist_01_%s=upper_arm"
    " | lowerarm_%s=forearm > hand_%s=hand > middle_01_%s=finger}}"
    " | thigh_%s=thigh > calf_%s=shank > foot_%s=foot > ball_%s=toe}"
    " | ik_foot_root=other > ik_foot_%s=other}",
    "smpl": "Pelvis=pelvis {%S_Hip=thigh > %S_Knee=shank > %S_Ankle=foot > %S_Foot=toe"
    " | Spine1=trunk {Neck=neck > Head=head | %S_Collar=clavicle > %S_Shoulder=upper_arm >"
    " %S_Elbow=forearm > %S_Wrist=hand > %S_Hand=hand}}",
    "kinect": "SpineBase=pelvis {SpineMid=trunk > SpineShoulder=trunk {Neck=neck > Head=head"
    " | Shoulder%Side=upper_arm > Elbow%Side=forearm > Wrist%Side=hand > HandTip%Side=hand"
    " > Thumb%Side=finger} | Hip%Side=thigh > Knee%Side=shank > Ankle%Side=foot"
    " > Foot%Side=toe}",
    "rigify": "DEF-spine=pelvis {DEF-thigh%.S=thigh > DEF-shin%.S=shank > DEF-foot%.S=foot >"
    " DEF-toe%.S=toe | DEF-spine.001=trunk > DEF-spine.003=trunk {DEF-shoulder%.S=clavicle >"
    " DEF-upper_arm%.S=upper_arm > DEF-forearm%.S=forearm > DEF-hand%.S=hand"
    " | DEF-spine.004=neck > DEF-spine.005=neck > DEF-spine.006=head}}",
    "quadruped": "Pelvis=pelvis {Spine1=trunk > Chest=trunk {Neck=neck > Head=head > Jaw=head"
    " | Scapula%_S=clavicle > Humerus%_S=upper_arm > Radius%_S=forearm > Carpus%_S=hand >"
    " ForePaw%_S=finger} | Tail1=tail > Tail2=tail"
    " | Femur%_S=thigh > Tibia%_S=shank > Tarsus%_S=foot > HindPaw%_S=toe}",
    "one unknown word": "Hips=pelvis {Gizmo=pelvis > %SideUpLeg=thigh > %SideQwx=thigh >"
    " %SideLeg=shank > %SideFoot=foot > %SideSole=toe"
    " | Spine=trunk {Zzz=trunk > Head=head > Hat=head | %SideArm=upper_arm > %SideHand=hand >"
    " %SideBlob=finger}}",
    "legs of one word": "Hips=pelvis {%SideLeg=thigh > %SideLegTwist=thigh > %SideKnee=shank"
    " | Spine=trunk > %SideArm=upper_arm}",
}


@cache
def scheme(name):
    """Return the skeleton of a scheme with the part and the side of each joint."""
    single, notes = hierarchies.skeleton_from_text(SCHEMES[name])
    names, parents, parts, sides, places = [], [], [], [], []
    for text, parent, (part,) in zip(single.names, single.parents, notes, strict=True):
        above = places[parent] if parent >= 0 else {"": -1}
        places.append({})
        for side in LIMBS if "%" in text or "left" in above else [""]:
            own = text
            for mark, word in zip(MARKS, LIMBS.get(side, MARKS), strict=True):
                own = own.replace(mark, word)
            places[-1][side] = len(names)
            names.append(own)
            parents.append(above[side if side in above else ""])
            parts.append(part)
            sides.append(side)
    return Skeleton(names, parents, np.zeros((len(names), 3))), parts, sides


@pytest.mark.parametrize("name", SCHEMES)
def test_anatomy_known_naming_schemes_give_expected_parts_and_sides(name):
    skeleton, parts, sides = scheme(name)
    found = anatomy(skeleton)
    actual = dict(zip(skeleton.names, found.parts, strict=True))
    assert actual == dict(zip(skeleton.names, parts, strict=True))
    actual = dict(zip(skeleton.names, found.sides, strict=True))
    assert actual == dict(zip(skeleton.names, sides, strict=True))


DECORATIONS = {
    "namespace": lambda name: f"LeftHand:{name.split(':')[-1]}",
    "path": lambda name: f"|Head|{name}",
    "prefix": lambda name: f"Fred_{name}",
    "suffix": lambda name: f"Fred-{name}-rig",
}
CASES = {"upper": str.upper, "lower": str.lower, "title": str.title}
CASE_SCHEMES = ("motionbuilder", "cmu", "bandai", "biovision", "biped", "makehuman", "games105")
VARIANTS = [(own, name) for own in DECORATIONS for name in SCHEMES]
VARIANTS += [(own, name) for own in CASES for name in CASE_SCHEMES]


@pytest.mark.parametrize(("variant", "name"), VARIANTS)
def test_anatomy_ignores_namespace_prefix_suffix_and_case(variant, name):
    skeleton, parts, sides = scheme(name)
    change = (DECORATIONS | CASES)[variant]
    other = anatomy(hierarchies.with_names(skeleton, lambda _, joint_name: change(joint_name)))
    assert list(other.parts) == parts
    limbs = [joint for joint, part in enumerate(parts) if part in ARM + LEG]
    assert [other.sides[joint] for joint in limbs] == [sides[joint] for joint in limbs]


def test_anatomy_unknown_names_use_symmetry():
    skeleton = hierarchies.human()
    by_names = anatomy(skeleton)
    by_structure = anatomy(hierarchies.without_names(skeleton))
    assert by_structure.parts == by_names.parts
    assert by_structure.sides == by_names.sides
    assert not by_structure.human
    assert by_structure.unmatched == tuple(range(skeleton.n_joints))
    # Sides follow from the direction of the feet.
    unnamed = hierarchies.without_names(skeleton)
    mirrored = anatomy(unnamed.with_offsets(unnamed.offsets * [-1, 1, 1]))
    assert mirrored.sides == tuple(OPPOSITE_SIDE[side] for side in by_structure.sides)


@given(st.integers(0, 2), st.integers(0, 2))
def test_anatomy_unknown_names_ignore_orientation(turns, more):
    unnamed = hierarchies.without_names(hierarchies.human())
    cycled = np.roll(unnamed.offsets, turns, axis=1)  # an even permutation is a rotation
    sites = [type(s)(s.parent, np.roll(s.offset, turns)) for s in unnamed.end_sites]
    turned = Skeleton(unnamed.names, unnamed.parents, cycled * (1 + more), end_sites=sites)
    assert anatomy(turned).parts == anatomy(unnamed).parts
    assert anatomy(turned).sides == anatomy(unnamed).sides


@pytest.mark.parametrize("mirror", [1, -1])
def test_anatomy_named_legs_or_arms_complete_the_other_pair(mirror):
    """Legs with unknown names are found by symmetry; their sides follow from the named arms."""
    words = {"Hip": "Pata", "Knee": "Jarrete", "Ankle": "Casco"}
    skeleton = hierarchies.with_names(
        hierarchies.human(),
        lambda j, own: next((f"{w}{j}" for k, w in words.items() if k in own[4:]), own),
    )
    found = anatomy(skeleton.with_offsets(skeleton.offsets * [mirror, 1, 1]))
    assert found.parts == anatomy(hierarchies.human()).parts
    assert found.sides == anatomy(hierarchies.human()).sides


@given(st.data())
def test_anatomy_ignores_joint_order(data):
    unnamed = hierarchies.without_names(hierarchies.human())
    named = [scheme(name)[0] for name in ("daz", "mass")]
    skeleton = data.draw(st.sampled_from([hierarchies.human(), unnamed, *named]))
    order = data.draw(hierarchies.orders(skeleton))
    before, after = anatomy(skeleton), anatomy(hierarchies.with_order(skeleton, order))
    assert after.parts == tuple(before.parts[joint] for joint in order)
    assert after.sides == tuple(before.sides[joint] for joint in order)
    assert order[after.hips] == before.hips


@given(hierarchies.skeletons() | hierarchies.skeletons(names=st.text(max_size=12)))
def test_anatomy_every_joint_has_a_part(skeleton):
    found = anatomy(skeleton)
    assert len(found.parts) == len(found.sides) == skeleton.n_joints
    assert set(found.parts) <= set(PARTS)
    assert set(found.sides) <= {"left", "right", ""}
    for joint, part in enumerate(found.parts):  # only dummies hang above the hips
        if part in LEG:
            parent = int(skeleton.parents[joint])
            while parent >= 0:
                assert found.parts[parent] in (*LEG, "pelvis", "other")
                parent = int(skeleton.parents[parent])


def test_anatomy_numbered_names_are_not_vertebrae():
    skeleton = hierarchies.with_names(hierarchies.human(), lambda joint, _: f"c{joint}")
    assert anatomy(skeleton).unmatched == tuple(range(skeleton.n_joints))


@pytest.mark.parametrize(
    ("name", "excluded"),
    [
        ("dfki", "toe|index|[eE]nd_"),
        ("mass", "RIGMESH|Toe"),
        ("daz", "Toe|Metatarsal|Carpal|Ring|Jaw|tongue|Nose|Ear|Nasolabial|Pectoral"),
    ],
)
def test_feature_joints_exclude_fingers_toes_faces_and_markers(name, excluded):
    skeleton, _, _ = scheme(name)
    joints = feature_joints(skeleton, range(skeleton.n_joints))
    names = [own for own in skeleton.names if not re.search(excluded, own)]
    assert [skeleton.names[joint] for joint in joints] == names
    others = np.setdiff1d(np.arange(skeleton.n_joints), joints)
    assert feature_joints(skeleton, others).tolist() == others.tolist()


@hierarchies.each_recording()
def test_anatomy_recordings_agree_with_and_without_names(path):
    skeleton = hierarchies.read_hierarchy(path)
    lower = [
        [part in (*LEG, "pelvis", "other", "tail") for part in anatomy(named).parts]
        for named in (skeleton, hierarchies.without_names(skeleton))
    ]
    assert lower[0] == lower[1] or skeleton.n_joints < 5
