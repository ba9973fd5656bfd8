"""The other commands that read or write files, and the messages about files."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mograft import Motion, read_bvh, write_bvh
from mograft.body import groups as joint_groups
from mograft.body.capsules import Poses
from mograft.body.contacts import foot_skate
from mograft.cli.syntax.values import PRESETS
from mograft.constraints import AvoidSelf
from mograft.formats import write_npz
from tests.hierarchies import skeleton_from_text
from tests.strategies import smooth_rotations

FIGURES = [
    "Hips { Spine > Head | LeftUpLeg > LeftLeg > LeftFoot | RightUpLeg > RightLeg > RightFoot }",
    "Hips { Spine {Head | LeftArm > LeftHand | RightArm > RightHand} | LeftLeg | RightLeg }",
    "a { b > c | d }",
    "Hips { LeftUpLeg > LeftLeg | RightUpLeg > RightLeg }",
]


def write_motion_of(skeleton, n_frames, path):
    skeleton = skeleton.with_offsets(np.arange(3.0 * skeleton.n_joints).reshape(-1, 3))
    quats = smooth_rotations(np.random.default_rng(0), n_frames, skeleton.n_joints)
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    write_bvh(Motion(skeleton, 1 / 30, quats, positions), path)


@pytest.mark.parametrize("text", FIGURES)
def test_info_lists_groups_exactly_if_graft_finds_them(run, text):
    skeleton, _ = skeleton_from_text(text)
    write_motion_of(skeleton, 90, "x.bvh")
    groups = json.loads(run("info", "x.bvh", "--json")[1])["files"][0]["groups"]
    code, _, err = run("graft", "x.bvh", "-o", "y.bvh")
    assert (code == 0) == bool(groups), err
    shown = run("info", "x.bvh")[1]
    assert ("no joint groups recognized" in shown) == (not groups)
    assert ("not recognized as a person" in shown) == (bool(groups) and "arms" not in groups)
    names = [name for own in groups.values() for name in own]
    assert sorted(names) == (sorted(skeleton.names) if groups else [])


def test_warnings_of_a_content_are_printed_once_and_not_for_a_library(run, clip):
    motion = read_bvh(clip)
    positions = motion.positions.copy()
    positions[100:, 0] += 90.0
    Path("clips").mkdir()
    for name in ("a", "b", "c"):
        write_bvh(replace(motion, positions=positions, channel_values=None), f"clips/{name}.bvh")
    words = ("-o", "x.bvh", "--force")
    for command in (("graft", "clips", *words), ("index", "clips", "-o", "lib")):
        err = run(*command)[2]
        assert err.count("joints jump by") == err.count("warning: ") == 1
        assert "warning: a, b, c: joints jump by" in err
    for _ in range(2):
        assert "jump" not in run("graft", "lib", *words)[2]


def test_info_invalid_files_are_reported_and_all_others_described(run, folder, tmp_path):
    clips = shutil.copytree(folder, tmp_path / "clips")
    invalid = [clips / name for name in ("0.bvh", "aa.bvh", "z.bvh")]
    n_frames = read_bvh(clips / "b.bvh").n_frames
    for path in invalid:
        path.write_text("HIERARCHY\nnonsense\n")
    for names in ([clips], sorted(clips.iterdir())):
        code, out, err = run("info", *names)
        assert (code, out) == (3, run("info", clips / "a.bvh", clips / "b.bvh")[1])
        for line, path in zip(err.splitlines(), invalid, strict=True):
            assert line.startswith(f"error: {path}:2:")
        files = json.loads(run("info", *names, "--json")[1])["files"]
        assert [own["file"] for own in files if own["error"]] == list(map(str, invalid))
        assert [own["frames"] for own in files if not own["error"]] == [600, n_frames]


def test_check_lists_errors_and_faults_of_every_file(run, succeed, folder, tmp_path):
    succeed("check", folder)
    motion = read_bvh(folder / "a.bvh")
    places = motion.positions.copy()
    places[100:] += 400.0
    write_bvh(replace(motion, positions=places, channel_values=None), tmp_path / "leap.bvh")
    text, short = (folder / "a.bvh").read_text(), tmp_path / "short.bvh"
    short.write_text(text.replace("Frames: 600", "Frames: 601"))
    (tmp_path / "bad.bvh").write_text(text.replace("OFFSET", "OFSET", 1))
    code, out, err = run("check", tmp_path)
    assert code == 3
    assert "bad.bvh:4:2: expected OFFSET" in err
    assert "teleport: frames 99 to 100" in out
    assert "tolerated: " in out
    assert "3 clips: 1 usable, 1 usable except for the listed frames, 1 invalid\n" in out
    assert [run("check", *strict, short)[0] for strict in ([], ["--strict"])] == [0, 3]
    files = json.loads(run("check", "--json", tmp_path)[1])["files"]
    assert [bool(file["error"]) for file in files] == [True, False, False]


def test_groups_presets_equal_those_of_joint_groups():
    # The command line lists them without importing NumPy.
    assert set(PRESETS) == set(joint_groups.PRESETS)


def test_groups_file_is_accepted_by_all_commands(run, succeed, folder, tmp_path):
    groups, clip = tmp_path / "groups.toml", folder / "a.bvh"
    groups.write_text('base = "all"\n[groups]\nall = ["*"]\n')
    words = ("groups", clip, "-o", groups)
    assert [run(*words, *force)[0] for force in ([], ["--force"])] == [1, 0]
    groups.write_text(groups.read_text().replace("upper", "above"))
    for words in (
        ("plot", "pca", clip, "--group", "above", "-o", tmp_path / "a.png"),
        ("plot", "strip", clip, "-o", tmp_path / "strip.png"),
        ("view", clip, "-o", tmp_path / "a.html"),
        ("export", clip, "-o", tmp_path / "a.glb"),
        ("candidates", clip, "--segment", 3, "--group", "above"),
    ):
        succeed(*words, "--groups", groups)
    assert '"above"' in (tmp_path / "a.html").read_text()


@pytest.mark.parametrize(
    "words",
    ["groups CLIP g.toml", "view CLIP p.html", "plot energy CLIP p.png", "export CLIP p.csv"],
)
def test_output_missing_folders_are_created(succeed, folder, tmp_path, words):
    *words, name = words.replace("CLIP", str(folder / "a.bvh")).split()
    succeed(*words, "-o", tmp_path / "very" / "deep" / name)
    assert [path.name for path in (tmp_path / "very" / "deep").iterdir()] == [name]


def test_index_excluded_file_is_named_once(run, folder, tmp_path):
    bad, library = folder / "bad.bvh", tmp_path / "lib"
    bad.write_text("HIERARCHY")
    code, _, err = run("index", folder, "-o", library)
    bad.unlink()
    lines = [line for line in err.splitlines() if line.startswith("excluded: ")]
    assert code == 0
    assert len(lines) == 1
    assert lines[0].count("bad.bvh") == 1
    assert f"  {lines[0]}" in run("lib", "info", library)[1]


def test_plot_strip_unknown_body_needs_no_groups(run, fail, tmp_path):
    path = tmp_path / "chain.bvh"
    write_motion_of(skeleton_from_text("a > b")[0], 9, path)
    assert run("plot", "strip", path, "-o", tmp_path / "strip.png")[0] == 0
    err = fail(1, "plot", "strip", path, "-o", tmp_path / "no.png", "--groups", "lower_upper")
    assert "needs legs" in err


@pytest.mark.parametrize(
    "words",
    [
        ["graft", "walk.bvh", "-o", "walk.bvh"],
        ["graft", "walk.bvh", "other.bvh", "-o", "./other.bvh"],
        ["graft", "lib", "-o", "walk.bvh"],
        ["export", "walk.npz", "-o", "walk.npz"],
    ],
)
def test_force_never_overwrites_an_input(run, succeed, clip, working_folder, words):
    """Nor the recordings of a library."""
    for name in ("walk.bvh", "other.bvh"):
        shutil.copy(clip, working_folder / name)
    write_npz(read_bvh(clip), working_folder / "walk.npz")
    succeed("index", "walk.bvh", "-o", "lib")
    before = {path.name: path.read_bytes() for path in working_folder.glob("*.*")}
    code, out, err = run(*words, "--force")
    assert (code, out) == (1, "")
    assert err.endswith("is an input; choose another output\n")
    assert {path.name: path.read_bytes() for path in working_folder.glob("*.*")} == before


def test_graft_of_file_with_long_name_writes_shorter_name(succeed, clip, working_folder):
    shutil.copy(clip, working_folder / f"{'é' * 125}.bvh")
    first, second = succeed("graft", f"{'é' * 125}.bvh", "-o", "out", "-n", 2)[0].split()
    assert first.endswith("é_graft0.bvh")
    assert second == first.replace("graft0", "graft1")


@pytest.mark.parametrize("command", ["check", "info"])
def test_check_and_info_name_files_of_another_size(succeed, folder, tmp_path, command):
    clips = shutil.copytree(folder, tmp_path / "clips")
    motion = read_bvh(folder / "a.bvh")
    skeleton = motion.skeleton.with_offsets(motion.skeleton.offsets / 17)
    small = replace(motion, skeleton=skeleton, positions=motion.positions / 17, channel_values=None)
    write_bvh(small, clips / "metres.bvh")
    line = f"legs are not as long as the median: {clips / 'metres.bvh'} (0.0588 times)"
    assert succeed(command, clips)[0].splitlines()[-1] == line
    assert json.loads(succeed(command, clips, "--json")[0])["sizes"] == [line]


def test_check_contacts_lists_sliding_feet_and_hands_in_the_body(succeed, folder):
    motion = read_bvh(folder / "a.bvh")[:60]
    arm, forearm = (motion.skeleton.index(name) for name in ("LeftArm", "LeftForeArm"))
    rotations = motion.rotations.copy()
    rotations[20:31, [arm, forearm]] = [0.0, 0.0, 0.0, 1.0]
    motion = replace(motion, rotations=rotations, channel_values=None)
    depths, _ = AvoidSelf().errors(Poses.from_motion(motion))
    write_bvh(motion, "shown.bvh")
    out = succeed("check", "shown.bvh", "--contacts")[0]
    assert f"feet slide in {foot_skate(motion):.1%} of the steps" in out
    spans = re.findall(r"is in the body in frames (\d+) to (\d+), .* frame (\d+)", out)
    for start, stop, worst in [map(int, span) for span in spans]:
        assert (depths[start : stop + 1] > 1.0).all()
        assert depths[worst] == depths[start : stop + 1].max()
    assert spans
    write_bvh(motion[:15], "shown.bvh")
    out = succeed("check", "shown.bvh", "--contacts")[0]
    assert "no hand or forearm is in the body" in out


def test_check_of_folder_names_files_without_motion(run, clip):
    """Also those that other commands leave out, as exports of a file of the same name."""
    Path("in").mkdir()
    Path("in", "a.bvh").write_bytes(clip.read_bytes())
    Path("in", "a.glb").write_bytes(b"no glTF")
    Path("in", "b.npz").write_bytes(b"")
    code, out, err = run("check", "in")
    assert code == 3
    assert [line.split(":")[1].strip() for line in err.splitlines()] == ["in/a.glb", "in/b.npz"]
    assert "3 clips: 1 usable, 0 usable except for the listed frames, 2 invalid" in out
