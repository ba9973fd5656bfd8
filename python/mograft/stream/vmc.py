"""Figures in the Virtual Motion Capture protocol: the bones of Unity's humanoid in one packet.

VMC has metres, y up and left-handed axes, in which a figure at rest faces +z. Rotations are
relative to a T-pose in which those of all bones are zero. Positions are relative to the parent.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import anatomy, root_carriers
from mograft.body.joint_matching import match_joints
from mograft.io.export_figure import ExportTransform
from mograft.io.smpl.body_models import SMPL_X, stand_in
from mograft.library.spec import align_rest_poses
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.stream.osc import Message, encode_bundle

Place: TypeAlias = tuple[float, ...]
"""Position and rotation of a bone relative to its parent: x, y, z, qx, qy, qz, qw."""

HUMANOID = stand_in(SMPL_X)
"""A figure in T-pose with all bones of Unity's humanoid; y is up, and it faces +z."""

ROOT = "root"
"""Name of the place of the whole figure; no bone has it."""

_BODY = {
    **{"pelvis": "Hips", "spine1": "Spine", "spine2": "Chest", "spine3": "UpperChest"},
    **{"neck": "Neck", "head": "Head", "jaw": "Jaw"},
}
_SIDED = {
    **{"hip": "UpperLeg", "knee": "LowerLeg", "ankle": "Foot", "foot": "Toes", "eye": "Eye"},
    **{"collar": "Shoulder", "shoulder": "UpperArm", "elbow": "LowerArm", "wrist": "Hand"},
    **{
        f"{finger}{number}": f"{'Little' if finger == 'pinky' else finger.title()}{name}"
        for finger in ("thumb", "index", "middle", "ring", "pinky")
        for number, name in enumerate(("Proximal", "Intermediate", "Distal"), start=1)
    },
}
_TRUNK = ("Spine", "Chest", "UpperChest")


def _bone_name(joint: str) -> str:
    side, _, part = joint.removesuffix("_smplhf").partition("_")
    return _BODY[joint] if joint in _BODY else f"{side.title()}{_SIDED[part]}"


BONES = tuple(map(_bone_name, HUMANOID.names))
"""The bone of each joint of `HUMANOID`."""

_MIRROR = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
"""Factors between right-handed and left-handed positions and rotations, for x."""

_PLACES = ("/VMC/Ext/Bone/Pos", "/VMC/Ext/Root/Pos")
_MAX_NORM_ERROR = 0.01  # difference from 1 of the norm of a rotation, which is then normalised

