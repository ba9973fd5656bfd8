"""Characters: FBX files as GLB files with meshes, skin, base colours and takes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.cli import main
from mograft.io.character import open_character
from tests import clients
from tests.io import fbx_scenes as fbx
from tests.io.fbx_scenes import Layer, Mesh, Node, Scene, Take
from tests.io.gltf_scenes import read_primitives, skinned
from tests.io.recorded_files import DATA
from tests.strategies import SEEDS, few_examples

STARTS = ("quaternius", "Geno", "ufbx_blender_279_sausage")
FILES = [path for path in sorted((DATA / "fbx").glob("*.fbx")) if path.stem.startswith(STARTS)]
PNG = b"\x89PNG\r\n\x1a\n picture"
pytestmark = fbx.needs_extension()


@st.composite
def figures(draw):
    """Return a scene of three bones without scale and a skinned mesh."""
    rng = np.random.default_rng(draw(SEEDS))
    nodes = [Node("a", T=tuple(rng.normal(size=3)))]
    for name, parent in (("b", 0), ("c", 1), ("d", 0), ("e", 3)):
        vectors = {key: tuple(rng.uniform(-90, 90, 3)) for key in ("R", "pre")}
        nodes.append(Node(name, parent, T=tuple(rng.normal(size=3)), **vectors))
    tracks = {(i, "R"): rng.uniform(-90, 90, (4, 3)) for i in range(5)}
    take = Take("move", 4, (Layer(tracks),))
    n, n_influences = 9, draw(st.integers(1, 5))
    weights = np.zeros((5, n))
    for vertex in range(n):
        chosen = rng.choice(5, n_influences, replace=False)
        weights[chosen, vertex] = rng.uniform(0.1, 1.0, n_influences)
    faces = ((0, 1, 2), (3, 4, 5), (6, 7, 8))
    axes = draw(st.sampled_from([((1, 1), (2, 1), (0, 1)), ((2, 1), (1, -1), (0, 1))]))
    points, uvs, place = rng.normal(size=(n, 3)), rng.random((9, 2)), tuple(rng.normal(size=3))
    mesh = Mesh(points, faces, uvs, weights, place)
    return Scene(tuple(nodes), (take,), axes=axes, unit=2.5, meshes=(mesh,))


@few_examples(40)
@given(scene=figures())
def test_character_of_fbx_moves_as_linear_blend_skinning(tmp_path_factory, scene):
    file = open_scene(tmp_path_factory.mktemp("fbx"), scene)
    clip = mg.read(file.container.path)[0]
    take, conversion = scene.takes[0], 0.025 * fbx.axis_conversion(scene)
    (mesh,) = scene.meshes
    weights = np.where(mesh.weights >= np.sort(mesh.weights, axis=0)[-4], mesh.weights, 0.0)
    weights /= weights.sum(axis=0)
    bound = np.linalg.inv(fbx.world_matrices(scene, fbx.static_values(scene)))
    points = np.c_[mesh.points + mesh.place, np.ones(len(mesh.points))]
    expected = []
    for frame in range(take.n_frames):
        worlds = fbx.world_matrices(scene, fbx.values_in_frame(scene, take, frame)) @ bound
        moved = np.einsum("kij,vj->kvi", worlds, points)[..., :3]
        expected.append(np.einsum("kv,kvi->vi", weights, moved) @ conversion.T)
    ((found, _),) = read_primitives(file)
    motion = clip_of(file)
    actual = skinned(file, motion, found)[:, found["indices"]]
    size = np.abs(expected).max()
    np.testing.assert_allclose(actual, np.array(expected), atol=1e-5 * size)
    assert motion.n_frames == clip.n_frames
    uvs = np.c_[mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]]
    np.testing.assert_allclose(found["TEXCOORD_0"][found["indices"]], uvs, atol=1e-6)


def clip_of(file):
    """Return the only motion of a character."""
    path = file.container.path.with_name("character.glb")
    path.write_bytes(bytes(file.container.data))
    return mg.read(path)[0]


def textured(texture, content=b"", color=(1.0, 1.0, 1.0)):
    uvs, weights, look = np.zeros((3, 2)), np.ones((1, 3)), (color, texture, content)
    mesh = Mesh(np.eye(3), ((0, 1, 2),), uvs, weights, (0, 0, 0), *look)
    take = Take("move", 2, (Layer({(0, "R"): np.array([[0, 0, 0], [9.0, 0, 0]])}),))
    return Scene((Node("a"),), (take,), meshes=(mesh,))


@pytest.mark.parametrize("place", ["embedded", "beside", "fbm", "missing", "outside", "no picture"])
def test_character_of_fbx_textures(tmp_path, place):
    folder = tmp_path / "inside"
    (folder / "scene.fbm").mkdir(parents=True)
    name = "../skin.png" if place == "outside" else "C:\\art\\skin.png"
    content = PNG if place == "embedded" else b"text" if place == "no picture" else b""
    files = {"beside": "inside/skin.png", "fbm": "inside/scene.fbm/skin.png", "outside": "skin.png"}
    if place in files:
        (tmp_path / files[place]).write_bytes(PNG)
    if place in ("missing", "outside", "no picture"):
        with pytest.warns(UserWarning, match=r"left out textures.*skin\.png"):
            file = open_scene(folder, textured(name, content))
        assert not file.container.items("images")
        return
    file = open_scene(folder, textured(name, content))
    (image,) = file.container.document["images"]
    view = file.container.items("bufferViews")[image["bufferView"]]
    start = view["byteOffset"]
    assert bytes(file.container.binary[start : start + view["byteLength"]]) == PNG
    (material,) = file.container.document["materials"]
    surface = material["pbrMetallicRoughness"]
    assert surface["baseColorTexture"] == {"index": 0}
    assert surface["baseColorFactor"] == [1, 1, 1, 1]


def test_character_of_fbx_has_base_colour_and_metres(tmp_path):
    """Also with a single bone."""
    scene = textured("", color=(0.25, 0.5, 0.75))
    moves = {(0, "T"): np.array([[0, 0, 0], [100.0, 0, 0]])}
    file = open_scene(tmp_path, replace(scene, takes=(Take("move", 2, (Layer(moves),)),)))
    (material,) = file.container.document["materials"]
    color = material["pbrMetallicRoughness"]["baseColorFactor"]
    np.testing.assert_allclose(color, [0.25, 0.5, 0.75, 1.0], atol=1e-6)
    places = clip_of(file).world_positions()[:, 0]
    np.testing.assert_allclose(places, [[0, 0, 0], [1, 0, 0]], atol=1e-6)
    assert open_scene(tmp_path, replace(scene, meshes=())) is None


def open_scene(folder, scene):
    """Return the character of a scene."""
    path = folder / "scene.fbx"
    path.write_bytes(fbx.to_binary(scene))
    return open_character(path)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_export_of_recorded_fbx_keeps_takes_and_meshes(path, tmp_path):
    target = tmp_path / "hero.glb"
    assert main(["export", str(path), "-o", str(target)]) == 0
    takes, clips = mg.read(path), mg.read(target)
    assert clips.names == takes.names
    for take, clip in zip(takes, clips, strict=True):
        old, new = take.world_positions(), clip.world_positions()
        scale = np.ptp(new) / np.ptp(old)
        np.testing.assert_allclose(new, scale * old, atol=1e-5 * np.ptp(new))
        assert clip.n_frames == take.n_frames
    file = open_character(target)
    n_triangles = 0
    for found, material in read_primitives(file):
        assert found["indices"].max() < len(found["POSITION"])
        n_triangles += len(found["indices"]) // 3
        np.testing.assert_allclose(np.linalg.norm(found["NORMAL"], axis=1), 1.0, atol=1e-4)
        np.testing.assert_allclose(found["WEIGHTS_0"].sum(axis=1), 1.0, atol=1e-5)
        assert material is None or material < len(file.container.document["materials"])
    assert n_triangles > 100


@pytest.mark.client
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_export_of_recorded_fbx_has_no_faults_for_the_validator(path, tmp_path):
    validate = clients.gltf_validator()
    assert main(["export", str(path), "-o", str(tmp_path / "hero.glb")]) == 0
    assert [own for own in validate(tmp_path / "hero.glb") if own["severity"] < 2] == []
