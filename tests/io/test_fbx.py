"""Laws of the FBX reader: world transforms, rest poses, takes, joints and recorded files."""

import resource
import struct
import sys
import zlib
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

import mograft as mg
from tests.fuzz import fbx as fuzz_fbx
from tests.io import fbx_scenes as fbx
from tests.io.fbx_scenes import Layer, Node, Scene, Take
from tests.io.recorded_files import DATA, require
from tests.strategies import SEEDS, few_examples

FOLDER = DATA / "fbx"
FILES = sorted(FOLDER.glob("*.fbx"))
SIGNED_AXES = [
    tuple(zip(order, signs, strict=True))
    for order in ((1, 2, 0), (2, 1, 0), (0, 1, 2))
    for signs in ((1, 1, 1), (1, -1, 1), (-1, 1, -1))
]
pytestmark = fbx.needs_extension()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fbx")


def read_scene(folder, scene, container="binary 7400", **options):
    path = folder / "scene.fbx"
    path.write_bytes(fbx.CONTAINERS[container](scene))
    return mg.read(path, **options)


def random_scene(rng, n_nodes=4, n_frames=3, *, is_scaled=True, inherit=1, **settings):
    """Return a scene in which every value of every node is random."""

    def vector(size):
        return tuple(rng.uniform(-size, size, 3))

    def scales(shape):
        return rng.uniform(0.5, 2.0, shape) if is_scaled else np.ones(shape)

    sizes = dict.fromkeys(fbx.VECTORS, 1) | {"T": 10, "R": 170, "pre": 170, "post": 170}
    nodes = [
        Node(
            f"joint{number}",
            int(rng.integers(number)) if number else -1,
            S=tuple(scales(3)),
            order=int(rng.integers(6)),
            inherit=inherit,
            **{name: vector(size) for name, size in sizes.items()},
        )
        for number in range(n_nodes)
    ]
    tracks, shape = {}, (n_frames, 3)
    for number, key in product(range(n_nodes), "TRS"):
        if rng.random() < 0.8:
            is_scale, size = key == "S", sizes.get(key)
            tracks[number, key] = scales(shape) if is_scale else rng.uniform(-size, size, shape)
    return Scene(tuple(nodes), (Take("walk", n_frames, (Layer(tracks),), first=2),), **settings)


def preorder(scene):
    """Return the numbers of the nodes with every node before the nodes below it."""

    def below(number):
        children = [n for n, node in enumerate(scene.nodes) if node.parent == number]
        return [number, *(n for child in children for n in below(child))]

    return below(0)


def nearest_turns(linear):
    return np.array([[polar(m * np.sign(np.linalg.det(m)))[0] for m in frame] for frame in linear])


def assert_matches_equations(motion, scene, rest):
    """Compare world transforms with the equations; `rest` has the rest rotations (N, 3, 3)."""
    nodes = preorder(scene)
    positions, linear = fbx.positions_and_turns(scene, scene.takes[0])
    assert motion.skeleton.names == tuple(scene.nodes[n].name for n in nodes)
    size = np.abs(positions).max() + 1.0
    np.testing.assert_allclose(motion.world_positions(), positions[:, nodes], atol=1e-5 * size)
    expected = nearest_turns(linear[:, nodes]) @ np.swapaxes(rest[nodes], -1, -2)
    turned, _ = motion.world_transforms()
    found = Rotation.from_quat(turned.reshape(-1, 4)).as_matrix().reshape(expected.shape)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def static_rest(scene):
    """Return the positions and rotations of the pose without animation."""
    worlds = fbx.world_matrices(scene, fbx.static_values(scene))
    linear = fbx.axis_conversion(scene) @ worlds[:, :3, :3]
    return worlds[:, :3, 3] @ fbx.axis_conversion(scene).T, nearest_turns(linear[None])[0]


