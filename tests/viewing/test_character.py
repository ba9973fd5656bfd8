"""The mesh of a character on a page: its vertices, what three.js shows of it, and refusals."""

import base64
import copy
import io
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import mograft as mg
from mograft.cli import main
from mograft.errors import FormatError
from mograft.io.export_figure import ExportTransform, bone_mesh
from mograft.io.formats import read_clip
from mograft.io.glb import write_glb
from mograft.io.gltf.container import read_container
from mograft.viewing import character as module
from mograft.viewing.character import read_character
from release import three
from tests import strategies
from tests.browser import open_page, wait_until
from tests.io.gltf_scenes import pack_glb
from tests.io.recorded_files import DATA, require
from tests.viewing.page_content import page_data, shown

KNIGHT = DATA / "glb" / "kaykit_Knight.glb"
TYPES = {"f4": "<f4", "u2": "<u2", "u4": "<u4"}


def as_character(motion, path):
    """Write a motion with the bones of mograft under another name, as the mesh of a character."""
    write_glb(motion, path)
    file = read_container(path)
    file.document["meshes"][0]["name"] = "body"
    path.write_bytes(pack_glb(file.document, bytes(file.binary)))
    return file.document, bytes(file.binary)


def arrays_of(found, part):
    """Return the decoded arrays of a part of a character."""
    return {
        name: np.frombuffer(
            zlib.decompress(base64.b64decode(found["arrays"][own["key"]])), TYPES[own["type"]]
        ).reshape(-1, own["width"])
        for name, own in part["attributes"].items()
    }


@settings(max_examples=20)
@given(strategies.motions(max_frames=2))
def test_read_character_vertices_at_rest_equal_those_of_the_file(tmp_path_factory, motion):
    path = tmp_path_factory.mktemp("glb") / "body.glb"
    as_character(motion, path)
    clip = read_clip(str(path))
    found = read_character(path, clip.skeleton)
    (part,) = found["parts"]
    arrays = arrays_of(found, part)
    want, _, joints, _ = bone_mesh(motion.skeleton, ExportTransform.of(motion, None))
    np.testing.assert_array_equal(arrays["skinIndex"][:, 0], joints)
    np.testing.assert_array_equal(arrays["index"][:, 0], np.arange(len(want)))
    matrices = np.reshape(found["inverses"], (-1, 4, 4)).transpose(0, 2, 1)[joints]
    local = np.einsum("nij,nj->ni", matrices[:, :3, :3], arrays["position"]) + matrices[:, :3, 3]
    rest = clip.skeleton.rest_positions()
    size = max(float(np.abs(want).max()), 1e-3)
    np.testing.assert_allclose(local + rest[joints], want, atol=1e-5 * size)


CHANGES = {
    "KHR_draco": lambda d: d.update(extensionsUsed=["KHR_draco_mesh_compression"]),
    "KHR_texture_basisu": lambda d: d.update(extensionsUsed=["KHR_texture_basisu"]),
    "morph targets": lambda d: primitive(d).update(targets=[{"POSITION": 0}]),
    "more than four joints": lambda d: primitive(d)["attributes"].update(JOINTS_1=0),
    "2 skins": lambda d: add_skin(d),
    "triangles only": lambda d: primitive(d).update(mode=1),
    "expected attributes": lambda d: primitive(d).update(attributes=3),
    "expected an index": lambda d: primitive(d).update(material=7),
}
"""What the page states of a mesh, and the change that makes it so."""


def primitive(document):
    return document["meshes"][0]["primitives"][0]


def add_skin(document):
    document["skins"].append(document["skins"][0])
    document["nodes"].append(dict(document["nodes"][-1], skin=1))
    document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)


@pytest.mark.parametrize("reason", CHANGES)
def test_view_states_why_a_mesh_is_not_shown(motion, tmp_path, reason):
    path = tmp_path / "body.glb"
    document, binary = as_character(motion[:5], path)
    assert shown(path)["clips"][0]["character"] == 0
    CHANGES[reason](document)
    path.write_bytes(pack_glb(document, binary))
    data = shown(path)
    assert data["characters"] == []
    assert data["clips"][0]["character"] is None
    assert "Figures are capsules, not the mesh of body.glb" in data["note"]
    assert reason in data["note"]


