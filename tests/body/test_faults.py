"""Properties of `find_faults`: it reports inserted faults, and none in clean motions."""

import csv
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.motion import rotations
from tests.dialects import Dialect, clips, to_text
from tests.hierarchies import DATA
from tests.strategies import few_examples

N_FRAMES = 60
KINDS = ("frame_time", "first_frame", "teleport", "glitch", "flip", "frozen", "wrap")


def swaying_figure(rate=60.0, unit=1.0, phase=0.0):
    """A figure that sways, steps and swings its arms smoothly."""
    names = ("Hips", "Spine", "Head", "Arm", "Hand", "Leg", "Foot")
    parents = np.array([-1, 0, 1, 1, 3, 0, 5])
    up, down = [0.0, 45.0, 0.0], [0.0, -40.0, 0.0]
    offsets = np.array([[0, 0, 0], up, [0, 30, 0], [18, 10, 0], [30, 0, 0], [10, -5, 0], down])
    skeleton = mg.Skeleton(names, parents, unit * offsets)
    times = np.arange(N_FRAMES) / rate
    joints = np.arange(len(names))
    values = np.empty((N_FRAMES, skeleton.n_channels))
    swing = np.sin(2.0 * times[:, None] * (1.0 + 0.2 * joints) + joints + phase)
    for joint, columns in enumerate(skeleton.channel_columns):
        values[:, columns[-3]] = 30.0 * swing[:, joint]
        values[:, columns[-2]] = 20.0 * swing[:, joint - 1]
        values[:, columns[-1]] = 10.0 * swing[:, joint - 2]
    values[:, 0] = unit * 40.0 * np.sin(times + phase)
    values[:, 1] = unit * (95.0 + 3.0 * np.sin(3.0 * times + phase))
    values[:, 2] = unit * 20.0 * np.cos(times)
    return motion_of_values(skeleton, values, 1.0 / rate)


def motion_of_values(skeleton, values, frame_time):
    quats = np.empty((len(values), skeleton.n_joints, 4))
    for joint, columns in enumerate(skeleton.channel_columns):
        quats[:, joint] = rotations.from_euler(np.radians(values[:, columns[-3:]]), "ZXY")
    positions = np.tile(skeleton.offsets, (len(values), 1, 1))
    positions[:, 0] = values[:, :3]
    return mg.Motion(skeleton, frame_time, rotations.continuous_signs(quats), positions, values)


def fault_list(motion):
    return [(fault.kind, fault.frames, fault.joint) for fault in mg.find_faults(motion)]


rates = st.sampled_from([24.0, 30.0, 60.0, 120.0])
units = st.sampled_from([1.0, 0.01, 0.0254])
frames = st.integers(12, N_FRAMES - 14)
figures = st.builds(swaying_figure, rates, units, st.floats(0.0, 6.0))


@given(figures)
def test_find_faults_smooth_motion_is_empty(motion):
    assert fault_list(motion) == []


@given(figures)
def test_find_faults_leading_rest_pose_is_first_frame(motion):
    values = motion.channel_values.copy()
    values[0] = 0.0
    faults = fault_list(motion_of_values(motion.skeleton, values, motion.frame_time))
    assert faults[:1] == [("first_frame", (0, 0), None)]


@given(figures, st.floats(2.0, 3.5))
def test_find_faults_fast_start_is_not_first_frame(motion, times):
    positions = motion.positions.copy()
    steps = np.linalg.norm(np.diff(motion.world_positions(), axis=0), axis=-1).mean(axis=-1)
    forward = np.sign(positions[1, 0] - positions[0, 0])
    positions[0, 0] -= forward * times * np.median(steps) / np.sqrt(3.0)
    assert fault_list(replace(motion, positions=positions)) == []


@given(figures, frames)
def test_find_faults_small_noise_of_still_figure_is_empty(motion, frame):
    quats, positions = (own[[0] * N_FRAMES] for own in (motion.rotations, motion.positions))
    height = np.ptp(motion.world_positions()[0], axis=0).max()
    positions[frame:, 0, 0] += height * motion.frame_time
    standing = mg.Motion(motion.skeleton, motion.frame_time, quats, positions)
    assert {kind for kind, *_ in fault_list(standing)} <= {"frozen"}


@given(figures, frames, st.floats(0.3, 9.0))
def test_find_faults_jump_is_teleport_and_displaced_frame_glitch(motion, frame, distance):
    step = distance * np.ptp(motion.world_positions()[0], axis=0).max()
    for stop, fault in (
        (N_FRAMES, ("teleport", (frame - 1, frame), None)),
        (frame + 1, ("glitch", (frame, frame), None)),
    ):
        positions = motion.positions.copy()
        positions[frame:stop, 0, 0] += step
        assert fault_list(replace(motion, positions=positions)) == [fault]