@few_examples(25)
@given(
    seed=SEEDS,
    container=st.sampled_from(sorted(fbx.CONTAINERS)),
    axes=st.sampled_from(SIGNED_AXES),
    kind=st.sampled_from([(False, 1), (True, 0), (True, 1), (True, 2)]),
)
def test_fbx_random_scene_matches_equations_of_fbx(folder, seed, container, axes, kind):
    """World axes become right-handed with y up; the unit is stated, and lengths are kept."""
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, is_scaled=kind[0], inherit=kind[1], axes=axes, unit=2.54)
    clips = read_scene(folder, scene, container)
    motion = clips[0]
    assert (motion.name, motion.n_frames, motion.rate) == ("scene", 3, pytest.approx(30))
    positions, rest = static_rest(scene)
    assert_matches_equations(motion, scene, rest)
    nodes = preorder(scene)
    found, extent = motion.skeleton.rest_positions(), np.ptp(positions, axis=0).max()
    np.testing.assert_allclose(found, positions[nodes], atol=1e-5 * extent)
    assert clips.notes[0] == "lengths are in units of 0.0254 m"
    is_converted = any("axes" in note for note in clips.notes)
    assert is_converted == (axes != Scene((), ()).axes)


@pytest.mark.parametrize("container", sorted(fbx.CONTAINERS))
def test_fbx_bind_pose_is_the_rest_pose(folder, container):
    rng = np.random.default_rng(8)
    scene = random_scene(rng, n_nodes=3)
    turns = Rotation.random(3, random_state=8).as_matrix()
    bind = {n: np.eye(4) for n in range(3)}
    for number, matrix in bind.items():
        matrix[:3, :3] = turns[number] * rng.uniform(0.5, 2.0)
        matrix[:3, 3] = rng.uniform(-10, 10, 3)
    motion = read_scene(folder, replace(scene, bind=bind), container)[0]
    positions = np.array([bind[n][:3, 3] for n in preorder(scene)])
    np.testing.assert_allclose(motion.skeleton.rest_positions(), positions, atol=1e-9)
    assert_matches_equations(motion, scene, turns)


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize("weight", [100.0, 25.0])
def test_fbx_animation_layers_are_combined(folder, mode, weight):
    rng = np.random.default_rng(3)
    base, other = ({(0, k): rng.uniform(-40, 40, (4, 3)) for k in "TR"} for _ in range(2))
    # The weight of a layer that overrides has no effect in the equations.
    layers = (Layer(base), Layer(other, mode, 100.0 if mode == 1 else weight))
    scene = Scene((Node("root"),), (Take("walk", 4, layers),))
    assert_matches_equations(read_scene(folder, scene)[0], scene, np.eye(3)[None])


@given(rate=st.floats(1.0, 200.0), seed=SEEDS)
@example(rate=65.99988814717312, seed=0)
@few_examples(25)
def test_fbx_given_rate_samples_keys_over_exact_duration(folder, rate, seed):
    values = np.random.default_rng(seed).uniform(-10, 10, (6, 3))
    scene = Scene((Node("root"),), (Take("walk", 6, (Layer({(0, "T"): values}),), first=7),))
    clips = read_scene(folder, scene, rate=rate)
    motion, duration = clips[0], 5 / 30
    assert motion.n_frames == clips.count_frames(0)
    # The reader takes less than 1e-4 of an interval beyond a whole number of them as rounding.
    expected_duration = duration if motion.n_frames > 1 else 0.0
    assert motion.duration == pytest.approx(expected_duration, abs=1e-4 * motion.frame_time)
    assert abs((motion.n_frames - 1) - duration * rate) <= 0.5 + 1e-9 or motion.n_frames == 2
    times = np.arange(motion.n_frames) * motion.frame_time
    keys = np.arange(6) / 30
    expected = np.stack([np.interp(times, keys, column) for column in values.T], axis=1)
    np.testing.assert_allclose(motion.positions[:, 0], expected, atol=1e-4)


