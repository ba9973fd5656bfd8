"""Exports: what other programs read there is what the motion is."""

import csv
import io
import json
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import (
    EndSite,
    Motion,
    Skeleton,
    SkeletonMismatchError,
    read_bvh,
    read_npz,
    write_bvh,
    write_csv,
    write_glb,
    write_npz,
)
from mograft.body.mass import mass_model
from mograft.cli import main
from mograft.dancer import dance
from mograft.io.units import guess_unit
from mograft.motion import rotations
from tests import strategies as own
from tests.clients import blender, gltf_validator
from tests.strategies import HOSTILE_NAMES

COMPONENTS = {5126: "<f4", 5121: "u1", 5123: "<u2"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    """A GLB file read back by what its specification says, with none of the writer's code."""

    def __init__(self, path):
        data = Path(path).read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        self.document = json.loads(data[20 : 20 + size].decode("utf-8"))
        rest, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0"
        assert 28 + size + rest == len(data)
        self.binary = data[28 + size :]

    def array(self, index):
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width = WIDTHS[accessor["type"]]
        raw = np.frombuffer(
            self.binary,
            COMPONENTS[accessor["componentType"]],
            accessor["count"] * width,
            view["byteOffset"],
        )
        return raw.astype(float).reshape(accessor["count"], width)

    def keys(self, animation, node, path, frame):
        for channel in animation["channels"]:
            if channel["target"] == {"node": node, "path": path}:
                sampler = animation["samplers"][channel["sampler"]]
                values = self.array(sampler["output"])
                assert len(values) == len(self.array(sampler["input"]))
                return values[min(frame, len(values) - 1)]
        rest = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1]}
        return np.array(self.document["nodes"][node].get(path, rest[path]), float)

    def matrices(self, animation, frame):
        """World matrices of all nodes in a frame."""
        nodes = self.document["nodes"]
        world = {}

        def visit(node, above):
            own = np.eye(4)
            own[:3, :3] = turned(self.keys(animation, node, "rotation", frame))
            own[:3, 3] = self.keys(animation, node, "translation", frame)
            world[node] = above @ own
            for child in nodes[node].get("children", []):
                visit(child, world[node])

        for root in self.document["scenes"][0]["nodes"]:
            visit(root, np.eye(4))
        return world

    def skinned(self, animation, frame):
        """The mesh's vertices as an engine moves them, and the joint of each."""
        skin = self.document["skins"][0]
        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        world = self.matrices(animation, frame)
        moves = np.array([world[j] for j in skin["joints"]]) @ inverse
        attributes = self.document["meshes"][0]["primitives"][0]["attributes"]
        joints = self.array(attributes["JOINTS_0"])[:, 0].astype(int)
        vertices = self.array(attributes["POSITION"])
        four = np.concatenate([vertices, np.ones((len(vertices), 1))], axis=1)
        return np.einsum("vij,vj->vi", moves[joints], four)[:, :3], joints


def turned(quat):
    x, y, z, w = quat
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.fixture(scope="module")
def motion():
    return dance(seed=1, strides=1).motion[:90]


def same_up_to_a_turn(got, want, atol):
    """Assert that places agree, but for one rotation about the origin: of the axes."""
    flat = [places.reshape(-1, 3) for places in (got, want)]
    left, _, right = np.linalg.svd(flat[0].T @ flat[1])
    turn = left @ right
    # A mirror image is none.
    if np.linalg.det(turn) < 0:
        turn = left @ np.diag([1, 1, -1]) @ right
    np.testing.assert_allclose(flat[0], flat[1] @ turn.T, atol=atol)


