"""VMC: an independent receiver sees the figure, and a relay grafts the base of any sender."""

import json
import os
import random
import resource
import signal
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import mograft as mg
from mograft.cli import main
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.stream import live, osc
from mograft.stream.live import Receiver, Relay, Resampler, Sender
from mograft.stream.vmc import HUMANOID, ROOT, Figure, read_bones
from tests.fuzz import vmc as fuzz
from tests.oracles import vmc as oracle
from tests.running import running
from tests.strategies import transform_motion, turn_motion

MOTION = dance(seed=2, strides=1).motion
BONES = {"Hips": "Hips", "Spine": "Spine", "Neck": "Neck", "Head": "Head"}
for _side in ("Left", "Right"):
    _bones = {"UpLeg": "UpperLeg", "Leg": "LowerLeg", "Foot": "Foot", "Shoulder": "Shoulder"}
    _bones |= {"Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"}
    BONES |= {f"{_side}{joint}": f"{_side}{bone}" for joint, bone in _bones.items()}


def written_out(address, tags, words):
    """The bytes of a message with its length, from texts and numbers in hexadecimal."""
    texts = [own.encode() + bytes(4 - len(own) % 4) for own in (address, tags)]
    content = b"".join(texts) + bytes.fromhex(words)
    return len(content).to_bytes(4, "big") + content


# The messages of https://protocol.vmc.info/marionette-spec, in the order of their page. Texts are
# ASCII: 726f6f74 is "root", 48697073 "Hips". Numbers: 3e800000 is 0.25, 3f000000 0.5, 3f800000 1.
ZERO, HALF, ONE = "00000000", "3f000000", "3f800000"
OK = written_out("/VMC/Ext/OK", ",i", "00000001")
OK_27 = written_out("/VMC/Ext/OK", ",iiii", "00000001 00000003 00000000 00000001")
TIME = written_out("/VMC/Ext/T", ",f", "40200000")
AT_REST = f"{ZERO} {ZERO} {ZERO} {ONE}"
ORIGIN = written_out(
    "/VMC/Ext/Root/Pos", ",sfffffff", f"726f6f74 00000000 {ZERO} {ZERO} {ZERO} {AT_REST}"
)
ORIGIN_21 = written_out(
    "/VMC/Ext/Root/Pos",
    ",sfffffffffffff",
    f"726f6f74 00000000 {ZERO} {ZERO} {ZERO} {AT_REST} {ONE} {ONE} {ONE} {ZERO} {ZERO} {ZERO}",
)
# A figure a quarter of a metre to its right, the left hand of which is at -x.
HIPS = written_out(
    "/VMC/Ext/Bone/Pos", ",sfffffff", f"48697073 00000000 3e800000 {ONE} {HALF} {AT_REST}"
)
START = b"#bundle\0" + bytes(7) + b"\1"


def test_packet_has_the_bytes_of_the_specification():
    skeleton = HUMANOID
    quats = np.tile(rotations.IDENTITY, (1, skeleton.n_joints, 1))
    places = skeleton.offsets[None].copy()
    places[:, 0] = [-0.25, 1.0, 0.5]  # right-handed: x to the left
    rest = mg.Motion(skeleton, 1.0, quats, places)
    packet = next(Figure(rest).packets(rest, 2.5, 1.0))
    expected = START + OK + TIME + ORIGIN + HIPS
    assert packet[: len(expected)] == expected


@pytest.mark.parametrize("parts", [(OK, TIME, ORIGIN, HIPS), (OK_27, TIME, HIPS, ORIGIN_21)])
def test_messages_of_the_specification_are_read_bundled_and_alone(parts):
    at_rest = (0.0, 0.0, 0.0, 1.0)
    expected = {"Hips": (0.25, 1.0, 0.5, *at_rest), ROOT: (0.0, 0.0, 0.0, *at_rest)}
    assert read_bones(osc.decode(START + b"".join(parts))) == (expected, 2.5, 0)
    alone = [message for own in parts for message in osc.decode(own[4:])]
    assert read_bones(alone) == (expected, 2.5, 0)


def test_bone_that_is_named_as_the_root_is_invalid():
    place = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
    messages = [("/VMC/Ext/Root/Pos", ("any", *place)), ("/VMC/Ext/Bone/Pos", (ROOT, *place))]
    assert read_bones(messages[:1]) == ({ROOT: place}, None, 0)
    assert read_bones(messages[1:]) == ({}, None, 1)