def test_fbx_takes_are_clips_with_different_names(folder):
    names = ("walk", "run", "walk", "")
    layers = [Layer({(0, "T"): np.full((2 + n, 3), n)}) for n in range(4)]
    takes = [Take(name, 2 + n, (layers[n],)) for n, name in enumerate(names)]
    clips = read_scene(folder, Scene((Node("root"),), tuple(takes)))
    assert clips.names == ("walk", "run", "walk~2", "take4")
    assert [motion.n_frames for motion in clips] == [2, 3, 4, 5]
    assert clips["walk~2"].positions[0, 0].tolist() == [2.0, 2.0, 2.0]


def null(name, parent=-1):
    return Node(name, parent, kind="Null")


HERO = (
    null("scale"),
    Node("hips", 0),
    null("twist", 1),
    Node("hand", 2),
    null("sword", 3),
    null("camera"),
)
NULLS = (null("a"), null("b", 0), null("c"))


@pytest.mark.parametrize(
    ("nodes", "animated", "names", "note"),
    [
        (HERO, [5], ("hips", "twist", "hand"), "node scale, node sword, node camera"),
        (NULLS, [1, 2], ("scene", "a", "b", "c"), ""),  # without bones, the animated nodes
        (NULLS, [], None, "so that there are no clips"),
        ((Node("hi\nps\t"), Node(" ", 0)), [0], ("hi_ps_", "node2"), ""),
    ],
)
def test_fbx_joints_are_bones_or_animated_nodes_and_nodes_between(
    folder, nodes, animated, names, note
):
    layer = Layer({(node, "T"): np.ones((2, 3)) for node in animated})
    clips = read_scene(folder, Scene(nodes, (Take("walk", 2, (layer,)),)))
    assert [clip.skeleton.names for clip in clips] == ([names] if names else [])
    assert any(own.endswith(note) for own in clips.notes)


@pytest.mark.parametrize("pose", ["bind", "stance"])
def test_fbx_recorded_pose_matches_bvh_of_same_figure(pose):
    clip = mg.read(require(FOLDER / f"Geno_{pose}.fbx"))[0]
    twin = mg.read_bvh(require(FOLDER / f"Geno_{pose}.bvh"))
    assert clip.skeleton.names == twin.skeleton.names
    np.testing.assert_array_equal(clip.skeleton.parents, twin.skeleton.parents)
    assert (clip.n_frames, round(clip.rate)) == (twin.n_frames, round(twin.rate))
    expected = twin.world_positions()
    height = np.ptp(expected[0, :, 1])
    np.testing.assert_allclose(clip.world_positions(), expected, atol=1e-7 * height, rtol=0)


@pytest.mark.parametrize("take", ["Base", "Spin", "Wiggle"])
def test_fbx_recorded_text_6100_matches_binary_7400_that_blender_reads(take):
    """A client test compares the binary file with the importer of Blender, which reads no text."""
    old = mg.read(require(FOLDER / "ufbx_blender_279_sausage_6100_ascii.fbx"))[take]
    clips = mg.read(require(FOLDER / "ufbx_blender_279_sausage_7400_binary.fbx"))
    new = clips[f"Skeleton|{take}"]
    for name in ("Bottom", "Middle", "Top"):
        places = (own.world_positions()[:, own.skeleton.index(name)] for own in (old, new))
        np.testing.assert_allclose(*places, atol=1e-5)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_fbx_recorded_file_gives_finite_motions_of_stated_length(path):
    clips = mg.read(path)
    for index, (motion, name) in enumerate(zip(clips, clips.names, strict=True)):
        assert (motion.n_frames, motion.name) == (clips.count_frames(index), name)
        assert np.isfinite(motion.world_positions()).all()
    assert len(clips) or "no clips" in clips.notes[-1]