@settings(max_examples=60)
@given(own.motions(max_frames=12), st.sampled_from([0.01, 1.0, 0.056444]))
def test_joints_in_glb_are_where_forward_kinematics_puts_them(tmp_path_factory, motion, scale):
    path = tmp_path_factory.mktemp("glb") / "m.glb"
    assert write_glb(motion, path, scale=scale) == scale
    file = Glb(path)
    (animation,) = file.document["animations"]
    frames = [0, motion.n_frames // 2, motion.n_frames - 1]
    want = scale * motion.world_positions()[frames]
    got = np.empty_like(want)
    for at, frame in enumerate(frames):
        world = file.matrices(animation, frame)
        got[at] = [world[joint][:3, 3] for joint in range(motion.n_joints)]
        places, joints = file.skinned(animation, frame)
        # The first corner of every bone is its joint.
        far = 1e-6 * np.abs(want).max()
        np.testing.assert_allclose(places[::24], got[at][joints[::24]], rtol=1e-5, atol=10 * far)
    height = scale * mass_model(motion.skeleton).height
    same_up_to_a_turn(got, want, 1e-4 * height + 1e-6 * np.abs(want).max())
    times = file.array(animation["samplers"][-1]["input"])
    np.testing.assert_allclose(times[-1], times[0] if len(times) == 1 else motion.duration, 1e-6)


def test_the_skin_moves_with_its_bones(motion, tmp_path):
    for axes in ([0, 0, 0], [np.pi / 2, 0, 0], [0, 0, np.pi / 2], [np.pi, 0, 0]):
        whole = rotations.exp(np.array(axes, float))
        quats, places = motion.rotations.copy(), motion.positions.copy()
        quats[:, 0] = rotations.multiply(np.broadcast_to(whole, quats[:, 0].shape), quats[:, 0])
        places[:, 0] = rotations.rotate(whole, places[:, 0])
        write_glb(replace(motion, rotations=quats, positions=places), tmp_path / "m.glb")
        file = Glb(tmp_path / "m.glb")
        got, joints = file.skinned(file.document["animations"][0], 40)
        world = 0.01 * motion.world_positions()[40]
        # Standing as the original, feet down, and not mirrored: turned about y at most.
        heights = got[:, 1]
        head = motion.skeleton.index("Head")
        assert abs(heights[joints == head].min() - world[head, 1]) < 0.03
        assert heights.min() > -0.1
        corners = got.reshape(-1, 8, 3, 3)
        ends = np.stack([corners[:, 0, 0], corners[:, 1, 0]], axis=1)
        skeleton = motion.skeleton
        bones = [(int(p), world[j]) for j, p in enumerate(skeleton.parents) if p >= 0]
        turns, joints_at = motion.world_transforms()
        bones += [
            (
                s.parent,
                0.01 * (joints_at[40, s.parent] + rotations.rotate(turns[40, s.parent], s.offset)),
            )
            for s in skeleton.end_sites
        ]
        want = np.array([[world[parent], end] for parent, end in bones])
        same_up_to_a_turn(ends, want, 1e-4)
        np.testing.assert_allclose(ends[..., 1], want[..., 1], atol=1e-4)


def test_several_motions_are_several_animations(motion, tmp_path):
    grown = replace(
        motion[:30],
        name="grown",
        skeleton=motion.skeleton.with_offsets(1.5 * motion.skeleton.offsets),
        positions=1.5 * motion[:30].positions,
    )
    write_glb([motion, grown], tmp_path / "m.glb", scale=1.0)
    file = Glb(tmp_path / "m.glb")
    names = [animation["name"] for animation in file.document["animations"]]
    assert names == ["dance", "grown"]
    for animation, want in zip(file.document["animations"], (motion, grown), strict=True):
        world = file.matrices(animation, 20)
        got = [world[joint][:3, 3] for joint in range(18)]
        np.testing.assert_allclose(got, want.world_positions()[20], atol=0.01)
    other = Skeleton(["a"], [-1], [[0, 0, 0]])
    still = Motion(other, 0.1, [[[0, 0, 0, 1]]], [[[0, 0, 0]]])
    with pytest.raises(SkeletonMismatchError):
        write_glb([motion, still], tmp_path / "x.glb")
    assert not (tmp_path / "x.glb").exists()


@pytest.mark.parametrize(
    ("size", "unit"), [(1, "cm"), (0.01, "m"), (10, "mm"), (0.01 / 0.0254, "inch"), (0.17, "CMU")]
)
def test_the_unit_is_guessed_by_the_stature_and_told(motion, tmp_path, size, unit):
    skeleton = motion.skeleton.with_offsets(size * motion.skeleton.offsets)
    assert guess_unit(skeleton) == unit
    scaled = replace(motion, skeleton=skeleton, positions=size * motion.positions)
    scale = write_glb(scaled, tmp_path / "m.glb")
    extras = Glb(tmp_path / "m.glb").document["asset"]["extras"]
    assert extras == {"metres_in_a_unit": scale, "unit": unit, "up_in_the_motion": "y"}
    world = Glb(tmp_path / "m.glb").matrices({"channels": []}, 0)
    head, foot = (world[motion.skeleton.index(name)][1, 3] for name in ("Head", "LeftFoot"))
    assert 1.2 < head - foot < 1.7


def test_glb_of_what_cannot_be_written_is_refused(motion, tmp_path):
    with pytest.raises(ValueError, match="motions must hold at least one"):
        write_glb([], tmp_path / "m.glb")
    for scale in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="scale must be above 0"):
            write_glb(motion, tmp_path / "m.glb", scale=scale)
    with pytest.raises(ValueError, match="preset must be one of"):
        write_glb(motion, tmp_path / "m.glb", groups="wings")
    assert not list(tmp_path.iterdir())


