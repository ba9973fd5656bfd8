"""Options --match, --skeleton and --groups auto: clips of several figures, rest poses, groups."""

import json

import numpy as np
import pytest

import mograft as mg
from mograft import JointGroups, Library, formats
from mograft.io.smpl.body_models import SMPL_H, stand_in
from mograft.stream.server import StreamServer
from mograft.viewing.page import view
from tests.io.npz_files import amass_arrays, dance_arrays, write_arrays, write_rest_pose
from tests.library.test_matched_libraries import OTHER, PARTS


@pytest.fixture(scope="module")
def mixed_folder(tmp_path_factory):
    """A folder with clips of two figures."""
    folder = tmp_path_factory.mktemp("mixed")
    mg.write_bvh(PARTS["a"], folder / "a.bvh")
    formats.write_npz(OTHER["b"], folder / "b.npz")
    mg.write_bvh(PARTS["c"], folder / "c.bvh")
    return folder


@pytest.mark.parametrize("base", ["b.npz", "b", None])
def test_graft_match_anatomy_has_the_hierarchy_of_the_base(succeed, mixed_folder, tmp_path, base):
    path = base and str(mixed_folder / base) if base == "b.npz" else base
    words = ["graft", mixed_folder, "--match", "anatomy", "-o", tmp_path / "g.bvh"]
    err = succeed(*words, *(["--base", path] if path else []))[1]
    assert "joints matched by anatomy" in err
    expected = OTHER["b"] if base else PARTS["a"]
    result = mg.read_bvh(tmp_path / "g.bvh")
    assert result.skeleton.names == expected.skeleton.names
    document = json.loads((tmp_path / "g.json").read_text())
    assert document["library"]["match"] == "anatomy"
    succeed("graft", "--from", tmp_path / "g.json", "-o", tmp_path / "again.bvh")
    assert (tmp_path / "again.bvh").read_bytes() == (tmp_path / "g.bvh").read_bytes()


def test_graft_edit_of_matched_clips_builds_the_same_library(run, succeed, mixed_folder, tmp_path):
    words = ["--match", "anatomy", "--base", str(mixed_folder / "b.npz"), "-o", tmp_path / "g.bvh"]
    assert run("graft", mixed_folder, *words)[0] == 0
    succeed("graft", "--from", tmp_path / "g.json", "--ban", "2", "-o", tmp_path / "edit.bvh")


def test_info_match_anatomy_lists_joints_without_counterpart(run, succeed, mixed_folder, tmp_path):
    amass = write_arrays(tmp_path / "walk_poses.npz", amass_arrays())
    out = succeed(
        "info", mixed_folder / "a.bvh", mixed_folder / "b.npz", amass, "--match", "anatomy"
    )[0]
    assert "joints matched by anatomy: every joint has a counterpart" in out
    assert "joints matched by anatomy: dropped: " in out
    assert "note: offsets: a stand-in of 1.7 m" in out
    documents = json.loads(
        run("info", mixed_folder / "a.bvh", amass, "--match", "anatomy", "--json")[1]
    )
    assert [own["match"][:7] for own in documents["files"]] == ["", "dropped"]


def test_index_match_anatomy_keeps_match_and_refuses_it_with_add(
    succeed, mixed_folder, tmp_path, usage_error
):
    err = succeed("index", mixed_folder, "-o", tmp_path / "l", "--match", "anatomy")[1]
    assert "joints matched by anatomy, b" in err
    assert mg.Library.open(tmp_path / "l").spec.match == "anatomy"
    for words in (
        ("index", mixed_folder, "-o", tmp_path / "l", "--add", "--match", "names"),
        ("graft", tmp_path / "l", "--match", "anatomy", "-o", tmp_path / "g.bvh"),
    ):
        assert "--match is fixed when a library is created" in usage_error(*words)


@pytest.fixture
def body(tmp_path):
    """A file with a rest pose: the stand-in with bones that are 5 % longer."""
    skeleton = stand_in(SMPL_H)
    return write_rest_pose(skeleton.with_offsets(1.05 * skeleton.offsets), tmp_path / "body.bvh")