@pytest.mark.parametrize(("up", "heading"), [("y", 0.0), ("y", 2.0), ("z", 2.0)])
def test_receiver_sees_the_figure_of_a_glb(tmp_path, up, heading):
    """Also with 5 % of the packets lost and the others out of order."""
    motion = transform_motion(dance(seed=4, strides=2).motion[:1000], yaw=heading)
    if up == "z":
        motion = turn_motion(motion, rotations.exp(np.array([np.pi / 2, 0.0, 0.0])))
    mg.formats.write_glb(motion, tmp_path / "a.glb")
    expected = mg.read(tmp_path / "a.glb")[0]
    positions, names = expected.world_positions(), expected.skeleton.names
    height = np.ptp(positions[0, :, 1])
    rng = random.Random(0)
    packets = [own for own in Figure(motion).packets(motion, 0.0, 1 / 30) if rng.random() > 0.05]
    rng.shuffle(packets)
    for packet in packets:
        time, places = oracle.receive(packet)
        found = oracle.world(places)
        for joint, bone in BONES.items():
            place = positions[round(time * 30), names.index(joint)]
            assert np.abs(found[bone][0] * [-1, 1, 1] - place).max() < 1e-4 * height


@pytest.mark.parametrize("angle", [0.0, 50.0])
def test_figure_in_a_t_pose_faces_forward_without_rotations_whatever_the_rest_pose(angle):
    """Of a rest pose with lowered arms, too."""
    skeleton = HUMANOID
    offsets = skeleton.offsets.copy()
    quats = np.tile(rotations.IDENTITY, (1, skeleton.n_joints, 1))
    for name, sign in (("left_shoulder", -1), ("right_shoulder", 1)):
        turn = rotations.exp(np.array([0, 0, sign * np.radians(angle)]))
        shoulder = skeleton.index(name)
        quats[0, shoulder] = rotations.inverse(turn)
        for joint in np.flatnonzero(skeleton.subtree_mask([shoulder])):
            if joint != shoulder:
                offsets[joint] = rotations.rotate(turn, offsets[joint])
    lowered = mg.Skeleton(skeleton.names, skeleton.parents, offsets, skeleton.channels)
    motion = mg.Motion(lowered, 1 / 30, quats, offsets[None])
    _, places = oracle.receive(next(Figure(motion).packets(motion, 0.0, 1.0)))
    assert {*oracle.PARENTS, "Hips", ""} == places.keys()
    for place in places.values():
        np.testing.assert_allclose(place[3:], rotations.IDENTITY, atol=1e-6)
    found = oracle.world(places)
    assert found["LeftHand"][0][0] < -0.5  # left-handed: x points to the right
    assert found["LeftToes"][0][2] > found["LeftFoot"][0][2]