@given(own.motions(max_frames=20))
def test_npz_keeps_motions_as_float32_does(tmp_path_factory, motion):
    path = tmp_path_factory.mktemp("npz") / "m.npz"
    write_npz(motion, path)
    again = read_npz(path)
    own.same_rotations(again.rotations, motion.rotations, atol=1e-6)
    np.testing.assert_allclose(again.positions, motion.positions, rtol=1e-6, atol=1e-30)
    assert again.frame_time == motion.frame_time
    assert again.skeleton.names == motion.skeleton.names
    np.testing.assert_array_equal(again.skeleton.offsets, motion.skeleton.offsets)
    with np.load(path, allow_pickle=False) as data:
        np.testing.assert_array_equal(
            data["world_positions"], motion.world_positions().astype(np.float32)
        )


def test_npz_keeps_channels_and_end_sites_and_its_bytes(motion, tmp_path):
    for name in ("a", "b"):
        write_npz(motion, tmp_path / f"{name}.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = read_npz(tmp_path / "a.npz")
    assert again.skeleton.channels == motion.skeleton.channels
    assert again.name == "dance"
    for got, want in zip(again.skeleton.end_sites, motion.skeleton.end_sites, strict=True):
        assert (got.parent, got.before, got.name) == (want.parent, want.before, want.name)
        np.testing.assert_array_equal(got.offset, want.offset)
    write_bvh(again, tmp_path / "again.bvh")


@pytest.mark.parametrize("content", [b"", b"PK\3\4broken", b"no archive", None])
def test_what_is_no_npz_of_a_motion_is_named(tmp_path, content):
    path = tmp_path / "m.npz"
    if content is None:
        np.savez(path, x=np.zeros(3))
    else:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=r"m\.npz"):
        read_npz(path)
    with pytest.raises(FileNotFoundError):
        read_npz(tmp_path / "none.npz")