@pytest.mark.parametrize("name", ["MAX_TRIANGLES", "MAX_BYTES"])
def test_view_states_the_size_of_a_large_mesh(motion, tmp_path, monkeypatch, name):
    path = tmp_path / "body.glb"
    as_character(motion[:5], path)
    monkeypatch.setattr(module, name, 100)
    note = shown(path)["note"]
    assert "exceed 100; reduce the mesh" in note or "MB exceed 0 MB" in note


def test_read_character_other_joints_or_rest_pose_raise_format_error(motion, tmp_path):
    path = tmp_path / "body.glb"
    as_character(motion[:5], path)
    own = read_clip(str(path)).skeleton
    bent = own.with_offsets(own.offsets + np.eye(own.n_joints, 3))
    with pytest.raises(FormatError, match="expected the rest pose of the motion"):
        read_character(path, bent)
    with pytest.raises(FormatError, match="expected the joints of the motion"):
        read_character(path, mg.Skeleton(["x"], [-1], [[0, 0, 0]]))


JSON = st.none() | st.integers(-2, 9) | st.text(max_size=3) | st.just([]) | st.just({})


@settings(max_examples=60)
@given(st.data())
def test_view_damaged_meshes_never_fail(motion, tmp_path_factory, data):
    """A mesh is shown or refused with a reason; the motion is shown in any case."""
    path = tmp_path_factory.mktemp("glb") / "body.glb"
    document, binary = as_character(motion[:3], path)
    document = copy.deepcopy(document)
    document["textures"] = [{"source": 0}]
    document["images"] = [{"uri": "data:image/png;base64,AAAA"}]
    surface = document["materials"][0]["pbrMetallicRoughness"]
    surface["baseColorTexture"] = {"index": 0}
    places = [primitive(document), document["materials"][0], surface, document["textures"][0]]
    place = data.draw(st.sampled_from([*places, document["images"][0]]))
    place[data.draw(st.sampled_from(sorted(place)))] = data.draw(JSON)
    path.write_bytes(pack_glb(document, binary))
    found = shown(path)
    assert (found["clips"][0]["character"] is None) == ("capsules" in found["note"])


def test_view_command_shows_bvh_with_character(motion, tmp_path, succeed, fail):
    body, page = tmp_path / "body.glb", tmp_path / "page.html"
    as_character(motion[:5], body)
    mg.write_bvh(motion[:30], tmp_path / "a.bvh")
    words = ["view", tmp_path / "a.bvh", "-o", page]
    succeed(*words, "--character", body)
    assert '"character":0' in page.read_text(encoding="utf-8")
    told = fail(3, *words, "--force", "--character", tmp_path / "a.bvh")
    assert "a.bvh: expected a glTF file" in told
    other = (tmp_path / "a.bvh").read_text(encoding="utf-8").replace("JOINT ", "JOINT other_")
    (tmp_path / "a.bvh").write_text(other, encoding="utf-8")
    _, told = succeed(*words, "--force", "--character", body)
    assert "warning: Figures are capsules, not the mesh of body.glb" in told


@pytest.fixture(scope="module")
def loader(tmp_path_factory):
    """The loader of three.js as a script."""
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    entry = Path(__file__).with_name("gltf_loader.js").read_text(encoding="utf-8")
    try:
        script = three.bundle(entry)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"the registry of npm is not available: {error}")
    path = tmp_path_factory.mktemp("loader") / "loader.js"
    path.write_bytes(script)
    return path


def graft_knight(folder, *options):
    """Write grafts into a copy of the Knight; return the file."""
    target = folder / "long.glb"
    assert main(["graft", str(require(KNIGHT)), "-o", str(target), *options]) == 0
    return target