_NO_PLACE: Place = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class Figure:
    """How the joints of a skeleton correspond to bones; `motion` shows which direction is up."""

    def __init__(self, motion: Motion) -> None:
        self.skeleton = skeleton = motion.skeleton
        self._transform = ExportTransform.of(motion, None)
        sources = match_joints(HUMANOID, skeleton, motion.name or "the motion").sources
        alignment = align_rest_poses(HUMANOID, skeleton, sources)
        self._matched: IntArray = np.flatnonzero(sources >= 0)
        self._joints, self._alignment = sources[self._matched], alignment[self._matched]
        self.bones = [BONES[own] for own in self._matched]
        # Unity needs a spine; upper chest and chest are optional.
        trunk = [index for index, name in enumerate(self.bones) if name in _TRUNK]
        for index, name in zip(trunk, _TRUNK, strict=False):
            self.bones[index] = name
        rows = {int(own): row for row, own in enumerate(self._matched)}
        above = ((a for a in HUMANOID.ancestors(own) if a in rows) for own in rows)
        self._parents = [rows.get(next(own, -1), -1) for own in above]
        self._hips = self._joints[self.bones.index("Hips")]
        self._carrier = ([-1, *root_carriers(skeleton)])[-1]  # it moves the whole figure

    @property
    def absent(self) -> list[str]:
        """The bones that the skeleton lacks, without fingers and face."""
        body = (own for own in BONES if not own.endswith(("al", "Intermediate", "Jaw", "Eye")))
        return [own for own in body if own not in self.bones]

    def packets(self, motion: Motion, first: float, step: float) -> Iterator[bytes]:
        """Yield a packet for each frame of a motion; `first` is its time and `step` its length."""
        turn, figure = self._transform.to_y_up, self._alignment[self.bones.index("Hips")]
        for frames, quats, points in motion.world_blocks():
            world = rotations.multiply(turn, quats)
            places = self._transform.points(points)
            root_turn = np.tile(rotations.IDENTITY, (len(world), 1))
            root = np.zeros((len(world), 3))
            if self._carrier >= 0:
                root_turn = rotations.multiply(world[:, self._carrier], figure)
                root = places[:, self._carrier]
            turns = rotations.multiply(world[:, self._joints], self._alignment)
            own = {ROOT: _to_unity(root_turn, root)}
            for row, (bone, joint) in enumerate(zip(self.bones, self._joints, strict=True)):
                parent = self._parents[row]
                above = root_turn if parent < 0 else turns[:, parent]
                origin = root if parent < 0 else places[:, self._joints[parent]]
                back = rotations.inverse(above)
                offset = rotations.rotate(back, places[:, joint] - origin)
                own[bone] = _to_unity(rotations.multiply(back, turns[:, row]), offset)
            columns = {name: values.tolist() for name, values in own.items()}
            for index in range(len(world)):
                at = first + step * (frames.start + index)
                yield encode_bundle(_messages(at, {k: v[index] for k, v in columns.items()}))

    def pose(
        self, bones: Mapping[str, Place], leg: float | None, root: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return the rotations of all joints and the position of the joint `root` in a pose.

        `leg` is the length of the sender's leg, by which positions are scaled; None if unknown.
        """
        skeleton = self.skeleton
        turns = np.empty((HUMANOID.n_joints, 4))
        base = np.array(bones.get(ROOT, _NO_PLACE)) * _MIRROR
        for joint, (bone, parent) in enumerate(zip(BONES, HUMANOID.parents, strict=True)):
            own = np.array(bones.get(bone, _NO_PLACE)[3:]) * _MIRROR[3:]
            turns[joint] = rotations.multiply(base[3:] if parent < 0 else turns[parent], own)
        hips = np.array(bones["Hips"][:3]) * _MIRROR[:3]
        place = base[:3] + rotations.rotate(base[3:], hips)
        back = rotations.inverse(self._transform.to_y_up)
        scale = self._transform.scale if leg is None else leg / self.leg_length()
        place = rotations.rotate(back, place) / scale
        matched = rotations.multiply(turns[self._matched], rotations.inverse(self._alignment))
        world = dict(zip(self._joints.tolist(), rotations.multiply(back, matched), strict=True))
        quats = np.tile(rotations.IDENTITY, (skeleton.n_joints, 1))
        for joint, above in enumerate(skeleton.parents.tolist()):
            parent = world[above] if above >= 0 else rotations.IDENTITY
            # A joint without a bone follows its parent; those above the hips do not turn.
            world.setdefault(joint, parent)
            quats[joint] = rotations.multiply(rotations.inverse(parent), world[joint])
        chain = [int(self._hips), *skeleton.ancestors(int(self._hips))]
        others = [joint for joint in chain if joint != root]
        return quats, place - skeleton.offsets[others].sum(axis=0)

    def leg_length(self) -> float:
        """Return the length of the left leg of the skeleton in its unit."""
        legs = anatomy(self.skeleton), self.skeleton.rest_positions()
        ends = [legs[0].joints(part, side="left")[0] for part in ("thigh", "shank", "foot")]
        points = legs[1][ends]
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def leg_length(bones: Mapping[str, Place]) -> float | None:
    """Return the length of the left leg of a sender in metres; None if it sends no positions."""
    parts = [np.linalg.norm(bones.get(f"Left{own}", _NO_PLACE)[:3]) for own in ("LowerLeg", "Foot")]
    return float(sum(parts)) if min(parts) > 0.01 else None


def read_bones(messages: Sequence[Message]) -> tuple[dict[str, Place], float | None, int]:
    """Return the places of bones and the time in messages, and the number of invalid ones.

    Messages with other addresses, such as those of faces and cameras, have no effect.
    """
    bones, time, n_invalid = dict[str, Place](), None, 0
    for address, arguments in messages:
        given = arguments[1:8] if address in _PLACES else arguments[:1]
        numbers = [own for own in given if not isinstance(own, str) and abs(own) < 1e6]
        if address == "/VMC/Ext/T" and numbers:
            time = float(numbers[0])
        elif address in _PLACES:
            is_root = address == _PLACES[1]
            name = ROOT if is_root else arguments[0] if arguments else None
            length = float(np.linalg.norm(numbers[3:])) if len(numbers) == 7 else 0.0
            if not (is_root or name in BONES) or abs(length - 1.0) > _MAX_NORM_ERROR:
                n_invalid += 1
                continue
            turn = (own / length for own in numbers[3:])
            bones[str(name)] = (*map(float, numbers[:3]), *turn)
    return bones, time, n_invalid


def _to_unity(turns: FloatArray, points: FloatArray) -> FloatArray:
    """Return positions and rotations in left-handed axes, shape (n, 7)."""
    return _MIRROR * np.concatenate([points, turns], axis=1) + 0.0  # -0 becomes 0


def _messages(time: float, places: Mapping[str, Sequence[float]]) -> Iterator[Message]:
    yield "/VMC/Ext/OK", (1,)
    yield "/VMC/Ext/T", (time,)
    for name, place in places.items():
        yield _PLACES[name == ROOT], (name, *place)