def test_csv_is_a_table_of_where_joints_are(motion, tmp_path):
    write_csv(motion, tmp_path / "m.csv")
    rows = list(csv.reader(io.StringIO((tmp_path / "m.csv").read_text())))
    assert rows[0][:5] == ["frame", "time", "Hips.x", "Hips.y", "Hips.z"]
    table = np.array(rows[1:], float)
    np.testing.assert_array_equal(table[:, 0], np.arange(motion.n_frames))
    np.testing.assert_allclose(table[:, 1], np.arange(motion.n_frames) / 30, rtol=1e-8)
    world = motion.world_positions().reshape(motion.n_frames, -1)
    np.testing.assert_allclose(table[:, 2:], world, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", [*HOSTILE_NAMES, "=HYPERLINK(1)", 'a,"b"\n', "-1+2", "@x"])
def test_names_in_exports_stay_names(motion, tmp_path, name):
    skeleton = replace(motion.skeleton, names=(name, name, *motion.skeleton.names[2:]))
    evil = replace(motion[:5], skeleton=skeleton, name=name)
    plain = name.encode("utf-8", "replace").decode()
    write_csv(evil, tmp_path / "m.csv")
    text = (tmp_path / "m.csv").read_bytes().decode("utf-8")
    rows = list(csv.reader(io.StringIO(text, newline="")))
    assert [len(row) for row in rows] == [2 + 3 * 18] * 6
    formula = "'" if plain[:1] in ("=", "-", "@") else ""
    assert rows[0][2] == f"{formula}{plain}~0.x"
    write_npz(evil, tmp_path / "m.npz")
    # NumPy drops zeros at the end of a text.
    assert read_npz(tmp_path / "m.npz").name == plain.rstrip("\0")
    write_glb(evil, tmp_path / "m.glb")
    document = Glb(tmp_path / "m.glb").document
    assert document["nodes"][0]["name"] == plain
    assert document["animations"][0]["name"] == (plain or "motion")


def test_export_on_the_command_line(motion, tmp_path, capsys):
    write_bvh(motion, tmp_path / "a.bvh")
    source = str(tmp_path / "a.bvh")
    for ending in ("glb", "npz", "csv"):
        target = tmp_path / f"x.{ending}"
        assert main(["export", source, "-o", str(target)]) == 0
        told = capsys.readouterr()
        assert told.out.strip() == str(target)
        assert ("y up" if ending == "glb" else "unit and axes of") in told.err
        before = target.read_bytes()
        assert main(["export", source, "-o", str(target)]) == 1
        assert target.read_bytes() == before
    assert main(["export", source, source, "-o", str(tmp_path / "y.glb"), "--scale", "cm"]) == 0
    capsys.readouterr()
    options = ["-o", str(tmp_path / "z.glb"), "--scale", "0.02", "--rate", "15", "--json"]
    assert main(["export", source, *options]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mograft.export/1"
    assert document["metres_in_a_unit"] == 0.02
    assert document["rate"] == pytest.approx(15, rel=0.02)
    assert main(["export", source, "-o", str(tmp_path / "z.bvh"), "--rate", "15"]) == 0
    assert read_bvh(tmp_path / "z.bvh").n_frames == document["frames"][0]


@pytest.mark.parametrize(
    "arguments",
    [
        ["a.bvh", "-o", "x.fbx"],
        ["a.bvh", "-o", "x.txt"],
        ["a.bvh", "b.bvh", "-o", "x.npz"],
        ["a.bvh", "-o", "x.npz", "--scale", "cm"],
        ["a.bvh", "-o", "x.glb", "--scale", "0"],
        ["a.bvh", "-o", "x.glb", "--scale", "feet"],
        ["a.bvh", "-o", "x.glb", "--rate", "-1"],
    ],
)
def test_wrong_usage_of_export_ends_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["export", *arguments])
    assert stop.value.code == 2
    assert capsys.readouterr().err


@pytest.mark.client
def test_the_khronos_validator_finds_nothing_to_say(motion, tmp_path):
    validate = gltf_validator()
    rng = np.random.default_rng(0)
    lone = Skeleton(["x"], [-1], [[0, 0, 0]], end_sites=(EndSite(0, [0, 0, 0]),))
    many = own.skeletons(rng, 300)
    quats = own.wander(rng, 3, 300)
    motions = {
        "dance": motion,
        "two": [motion, motion[:1]],
        "lone": Motion(lone, 0.1, [[[0, 0, 0, 1]]], [[[0, 0, 0]]]),
        "many": Motion(many, 0.1, quats, np.tile(many.offsets, (3, 1, 1))),
        "far": replace(motion, positions=motion.positions + 1e5),
        "hostile": replace(motion, name=HOSTILE_NAMES[-2]),
    }
    for name, item in motions.items():
        write_glb(item, tmp_path / f"{name}.glb")
        assert validate(tmp_path / f"{name}.glb") == [], name


@pytest.mark.client
@pytest.mark.parametrize("ending", ["bvh", "glb"])
def test_blender_sees_joints_where_we_do(motion, tmp_path, ending):
    run = blender()
    path = tmp_path / f"m.{ending}"
    scale = 1.0
    if ending == "bvh":
        write_bvh(motion, path)
    else:
        scale = write_glb(motion, path)
    frames = [0, 1, 44, motion.n_frames - 1]
    told = run(path, frames, motion.rate)
    height = scale * mass_model(motion.skeleton).height
    world = scale * motion.world_positions()[frames]
    names = motion.skeleton.names
    got = np.array([[heads[name] for name in names] for heads in told["heads"]])
    # Blender has z up.
    want = np.stack([world[..., 0], -world[..., 2], world[..., 1]], axis=-1)
    assert np.abs(got - want).max() < 1e-4 * height


def test_clients_are_found_or_said_to_be_absent(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.delenv("MOGRAFT_BPY_PYTHON", raising=False)
    for client in (gltf_validator, blender):
        with pytest.raises(pytest.skip.Exception):
            client()
    assert subprocess.run(["true"], check=False).returncode == 0