def test_skeleton_option_sets_the_rest_pose_of_amass_files(run, succeed, body, tmp_path):
    walk = write_arrays(tmp_path / "walk.npz", amass_arrays(n_frames=200))
    run_path = write_arrays(tmp_path / "run.npz", amass_arrays(n_frames=200, seed=1))
    expected = 1.05 * stand_in(SMPL_H).offsets
    out, _err = succeed("info", walk, "--skeleton", body)
    assert "note: offsets: those of the given skeleton" in out
    words = ["--skeleton", body, "-o"]
    assert run("export", walk, *words, tmp_path / "walk.bvh")[0] == 0
    written = mg.read_bvh(tmp_path / "walk.bvh").skeleton
    joint = written.names.index("right_knee")
    np.testing.assert_allclose(written.offsets[joint], expected[5], atol=1e-5)
    assert run("index", walk, run_path, *words, tmp_path / "l")[0] == 0
    library = mg.Library.open(tmp_path / "l")
    np.testing.assert_allclose(library.clips[1].skeleton.offsets, expected, atol=1e-12)
    for name, sources in (("a", [walk, run_path, *words[:2]]), ("b", [tmp_path / "l"])):
        succeed("graft", *sources, "--base", walk, "-o", tmp_path / f"{name}.bvh")
    # The clips are found again with the rest pose that the provenance records.
    succeed("graft", "--from", tmp_path / "a.json", "-o", tmp_path / "again.bvh")
    assert (tmp_path / "again.bvh").read_bytes() == (tmp_path / "a.bvh").read_bytes()


def test_skeleton_option_of_view_and_plot_sets_the_positions(succeed, body, tmp_path):
    walk = write_arrays(tmp_path / "walk.npz", amass_arrays(n_frames=200))
    page, picture, pictures = tmp_path / "page.html", tmp_path / "strip.svg", []
    succeed("view", walk, "--skeleton", body, "-o", page)
    motion = mg.read(walk, skeleton=mg.read(body)[0].skeleton)[0]
    assert page.read_bytes() == view(motion, show=False).html.encode()
    for words in ((), ("--skeleton", body)):
        succeed("plot", "strip", walk, *words, "--force", "-o", picture)
        pictures.append(picture.read_bytes())
    # The poses of a strip fill the picture, but the ends of the bones are not longer.
    assert pictures[0] != pictures[1]
    succeed("plot", "timeline", walk, "--skeleton", body, "-o", tmp_path / "timeline.svg")


def test_skeleton_option_of_check_and_groups_must_fit_the_file(run, body, tmp_path):
    walk = write_arrays(tmp_path / "walk.npz", amass_arrays(n_frames=200))
    other = write_rest_pose(mg.Skeleton(["nose"], [-1], [[0, 0, 1]]), tmp_path / "other.bvh")
    for words in (["check", walk], ["groups", walk], ["groups", walk, "--preset", "auto:2"]):
        assert run(*words, "--skeleton", body)[0] == 0
        code, _, err = run(*words, "--skeleton", other)
        assert code != 0
        assert "nose" in err


def test_match_option_of_plot_draws_clips_of_several_figures(
    run, succeed, mixed_folder, tmp_path, usage_error
):
    words = [mixed_folder, "--match", "anatomy", "-o"]
    for kind in ("pca", "timeline", "groups"):
        err = succeed("plot", kind, *words, tmp_path / f"{kind}.svg")[1]
        assert kind == "groups" or "joints matched by anatomy" in err
    assert run("plot", "pca", mixed_folder, "-o", tmp_path / "names.svg")[0] == 1
    message = usage_error("plot", "strip", *words, tmp_path / "strip.svg")
    assert "--match requires timeline, pca, dendrogram, clusters, groups" in message