@given(figures, frames)
def test_find_faults_message_compares_a_jump_with_most_steps(motion, frame):
    positions = motion.positions.copy()
    positions[frame:, 0, 0] += 2.0 * np.ptp(motion.world_positions()[0], axis=0).max()
    (fault,) = mg.find_faults(moved := replace(motion, positions=positions))
    world = moved.world_positions()
    height = np.median(np.ptp(world, axis=1).max(axis=-1))
    steps = 100.0 / height * np.linalg.norm(np.diff(world, axis=0), axis=-1).mean(axis=-1)
    low, high = np.percentile(steps, (5, 95))
    numbers = [float(number) for number in re.findall(r"[\d.]+", fault.message)]
    assert numbers == pytest.approx([steps[frame - 1], low, high], abs=0.51)


@given(figures, frames, st.sampled_from([3, 4, 6]), st.floats(50.0, 178.0))
def test_find_faults_rotated_frame_is_glitch_and_rotation_step_flip(motion, frame, joint, degrees):
    for axis, stop, angle, fault in (
        ([1, 1, 0], frame + 1, degrees, ("glitch", (frame, frame), joint)),
        ([1, 0, 0], N_FRAMES, 160.0 + degrees / 10.0, ("flip", (frame - 1, frame), joint)),
    ):
        quats = motion.rotations.copy()
        turn = rotations.from_axis_angle(axis, np.radians(angle))
        quats[frame:stop, joint] = rotations.multiply(quats[frame:stop, joint], turn)
        assert fault in fault_list(replace(motion, rotations=quats))


@given(figures, frames)
def test_find_faults_identical_frames_are_frozen(motion, frame):
    n_repeated = max(int(np.ceil(0.26 / motion.frame_time)), 4)
    indices = [*range(frame), *[frame] * n_repeated, *range(frame, N_FRAMES)]
    fields = "rotations", "positions", "channel_values"
    frozen = replace(motion, **{name: getattr(motion, name)[indices] for name in fields})
    assert ("frozen", (frame, frame + n_repeated), None) in fault_list(frozen)


@given(figures, frames, st.sampled_from([0, 3, 6]), st.sampled_from([-360.0, 360.0]))
def test_find_faults_angle_jump_is_wrap(motion, frame, joint, jump):
    values = motion.channel_values.copy()
    values[frame:, motion.skeleton.channel_columns[joint][-1]] += jump
    wrapped = motion_of_values(motion.skeleton, values, motion.frame_time)
    assert fault_list(wrapped) == [("wrap", (frame - 1, frame), joint)]


@pytest.mark.parametrize(
    ("frame_time", "message"),
    [
        (30.0, "the frame time is 30 s; is it a rate of 30 fps or 30 ms?"),
        (8.333, "the frame time is 8.333 s; is it a rate of 8.333 fps or 8.333 ms?"),
        (1e-5, "the frame time is 1e-05 s"),
    ],
)
def test_find_faults_implausible_frame_time(frame_time, message):
    motion = replace(swaying_figure(), frame_time=frame_time)
    fault = mg.find_faults(motion)[0]
    assert (fault.kind, fault.frames, fault.message) == ("frame_time", (0, N_FRAMES - 1), message)


def test_find_faults_figure_without_height_is_accepted():
    skeleton = mg.Skeleton(("point",), np.array([-1]), np.zeros((1, 3)))
    positions = np.arange(30.0).reshape(10, 1, 3) ** 5
    identity = np.tile(rotations.IDENTITY, (10, 1, 1))
    assert fault_list(mg.Motion(skeleton, 0.1, identity, positions)) == []


@few_examples(40)
@given(clips())
def test_find_faults_arbitrary_motion_does_not_fail(clip):
    motion = mg.read_bvh(io.BytesIO(to_text(clip, Dialect())))
    for fault in mg.find_faults(motion):
        assert fault.kind in KINDS
        assert 0 <= fault.frames[0] <= fault.frames[1] < motion.n_frames


# Recordings. The column first_jump of the list of files was measured by another program.


def recordings():
    table = DATA / "FILES.tsv"
    if not table.exists():
        return []
    with table.open() as file:
        return list(csv.DictReader(file, delimiter="\t"))


CLEAN = ("bandai", "dance_mass", "dance_carousel", "skel_animated", "skel_games", "synthetic_q")


@pytest.mark.parametrize("row", recordings(), ids=lambda row: row["file"])
def test_find_faults_recordings_report_known_rest_poses_and_few_others(row):
    kinds = {fault.kind for fault in mg.find_faults(mg.read_bvh(DATA / row["file"]))}
    is_rest_pose = row["first_jump"] not in ("", "-", "None") and float(row["first_jump"]) > 12.0
    assert ("first_frame" in kinds) == is_rest_pose
    assert kinds <= {"wrap"} or not row["file"].startswith(CLEAN)
