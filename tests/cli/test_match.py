"""Options --match, --skeleton and --groups auto: clips of several figures, rest poses, groups."""

import json

import numpy as np
import pytest

import mograft as mg
from mograft import JointGroups, Library, formats
from mograft.io.smpl.body_models import SMPL_H, stand_in
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


def test_info_match_anatomy_lists_joints_without_counterpart(succeed, mixed_folder, tmp_path):
    amass = write_arrays(tmp_path / "walk_poses.npz", amass_arrays())
    words = ["info", mixed_folder / "a.bvh", mixed_folder / "b.npz", amass, "--match", "anatomy"]
    out = succeed(*words)[0]
    assert "joints matched by anatomy: every joint has a counterpart" in out
    assert "joints matched by anatomy: dropped: " in out
    files = json.loads(succeed(*words, "--json")[0])["files"]
    assert [own["match"][:7] for own in files] == ["", "every j", "dropped"]


@pytest.fixture
def body(tmp_path):
    """A file with a rest pose: the stand-in with bones that are 5 % longer."""
    skeleton = stand_in(SMPL_H)
    return write_rest_pose(skeleton.with_offsets(1.05 * skeleton.offsets), tmp_path / "body.bvh")


def test_skeleton_option_sets_the_rest_pose_of_amass_files(succeed, body, tmp_path):
    walk = write_arrays(tmp_path / "walk.npz", amass_arrays(n_frames=200))
    expected = 1.05 * stand_in(SMPL_H).offsets
    words = ["--skeleton", body, "-o"]
    succeed("export", walk, *words, tmp_path / "walk.bvh")
    written = mg.read_bvh(tmp_path / "walk.bvh").skeleton
    joint = written.names.index("right_knee")
    np.testing.assert_allclose(written.offsets[joint], expected[5], atol=1e-5)
    succeed("index", walk, *words, tmp_path / "l")
    offsets = mg.Library.open(tmp_path / "l").clips[0].skeleton.offsets
    np.testing.assert_allclose(offsets, expected, atol=1e-12)
    # A base outside of the library, and the clips of a record, are read with this rest pose.
    succeed("graft", tmp_path / "l", "--base", walk, "-o", tmp_path / "b.bvh")
    succeed("graft", walk, *words, tmp_path / "a.bvh")
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
    for kind in ("pca", "timeline"):
        err = succeed("plot", kind, *words, tmp_path / f"{kind}.svg")[1]
        assert "joints matched by anatomy" in err
    assert run("plot", "pca", mixed_folder, "-o", tmp_path / "names.svg")[0] == 1
    message = usage_error("plot", "strip", *words, tmp_path / "strip.svg")
    assert "--match requires timeline, pca, dendrogram" in message


def test_export_like_amass_file_keeps_its_other_arrays(run, tmp_path):
    arrays = dance_arrays(0)
    walk = write_arrays(tmp_path / "walk.npz", arrays)
    assert run("export", walk, "-o", tmp_path / "walk.bvh")[0] == 0
    words = ("-o", tmp_path / "new.npz", "--like", walk)
    assert run("export", tmp_path / "walk.bvh", *words)[0] == 0
    with np.load(tmp_path / "new.npz") as new:
        for name in ("betas", "gender", "dmpls", "trans"):
            np.testing.assert_array_equal(new[name], arrays[name])


def test_automatic_groups_of_every_command_are_those_of_discover(run, succeed, folder, tmp_path):
    expected = mg.discover_groups(folder / "a.bvh", 3).groups
    path = tmp_path / "groups.toml"
    assert run("groups", folder / "a.bvh", "--preset", "auto:3", "-o", path)[0] == 0
    assert JointGroups.from_toml(path) == expected
    assert run("groups", folder, "--preset", "auto", "-o", path, "--force")[0] == 0
    assert JointGroups.from_toml(path) == mg.discover_groups(folder).groups
    assert run("index", folder / "a.bvh", "-o", tmp_path / "lib", "--groups", "auto:3")[0] == 0
    assert Library.open(tmp_path / "lib").groups == expected
    command = ["candidates", folder / "a.bvh", "--segment", 3, "--groups", "auto:3", "--json"]
    assert json.loads(succeed(*command)[0])["group"] == expected.names[1]
