"""A VMC receiver and Blender show the same figure: sides, heading and height agree.

Blender reads the GLB file of a motion. The receiver is `tests.oracles.vmc`, which shares no code
with mograft; its packets are those of `mograft play`, through a socket.
"""

import socket
import threading

import numpy as np
import pytest

import mograft as mg
from mograft.cli import main
from mograft.dancer import dance
from mograft.motion import rotations
from tests.clients import blender
from tests.oracles import vmc as oracle
from tests.strategies import transform_motion, turn_motion

RATE, SPEED = 30.0, 10.0
BONES = {"Hips": "Hips", "Spine": "Spine", "Neck": "Neck", "Head": "Head"}
for _side in ("Left", "Right"):
    _bones = {"UpLeg": "UpperLeg", "Leg": "LowerLeg", "Foot": "Foot", "Shoulder": "Shoulder"}
    _bones |= {"Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"}
    BONES |= {f"{_side}{joint}": f"{_side}{bone}" for joint, bone in _bones.items()}


def raised_hand(side):
    """A figure that stands in its T-pose and raises one hand within a second."""
    skeleton = dance(seed=0, strides=1).motion.skeleton
    quats = np.tile(rotations.IDENTITY, (31, skeleton.n_joints, 1))
    sign = 1 if side == "Left" else -1  # the left arm points to +x
    turns = np.linspace(0, sign * np.pi / 2, 31)[:, None] * [0.0, 0.0, 1.0]
    quats[:, skeleton.index(f"{side}Arm")] = rotations.exp(turns)
    places = np.tile(skeleton.offsets, (31, 1, 1)) + np.eye(1, skeleton.n_joints).T * [0, 95.0, 0]
    return mg.Motion(skeleton, 1 / RATE, quats, places, name=f"{side} hand")


def received(path):
    """The position of each bone by frame, in the axes of Unity, as `mograft play` sends it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.bind(("127.0.0.1", 0))
        out.settimeout(20.0)
        packets, n_frames = [], mg.read(path)[0].n_frames

        def receive():
            packets.extend(out.recv(65536) for _ in range(n_frames))

        thread = threading.Thread(target=receive)
        thread.start()
        address = f"127.0.0.1:{out.getsockname()[1]}"
        assert main(["play", str(path), "--vmc", address, "--speed", f"{SPEED:g}"]) == 0
        thread.join()
    figures = map(oracle.receive, packets)
    found = {round(time * RATE * SPEED): oracle.world(places) for time, places in figures}
    assert list(found) == list(range(n_frames))
    return found


def to_blender(place):
    """Unity is left-handed with y up; a figure at rest faces +z there, and -y in Blender."""
    x, y, z = place
    return np.array([-x, -z, y])


@pytest.fixture(scope="module")
def imported():
    return blender()


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_hand_that_is_raised_is_the_same_in_blender_and_over_vmc(imported, tmp_path, side):
    path, other = tmp_path / "a.bvh", {"Left": "Right", "Right": "Left"}[side]
    mg.write_bvh(raised_hand(side), path)
    assert main(["export", str(path), "-o", str(tmp_path / "a.glb")]) == 0
    (heads,) = imported(tmp_path / "a.glb", [30], RATE)["heads"]
    places = received(path)[30]
    for head, hand, low in (
        (heads["Head"][2], heads[f"{side}Hand"][2], heads[f"{other}Hand"][2]),
        (places["Head"][0][1], places[f"{side}Hand"][0][1], places[f"{other}Hand"][0][1]),
    ):
        assert low < head < hand
    # The left hand is at +x of Blender, whose figures face -y, and at -x of Unity.
    sign = 1 if side == "Left" else -1
    assert sign * heads[f"{other}Hand"][0] < -0.3
    assert sign * places[f"{other}Hand"][0][0] > 0.3


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_figure_of_blender_is_the_figure_over_vmc(imported, tmp_path, up, heading):
    motion = transform_motion(dance(seed=4, strides=1).motion[:300], yaw=heading)
    if up == "z":
        motion = turn_motion(motion, rotations.exp(np.array([np.pi / 2, 0.0, 0.0])))
    mg.formats.write_npz(motion, tmp_path / "a.npz")
    assert main(["export", str(tmp_path / "a.npz"), "-o", str(tmp_path / "a.glb")]) == 0
    frames = [0, 37, 150, 299]
    shown = imported(tmp_path / "a.glb", frames, RATE)["heads"]
    places = received(tmp_path / "a.npz")
    height = shown[0]["Head"][2] - shown[0]["LeftFoot"][2]
    for frame, heads in zip(frames, shown, strict=True):
        for joint, bone in BONES.items():
            own = to_blender(places[frame][bone][0])
            assert np.abs(own - heads[joint]).max() < 1e-4 * height, (frame, bone)