def test_fbx_without_extension_error_names_installation(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mograft_fbx", None)
    path = tmp_path / "walk.fbx"
    path.write_bytes(b"; FBX 7.4.0 project file\n")
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'mograft\[fbx\]'"):
        mg.read(path)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "walk.fbx"


HIPS = (Node("hips"),)


def scene_of(nodes=HIPS, value=1.0):
    """Return a scene of two frames, in which the first node is moved by a value."""
    layer = Layer({(0, "T"): np.full((2, 3), value)})
    return Scene(tuple(nodes), (Take("walk", 2, (layer,)),))


def binary(*values):
    return fbx.to_binary(scene_of(*values))


def scaled(scale):
    """Return a chain whose scales multiply."""
    return Node("hips", S=(scale,) * 3), Node("spine", 0, S=(scale,) * 3), Node("head", 1)


def with_version(version):
    return binary().replace(struct.pack("<I", 7400), struct.pack("<I", version), 1)


def changed_text(old, new):
    data = fbx.to_text(scene_of())
    assert data.count(old) == 1
    return data.replace(old, new)


MAGIC = b"Kaydara FBX Binary  \0\x1a\0"
UNREADABLE = "expected an FBX file, got one that the library ufbx cannot read: "


STOP = b'"LocalStop", "KTime", "Time", "", %d'
FAR = Node("spine", 0, T=(1e200, 0, 0))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", UNREADABLE),
        (b"no FBX", UNREADABLE),
        (MAGIC, UNREADABLE),
        (MAGIC + b"\xe8\x1c\0\0" + 99 * b"\xff", UNREADABLE),
        (with_version(6000), r"version.*\D6000\b"),
        (with_version(7800), r"version.*\D7800\b"),
        (
            changed_text(STOP % (fbx.TICKS // 30), STOP % (fbx.TICKS // 30 * 3 * 10**8)),
            r"take 'walk': expected at most 2097152 frames",
        ),
        (binary(Node(f"{n}", n - 1) for n in range(1001)), "Node depth limit exceeded"),
        (binary(scaled(1.0), np.nan), "take 'walk': expected finite transforms"),
        (binary(scaled(1.0), np.inf), "take 'walk': expected finite transforms"),
        (binary((Node("hips"), FAR)), "take 'walk': `offsets` must be at most 1e.100, got 1e.200"),
        # Finite in the file, and not after the scales.
        (binary(scaled(1e308), 3e38), "expected a finite rest pose"),
    ],
    ids=range(12),
)
def test_fbx_invalid_file_is_refused(path, data, message):
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=message) as caught:
        mg.read(path)[0]
    assert str(caught.value).startswith(f"{path}: ")


def test_fbx_frame_rate_that_is_not_credible_needs_rate(path):
    mode = b'"TimeMode", "enum", "", "", 6'
    rate = b'4\n\t\tP: "CustomFrameRate", "double", "Number", "", 1e300'
    path.write_bytes(changed_text(mode, mode[:-1] + b"1" + rate))
    with pytest.raises(mg.FormatError, match=r"GlobalSettings: expected a frame time .*1e-300"):
        mg.read(path)
    assert mg.read(path, rate=30)[0].n_frames == 2


def test_fbx_array_of_16_gib_is_refused_in_bounded_memory(path):
    packed = zlib.compress(bytes(1 << 20))
    array = b"l" + struct.pack("<III", 1 << 31, 1, len(packed)) + packed
    keys = np.arange(2) * (fbx.TICKS // 30)
    small = b"l" + struct.pack("<III", 2, 0, 16) + keys.astype("<i8").tobytes()
    data = binary()
    assert data.count(small) == 3
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    path.write_bytes(data.replace(small, array, 1))
    with pytest.raises(mg.FormatError, match="ufbx cannot read: Memory limit"):
        mg.read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


@pytest.mark.parametrize("seed", range(40))
def test_fbx_damaged_file_is_read_or_refused(tmp_path, seed):
    fuzz_fbx.check(seed, tmp_path)