class Clock:
    """A clock that stands still between two steps of a test."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


class Setting:
    """A relay between a sender and a receiver of a test."""

    def __init__(self, library, clock, timeout=600.0):
        self.clock, self.remarks, self.base = clock, [], []
        self.receiver = Receiver(("127.0.0.1", 0))
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.out.bind(("127.0.0.1", 0))
        self.out.settimeout(0.0)
        self.sender = Sender(("127.0.0.1", self.out.getsockname()[1]))
        self.relay = Relay(
            library, self.receiver, self.sender, self.remarks.append, timeout=timeout, seed=3
        )
        self.sources = []
        self.source = self.open_source()

    def open_source(self):
        self.sources.append(Sender(("127.0.0.1", self.receiver.port)))
        return self.sources[-1]

    def send(self, packets, rate, source=None):
        """Send packets at a rate; return the new packets that arrive."""
        found = []
        for packet in packets:
            (source or self.source).send(packet)
            found += self.wait(1.0 / rate)
        return found

    def wait(self, seconds):
        self.relay.advance(0.0)
        self.clock.now += seconds
        found = []
        while True:
            try:
                found.append(self.out.recv(65536))
            except BlockingIOError:
                return found

    def close(self):
        for own in (self.receiver, self.out, self.sender, *self.sources):
            own.close()


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(live, "time", clock)
    return clock


@pytest.fixture
def setting(two_dances, clock):
    setting = Setting(two_dances, clock, timeout=5.0)
    yield setting
    setting.close()


def packets_of(motion, first=0.0):
    return list(Figure(motion).packets(motion, first, motion.frame_time))


def test_relay_grafts_the_base_of_a_sender(setting, two_dances):
    pushed = []
    setting.relay._stream.push = record(setting.relay._stream.push, pushed)
    found = setting.send(packets_of(MOTION[:300]), 30.0) + setting.wait(0.5)
    stream = mg.Stream(two_dances, seed=3)
    stream.push(*(np.stack(own) for own in zip(*pushed, strict=True)))
    expected = mg.join_pieces(stream.pieces())
    figure = [oracle.receive(own)[1] for own in packets_of(expected)]
    assert 100 < len(found) <= len(figure)
    for packet, places in zip(found, figure, strict=False):
        for bone, place in oracle.receive(packet)[1].items():
            np.testing.assert_allclose(place, places[bone], atol=1e-5)
    assert setting.relay.newness > 0.2
    assert sum(setting.relay.dropped.values()) == 0


@pytest.mark.parametrize(("rate", "speed"), [(30.0, 1.0), (24.0, 1.0), (50.0, 1.0), (60.0, 0.8)])
def test_base_of_play_arrives_as_it_was_after_resampling(setting, rate, speed):
    """`live.play` sends, the relay receives, and SciPy interpolates what should arrive."""
    base, pushed = MOTION[:61].resample(rate), []  # 2 s: all rates are exact
    setting.relay._stream.push = record(setting.relay._stream.push, pushed)

    def wait(seconds):
        setting.wait(seconds)
        return False

    assert live.play(base, setting.source, wait, speed=speed) == base.n_frames
    wait(0.1)
    quats, places = (np.stack(own) for own in zip(*pushed, strict=True))
    times = np.arange(base.n_frames) / (rate * speed)
    moments = np.arange(len(quats)) / 30.0
    assert abs(moments[-1] - times[-1]) < 1 / 30.0 + 1e-6
    moments = np.minimum(moments, times[-1])
    for joint in range(base.n_joints):
        expected = Slerp(times, Rotation.from_quat(base.rotations[:, joint]))(moments).as_quat()
        assert rotations.angle(quats[:, joint], expected).max() < 1e-5
    for own, given in zip(places.T, base.positions[:, 0].T, strict=True):
        np.testing.assert_allclose(own, np.interp(moments, times, given), atol=1e-5 * 170)


def record(push, pushed):
    def recorded(quats, places):
        pushed.append((quats, places))
        push(quats, places)

    return recorded


def test_sender_that_stops_is_held_then_closed_and_another_starts_anew(setting):
    packets = packets_of(MOTION[:90])
    found = setting.send(packets, 30.0)
    for _ in range(60):
        found += setting.wait(0.05)
    assert len(found) > 60
    assert 140 <= setting.relay.n_base <= 180  # 3 s, the first half second of which waits
    assert not setting.remarks[1:]
    for _ in range(60):
        found += setting.wait(0.05)
    assert setting.remarks[-1].startswith("the sender stopped 5 s ago")
    assert setting.relay.n_base == setting.relay.n_sent
    n = setting.relay.n_base
    setting.send(packets, 30.0, setting.open_source())
    assert setting.relay.n_base == n + 90


def test_time_that_goes_back_and_rate_that_jumps_keep_the_rate_of_the_library(setting):
    setting.send(packets_of(MOTION[:60], 50.0), 30.0)
    setting.send(packets_of(MOTION[60:120], 1.0), 30.0)
    assert setting.relay.n_base == 120
    setting.send(packets_of(MOTION[120:180].resample(120.0), 3.0), 120.0)
    assert 175 <= setting.relay.n_base <= 181


def test_second_sender_late_and_invalid_packets_are_counted_and_dropped(setting):
    packets = packets_of(MOTION[:60])
    other = setting.open_source()
    setting.send(packets[:30], 30.0)
    setting.send(packets[:20], 300.0, other)
    setting.send([packets[10], b"x", packets[40][:-3], b"#bundle\0"], 300.0)
    assert setting.relay.n_base == 30
    dropped = setting.relay.dropped
    assert (dropped["of another sender"], dropped["late"], dropped["invalid"]) == (20, 1, 3)
    assert "dropped 24 (" in setting.relay.status()


def test_flood_is_dropped(setting):
    packets = packets_of(MOTION[:10])
    for _ in range(30):
        for _ in range(50):
            setting.source.send(packets[0])
        setting.relay.advance(0.0)
    assert setting.relay.dropped["too many"] >= 400
    assert setting.relay.n_base == 1


def test_bones_that_the_sender_lacks_are_named_and_stay_at_rest(setting):
    motion = MOTION[:30]
    for packet in packets_of(motion):
        _, places = oracle.receive(packet)
        kept = {k: v for k, v in places.items() if "Arm" not in k}
        messages = [("/VMC/Ext/T", (float(setting.relay.n_base) / 30,))]
        messages += [
            ("/VMC/Ext/Bone/Pos" if k else "/VMC/Ext/Root/Pos", (k or "root", *v.tolist()))
            for k, v in kept.items()
        ]
        setting.send([osc.encode_bundle(messages)], 30.0)
    assert setting.relay.n_base == 30
    assert [own for own in setting.remarks if own.startswith("at rest")] == [
        "at rest, because the sender lacks them: LeftUpperArm, RightUpperArm, LeftLowerArm, "
        "RightLowerArm"
    ]


def test_resampler_frames_do_not_depend_on_single_precision_of_times():
    motion = MOTION[:200]
    times = np.float32(np.arange(200) / 30.0 + 5000.0)
    resampler, found = Resampler(30.0), []
    for at, *frame in zip(times, motion.rotations, motion.positions[:, 0], strict=True):
        found += resampler.push(at, tuple(frame))
    np.testing.assert_array_equal([quats for quats, _ in found], motion.rotations)


def test_fuzzed_packets_give_counts_only(tmp_path):
    n_frames = sum(fuzz.check(seed, tmp_path) for seed in range(60))
    assert n_frames > 0


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc of Linux")
def test_many_frames_need_no_memory_and_no_descriptors(setting):
    """Of 100,000 frames; tracing allocations instead would take four times as long."""
    sizes = []
    for turn in range(100_000 // 900):
        setting.send(packets_of(MOTION[:900], 30.0 * turn), 30.0)
        if turn in (10, 100):
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            sizes.append((pages * resource.getpagesize(), len(os.listdir("/proc/self/fd"))))
    assert setting.relay.n_base >= 99_000
    assert sizes[1][0] < sizes[0][0] + 8_000_000  # 100 bytes a frame
    assert sizes[1][1] == sizes[0][1]


def test_play_sends_each_frame_at_its_time(tmp_path, capsys):
    motion = transform_motion(MOTION[:40], 1.0, 0.0, (0.0, 0.0, 0.0))
    mg.write_bvh(motion, tmp_path / "a.bvh")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.bind(("127.0.0.1", 0))
        out.settimeout(10.0)
        found = []
        thread = threading.Thread(target=lambda: found.extend(out.recv(65536) for _ in range(40)))
        thread.start()
        words = ["play", str(tmp_path / "a.bvh"), "--vmc", f"127.0.0.1:{out.getsockname()[1]}"]
        assert main([*words, "--speed", "4", "--json"]) == 0
        thread.join()
    times = [oracle.receive(own)[0] for own in found]
    np.testing.assert_allclose(times, np.arange(40) / 120.0, atol=1e-6)
    document = json.loads(capsys.readouterr().out)
    assert (document["schema"], document["frames"]) == ("mograft.play/1", 40)


def test_space_pauses_and_the_motion_goes_on_where_it_was(clock):
    motion, sent, answers = MOTION[:30], [], iter([False] * 9 + [True, False, False, True])

    class Recorder:
        def send(self, packet):
            sent.append((oracle.receive(packet)[0], clock.now))

    def wait(seconds):
        clock.now += seconds
        return next(answers, False)

    assert live.play(motion, Recorder(), wait, speed=2.0) == 30
    times, moments = np.array(sent).T
    np.testing.assert_allclose(np.unique(times), np.arange(30) / 60.0, atol=1e-6)
    late = moments - moments[0] - times
    np.testing.assert_allclose(late[times < 9.5 / 60], 0.0, atol=1e-6)
    np.testing.assert_allclose(late[times > 10.5 / 60], late[-1], atol=1e-6)
    assert late[-1] == pytest.approx(3.0, abs=0.05)


def test_port_in_use_is_an_error_that_names_it(setting):
    address = ("127.0.0.1", setting.receiver.port)
    with pytest.raises(OSError, match=f"127.0.0.1:{address[1]}"):
        Receiver(address)


def test_stream_over_vmc_ends_by_ctrl_c(tmp_path):
    mg.write_bvh(MOTION[:300], tmp_path / "a.bvh")
    words = ["stream", tmp_path / "a.bvh", "--vmc-in", "0.0.0.0:39613", "--vmc"]
    words += ["127.0.0.1:39614", "--status", "--timeout", "9"]
    with running(*words) as (process, document):
        assert (document["address"], document["target"]) == ("0.0.0.0:39613", "127.0.0.1:39614")
        for line in process.stderr:
            if line.startswith("base 0 frames, new 0"):
                break
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        err = process.stderr.read()
    assert "interrupted" in err
    assert "Traceback" not in err