def test_match_option_of_stream_serves_clips_of_several_figures(
    run, succeed, mixed_folder, monkeypatch
):
    served = []
    monkeypatch.setattr(StreamServer, "serve_forever", lambda server: served.append(server))
    assert run("stream", mixed_folder, "--port", "0")[0] == 1
    succeed("stream", mixed_folder, "--match", "anatomy", "--port", "0")
    (server,) = served
    monkeypatch.undo()
    with server:  # which closes the socket
        pass
    assert server.library.spec.match == "anatomy"


def test_graft_of_amass_files_keeps_poses_of_the_base_group(run, succeed, tmp_path):
    arrays = dance_arrays(0)
    walk = write_arrays(tmp_path / "walk.npz", arrays)
    wave = write_arrays(tmp_path / "wave.npz", dance_arrays(1))
    words = ["graft", walk, wave, "--set", "feet=never", "--seed", "4", "-o"]
    for target in ("g.bvh", "direct.npz"):
        succeed(*words, tmp_path / target)
    words = ("-o", tmp_path / "new.npz", "--like", walk)
    assert run("export", tmp_path / "g.bvh", *words)[0] == 0
    with np.load(tmp_path / "new.npz") as new, np.load(tmp_path / "direct.npz") as direct:
        np.testing.assert_allclose(new["poses"], direct["poses"], atol=1e-6)
        same = (direct["poses"] == arrays["poses"]).all(axis=0).reshape(-1, 3).all(axis=1)
        for name in ("betas", "gender", "dmpls", "trans"):
            np.testing.assert_array_equal(direct[name], arrays[name])
        same &= (new["poses"] == arrays["poses"]).all(axis=0).reshape(-1, 3).all(axis=1)
        np.testing.assert_array_equal(new["trans"], arrays["trans"])
    kept = {SMPL_H.joints[joint] for joint in np.flatnonzero(same)}
    legs = {f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle")}
    assert {"pelvis", *legs} <= kept
    assert not {"left_shoulder", "right_elbow"} & kept
    # The provenance makes the same arrays again.
    words = ("--from", tmp_path / "direct.json", "-o", tmp_path / "again.npz")
    assert run("graft", *words)[0] == 0
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "direct.npz").read_bytes()


def test_graft_to_npz_without_a_base_of_amass_writes_arrays_of_mograft(
    succeed, mixed_folder, tmp_path, usage_error
):
    own = mixed_folder / "b.npz"  # of mograft
    succeed("graft", own, "-n", "2", "-o", tmp_path / "g.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["g.npz"]
    assert mg.read(tmp_path / "g.npz").names == ("b_graft0", "b_graft1")
    usage_error("graft", own, "--digits", "7", "-o", tmp_path / "h.npz")


def test_automatic_groups_of_every_command_are_those_of_discover(run, succeed, folder, tmp_path):
    expected = mg.discover_groups(folder / "a.bvh", 3).groups
    path = tmp_path / "groups.toml"
    assert run("groups", folder / "a.bvh", "--preset", "auto:3", "-o", path)[0] == 0
    assert JointGroups.from_toml(path) == expected
    assert run("index", folder / "a.bvh", "-o", tmp_path / "lib", "--groups", "auto:3")[0] == 0
    assert Library.open(tmp_path / "lib").groups == expected
    out = succeed(
        "graft", folder / "a.bvh", "--groups", "auto:3", "-o", tmp_path / "x.bvh", "--json"
    )[0]
    (made,) = json.loads(out)["grafts"]
    assert set(made["groups"]) >= set(expected.names) - {expected.base}
    command = ["candidates", folder / "a.bvh", "--segment", 3, "--groups", "auto:3", "--json"]
    assert json.loads(succeed(*command)[0])["group"] == expected.names[1]


def test_automatic_groups_of_folder_use_all_files(run, folder, tmp_path):
    path = tmp_path / "groups.toml"
    assert run("groups", folder, "--preset", "auto", "-o", path)[0] == 0
    assert JointGroups.from_toml(path) == mg.discover_groups(folder).groups