@pytest.mark.browser
def test_viewer_mesh_moves_as_by_the_loader_of_three(browser, loader, tmp_path):
    """The matrices of all joints that move vertices, at 20 times, to 1e-5."""
    target = graft_knight(tmp_path, "-n", "2", "--report")
    with open_page(browser, target.with_suffix(".html")) as page:
        data = page_data(mg.Page("", target.with_suffix(".html").read_text(encoding="utf-8")))
        index = len(data["clips"]) - 1
        clip = data["clips"][index]
        used = {joint for part in data["characters"][0]["parts"] for joint in moved(data, part)}
        assert len(used) > 15
        frames = np.linspace(0, clip["frames"] - 1, 20).astype(int).tolist()
        shown = []
        for frame in frames:
            page.evaluate(f"mograft.seek({frame})")
            shown.append(np.reshape(page.evaluate(f"mograft.skin({index})"), (-1, 4, 4)))
    page = browser.new_page()
    page.add_script_tag(path=str(loader))
    text = base64.b64encode(target.read_bytes()).decode()
    times = [frame * clip["dt"] for frame in frames]
    played = page.evaluate("values => play(...values)", [text, clip["name"], times])
    page.close()
    names = read_clip(f"{target}#{clip['name']}").skeleton.names
    for ours, theirs in zip(shown, played, strict=True):
        for joint in used:
            want = np.reshape(theirs[names[joint]], (4, 4))
            np.testing.assert_allclose(ours[joint], want, atol=1e-5, err_msg=names[joint])


CAMERA = """() => {
  const { root } = mograft.actorOf(mograft.scene.clips[0]);
  const sun = root.parent.children.find((own) => own.isDirectionalLight);
  const paper = getComputedStyle(document.body).backgroundColor;
  const light = [sun, sun.target].map(({ position }) => position.toArray());
  return { ...window.camera, light, paper };
}"""
LISTEN = """() => {
  const [mesh] = mograft.actorOf(mograft.scene.clips[0]).meshes;
  mesh.onBeforeRender = (_, __, { projectionMatrix, matrixWorld }) => {
    window.camera = { projection: projectionMatrix.toArray(), place: matrixWorld.toArray() };
  };
}"""
ONLY_STAGE = """() => {
  const names = ".viewer > :not(.stage), [data-part=captions], [data-part=marks]";
  for (const own of document.querySelectorAll(names)) own.style.display = "none";
}"""
MAX_SHARE = 0.001
"""Share of the pixels that may differ from those of the loader by more than 8 of 255: edges."""


@pytest.mark.browser
def test_viewer_mesh_looks_as_by_the_loader_of_three(browser, loader, tmp_path, request):
    """The pictures of a graft of the Knight; at 20 times in a thorough run."""
    n_times = 20 if request.config.getoption("--thorough") else 5
    target = graft_knight(tmp_path)
    motion = mg.read(target)[-1]
    path = mg.view(motion, show=False).save(tmp_path / "page.html")
    theirs = browser.new_page(viewport={"width": 640, "height": 480})
    theirs.add_script_tag(path=str(loader))
    text = base64.b64encode(target.read_bytes()).decode()
    theirs.evaluate("values => draw(...values)", [text, motion.name])
    with open_page(browser, path, 640, 470) as page:
        page.evaluate(ONLY_STAGE)
        page.keyboard.press("g")  # no floor and no shadow
        page.evaluate(LISTEN)
        page.set_viewport_size({"width": 640, "height": 480})
        wait_until(page, "document.querySelector('[data-part=stage]').height === 480")
        for frame in np.linspace(0, motion.n_frames - 1, n_times).astype(int).tolist():
            page.evaluate(f"mograft.seek({frame})")
            view = page.evaluate(CAMERA)
            theirs.evaluate("values => show(...values)", [frame * motion.frame_time, view])
            shown, want = (
                np.asarray(Image.open(io.BytesIO(own.screenshot())).convert("RGB"), int)
                for own in (page, theirs)
            )
            paper = want[0, 0]
            assert (np.abs(want - paper).max(axis=-1) > 8).mean() > 0.05  # a figure is drawn
            share = (np.abs(shown - want).max(axis=-1) > 8).mean()
            assert share <= MAX_SHARE, (frame, share)
    theirs.close()


def moved(data, part):
    """Return the joints that move vertices of a skinned part."""
    if part["isRigid"]:
        return set()
    arrays = arrays_of(data["characters"][0], part)
    return set(arrays["skinIndex"][arrays["skinWeight"] > 0].tolist())
