"""The command line as users meet it: what it prints, writes, refuses and returns."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from mograft import __version__, read_bvh, write_bvh
from mograft.cli import main
from mograft.dancer import dance


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    motion = dance(seed=1, strides=1).motion
    write_bvh(motion[:600], folder / "a.bvh")
    write_bvh(motion[600:], folder / "b.bvh")
    return folder


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    told = capsys.readouterr()
    return code, told.out, told.err


def test_demo_tells_the_whole_story(capsys, tmp_path):
    code, out, _ = run(capsys, "demo", "-o", tmp_path / "demo")
    assert code == 0
    assert "segments" in out
    assert "mograft graft your.bvh" in out
    sample = read_bvh(tmp_path / "demo" / "dance.bvh")
    for index in range(3):
        new = read_bvh(tmp_path / "demo" / f"dance_graft{index}.bvh")
        assert new.n_frames == sample.n_frames
        assert (tmp_path / "demo" / f"dance_graft{index}.json").exists()
    code, _, err = run(capsys, "demo", "-o", tmp_path / "demo")
    assert code == 1
    assert "exist; --force overwrites" in err


def test_graft_writes_different_motions_with_the_same_legs(capsys, folder, tmp_path):
    code, out, err = run(capsys, "graft", folder, "-o", tmp_path / "out", "-n", 3)
    assert code == 0
    paths = out.split()
    assert paths == [str(tmp_path / "out" / f"a_graft{i}.bvh") for i in range(3)]
    assert "segments exchanged" in err
    base = read_bvh(folder / "a.bvh")
    legs = [c for j in range(7) for c in base.skeleton.channel_columns[j]]
    news = [read_bvh(path) for path in paths]
    for new in news:
        np.testing.assert_array_equal(new.channel_values[:, legs], base.channel_values[:, legs])
    assert len({new.channel_values.tobytes() for new in news}) == 3
    document = json.loads((tmp_path / "out" / "a_graft0.json").read_text())
    assert document["mograft"] == __version__
    assert {clip["name"] for clip in document["clips"]} == {"a", "b"}


def test_provenance_tells_files_by_what_they_hold(capsys, folder, tmp_path):
    wanted = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}
    assert run(capsys, "index", folder, "-o", tmp_path / "lib")[0] == 0
    for number, source in enumerate((folder, tmp_path / "lib")):
        target = tmp_path / f"{number}.bvh"
        assert run(capsys, "graft", source, "-o", target)[0] == 0
        clips = json.loads(target.with_suffix(".json").read_text())["clips"]
        assert {clip["file"]: clip["sha256"] for clip in clips} == wanted


def test_graft_to_one_file_on_another_base_with_json(capsys, folder, tmp_path):
    target = tmp_path / "new.bvh"
    options = ["--base", folder / "b.bvh", "--groups", "lower_torso_arms", "--swap", "arms"]
    code, out, _ = run(capsys, "graft", folder, *options, "-o", target, "--json", "--seed", 5)
    assert code == 0
    document = json.loads(out)
    assert document["schema"] == "mograft.grafts/1"
    assert document["grafts"][0]["base"] == "b"
    assert {s["group"] for s in document["grafts"][0]["substitutions"]} == {"arms"}
    before = target.read_bytes()
    code, _, err = run(capsys, "graft", folder, *options, "-o", target)
    assert code == 1
    assert "new.bvh and 1 other file exist; --force overwrites" in err
    assert target.read_bytes() == before
    assert run(capsys, "graft", folder, *options, "-o", target, "--force", "--seed", 5)[0] == 0
    assert target.read_bytes() == before


def test_the_choice_and_its_seed_are_the_users(capsys, folder, tmp_path):
    def donors(name, *options):
        code, out, _ = run(capsys, "graft", folder, "-o", tmp_path / name, "--json", *options)
        assert code == 0
        document = json.loads(out)["grafts"][0]
        return document["config"]["choice"], document["substitutions"]

    assert donors("a.bvh")[0] == "sample"
    assert donors("b.bvh", "--seed", 1) != donors("c.bvh", "--seed", 2)
    least = [donors(f"{s}.bvh", "--choice", "viterbi", "--seed", s) for s in (1, 2)]
    assert least[0] == least[1]
    assert donors("d.bvh", "--temperature", "0.001")[1] == least[0][1]
    assert donors("f.bvh", "--preset", "paper")[0] == "random"


def test_the_seam_can_be_chosen(capsys, folder, tmp_path):
    told = {}
    for seam in ("offset", "paper"):
        path = tmp_path / f"{seam}.bvh"
        assert run(capsys, "graft", folder, "--seam", seam, "-o", path)[0] == 0
        assert json.loads(path.with_suffix(".json").read_text())["config"]["seam"] == seam
        told[seam] = path.read_bytes()
    assert run(capsys, "graft", folder, "-o", tmp_path / "default.bvh")[0] == 0
    assert (tmp_path / "default.bvh").read_bytes() == told["offset"] != told["paper"]


def test_each_way_to_graft_has_its_option(capsys, folder, tmp_path):
    def made(name, *options):
        path = tmp_path / f"{name}.bvh"
        assert run(capsys, "graft", folder, "-o", path, *options)[0] == 0
        document = json.loads(path.with_suffix(".json").read_text())
        return path.read_bytes(), document

    plain, document = made("plain")
    assert (document["config"]["torso"], document["config"]["alignment"]) == ("pelvis", "uniform")
    for name, value in (("torso", "world"), ("alignment", "dtw")):
        other, document = made(name, f"--{name}", value)
        assert document["config"][name] == value
        assert other != plain
    _, document = made("mirror", "--mirror")
    assert {c["name"] for c in document["clips"]} == {"a", "b", "a_mirrored", "b_mirrored"}


def hand_of(folder, frame):
    motion = read_bvh(folder / "a.bvh")
    return motion.world_positions()[frame, motion.skeleton.index("LeftHand")]


def test_constraints_are_met_or_end_with_4_and_the_nearest_miss(capsys, folder, tmp_path):
    near = ",".join(f"{x:.3f}" for x in hand_of(folder, 100))
    reach = f"100:LeftHand:{near}~0.05"
    code, out, _ = run(capsys, "graft", folder, "--reach", reach, "-o", tmp_path / "a.bvh")
    assert code == 0
    motion = read_bvh(tmp_path / "a.bvh")
    place = motion.world_positions()[100, motion.skeleton.index("LeftHand")]
    assert np.linalg.norm(place - hand_of(folder, 100)) < 0.05 * 180
    far = "100:LeftHand:0,900,0"
    code, out, err = run(capsys, "graft", folder, "--reach", far, "-o", tmp_path / "b.bvh")
    assert code == 4
    assert "LeftHand is " in err
    assert "heights" in err
    assert "no donor sequence satisfies the constraints" in err
    assert out == ""
    assert not (tmp_path / "b.bvh").exists()
    code, out, err = run(
        capsys, "graft", folder, "--reach", far, "-o", tmp_path / "b.bvh", "--best-effort"
    )
    assert code == 0
    document = json.loads((tmp_path / "b.json").read_text())
    assert document["violations"][0]["constraint"] == "Reach"


def test_repair_on_the_command_line_keeps_what_is_right(capsys, folder, tmp_path):
    x, y, z = hand_of(folder, 300)
    ball = f"sphere:{x:.2f},{y + 8:.2f},{z:.2f},5"
    options = ["--repair", "--avoid", ball, "--best-effort", "--base", folder / "a.bvh"]
    code, _, err = run(capsys, "graft", folder, *options, "-o", tmp_path / "a.bvh")
    assert code == 0
    assert "segments exchanged" in err
    old, new = read_bvh(folder / "a.bvh"), read_bvh(tmp_path / "a.bvh")
    same = (old.channel_values == new.channel_values).all(axis=1)
    assert same[:100].all()
    assert not same.all()


def test_candidates_are_listed_with_their_reasons(capsys, folder):
    options = ["--clip", "a", "--segment", 12]
    code, out, _ = run(capsys, "candidates", folder, *options)
    assert code == 0
    assert "a, frames " in out
    assert " + a" in out
    assert "segments are in other clusters" in out
    ball = ["--avoid", "sphere:0,0,0,9999", "--json"]
    code, out, _ = run(capsys, "candidates", folder, *options, *ball)
    document = json.loads(out)
    assert document["schema"] == "mograft.candidates/1"
    assert document["allowed"] == []
    assert all("Avoid: touched" in c["refused"] for c in document["refused"])
    last = document["frames"][1]
    code, again, _ = run(capsys, "candidates", folder, "--clip", "a", "--frame", last, *ball)
    assert json.loads(again) == document
    code, _, err = run(capsys, "candidates", folder, "--segment", 99999)
    assert code == 1
    assert "--segment must be 0 to" in err


def test_every_constraint_has_its_option(capsys, folder, tmp_path):
    other = f"{folder / 'b.bvh'}@300,0,0,90"
    options = ["--avoid", other, "--radius", "1.2", "--avoid-self", "--keep", "0-60"]
    options += ["--avoid", "wall:0,-50,0,0,1,0", "--avoid", "box:900,0,0,5,5,5"]
    options += ["--avoid", "capsule:900,0,0,900,90,0,5", "--face", "0,150,900@20-30"]
    options += ["--only-from", "a,b", "--not-from", "b", "--max-stretch", "0.1"]
    options += ["--max-angle", "30", "--best-effort"]
    code, _, _ = run(capsys, "graft", folder, *options, "-o", tmp_path / "a.bvh")
    assert code == 0
    document = json.loads((tmp_path / "a.json").read_text())
    for s in document["substitutions"]:
        assert s["clip"] == "a"
        assert not (s["exchanged"] and s["frames"][0] <= 60)
        assert abs(s["stretch"]) <= 0.1 / 0.9 + 1e-6


def test_a_scenario_is_walked_or_given(capsys, folder, tmp_path):
    path = tmp_path / "walk.bvh"
    options = ["--scenario", "graph", "--duration", 12]
    assert run(capsys, "graft", folder, *options, "-o", path)[0] == 0
    walked = read_bvh(path)
    assert 12.0 <= walked.duration < 14.1
    document = json.loads(path.with_suffix(".json").read_text())
    assert {part["clip"] for part in document["scenario"]} <= {"a", "b"}
    kinds = {
        "frames": ["--frames", 301],
        "beats": ["--beats", 100, "--duration", 6],
        "path": ["--path=0,0:250,-30", "--feet", "never", "--among", "b"],
    }
    made = {}
    for name, more in kinds.items():
        target = tmp_path / f"{name}.bvh"
        own = ["--scenario", "graph", *more, "-o", target]
        assert run(capsys, "graft", folder, *own)[0] == 0
        made[name] = read_bvh(target)
    assert made["frames"].n_frames == 301
    assert made["beats"].n_frames == 181
    np.testing.assert_allclose(made["path"].positions[0, 0, [0, 2]], 0.0, atol=1e-6)
    assert np.linalg.norm(made["path"].positions[-1, 0, [0, 2]] - [250, -30]) < 60
    parts = json.loads((tmp_path / "path.json").read_text())["scenario"]
    assert {part["clip"] for part in parts} == {"b"}
    given = tmp_path / "given.bvh"
    assert run(capsys, "graft", folder, "--scenario", "3,4,0", "-o", given)[0] == 0
    assert len(json.loads(given.with_suffix(".json").read_text())["scenario"]) == 3


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (
            ["--scenario", "waltz"],
            "--scenario must be original, graph or segment numbers; got waltz",
        ),
        (["--scenario", "graph", "--base", "b.bvh"], "--base cannot be combined with --scenario"),
        (["--duration", "5"], "--duration requires --scenario graph"),
        (["--scenario", "graph", "--duration", "0"], "--duration must be above 0 seconds, got 0"),
        (["--frames", "9"], "--frames requires --scenario graph"),
        (["--scenario", "graph", "--frames", "1"], "--frames must be at least 2, got 1"),
        (
            ["--scenario", "graph", "--frames", "9", "--beats", "90"],
            "--frames cannot be combined with --beats",
        ),
        (
            ["--scenario", "graph", "--beats", "0"],
            "--beats must be above 0 beats per minute, got 0",
        ),
        (["--scenario", "graph", "--path", "1,2"], "--path must be at least two corners"),
    ],
)
def test_a_wrong_scenario_is_a_usage_error(capsys, folder, tmp_path, options, told):
    with pytest.raises(SystemExit) as stopped:
        main(["graft", str(folder), *options, "-o", str(tmp_path / "x.bvh")])
    assert stopped.value.code == 2
    assert told in capsys.readouterr().err


def test_few_segments_are_told_and_the_clusters_widened(capsys, folder, tmp_path):
    motion = read_bvh(folder / "a.bvh")
    write_bvh(motion[:40], tmp_path / "short.bvh")
    short = tmp_path / "short.bvh"
    code, out, err = run(capsys, "graft", short, "-o", tmp_path / "out", "-n", 30)
    assert code == 0
    assert "which allows less similar donors" in err
    fixed = ["-o", tmp_path / "fixed", "-n", 2, "--sigma-scale", "0.001"]
    code, out, err = run(capsys, "graft", short, *fixed)
    assert code == 0
    assert len(out.split()) == 1
    assert "the donors allow only 1 different motions, not 2" in err
    assert "had no candidate and were kept" in err


def test_info_describes_files(capsys, folder):
    code, out, _ = run(capsys, "info", folder)
    assert code == 0
    assert "18 joints, 57 channels (DoF)" in out
    assert "600 frames at 30 fps" in out
    code, out, _ = run(capsys, "info", "--json", folder / "a.bvh")
    document = json.loads(out)
    assert document["schema"] == "mograft.info/1"
    assert document["files"][0]["joints"] == 18
    assert document["files"][0]["groups"]["lower"][0] == "Hips"


def test_large_files_are_described_without_being_held(capsys, folder, monkeypatch):
    whole = json.loads(run(capsys, "info", "--json", folder / "a.bvh")[1])["files"][0]
    monkeypatch.setattr("mograft.cli.info.MAX_BYTES_IN_MEMORY", 1000)
    streamed = json.loads(run(capsys, "info", "--json", folder / "a.bvh")[1])["files"][0]
    assert streamed.pop("faults") is None
    assert whole.pop("faults") == []
    assert streamed == whole
    assert "see mograft check" in run(capsys, "info", folder / "a.bvh")[1]


def test_check_judges_every_file(capsys, folder, tmp_path):
    assert run(capsys, "check", folder)[0] == 0
    motion = read_bvh(folder / "a.bvh")
    places = motion.positions.copy()
    places[100:] += 400.0
    write_bvh(replace(motion, positions=places, channel_values=None), tmp_path / "leap.bvh")
    text = (folder / "a.bvh").read_text()
    (tmp_path / "short.bvh").write_text(text.replace("Frames: 600", "Frames: 601"))
    (tmp_path / "bad.bvh").write_text(text.replace("OFFSET", "OFSET", 1))
    code, out, err = run(capsys, "check", tmp_path)
    assert code == 3
    assert "bad.bvh:4:2: expected OFFSET" in err
    assert "teleport: frames 99 to 100" in out
    assert "tolerated: " in out
    assert run(capsys, "check", tmp_path / "short.bvh")[0] == 0
    assert run(capsys, "check", "--strict", tmp_path / "short.bvh")[0] == 3
    code, out, _ = run(capsys, "check", "--json", tmp_path)
    document = json.loads(out)
    assert document["schema"] == "mograft.check/1"
    assert [bool(file["error"]) for file in document["files"]] == [True, False, False]


def test_groups_can_be_edited_and_passed_back(capsys, folder, tmp_path):
    code, out, _ = run(capsys, "groups", folder / "a.bvh", "--preset", "lower_torso_arms")
    assert code == 0
    assert "LeftForeArm" in out
    path = tmp_path / "groups.toml"
    code, told, _ = run(capsys, "groups", folder / "a.bvh", "-o", path)
    assert told.strip() == str(path)
    assert run(capsys, "groups", folder / "a.bvh", "-o", path)[0] == 1
    out_file = tmp_path / "x.bvh"
    assert run(capsys, "graft", folder / "a.bvh", "--groups", path, "-o", out_file)[0] == 0


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("this is no motion", 3, "bad.bvh:1"),
        (None, 1, "bad.bvh: No such file or directory"),
    ],
)
def test_bad_files_give_one_line_and_their_exit_code(capsys, tmp_path, text, code, message):
    path = tmp_path / "bad.bvh"
    if text is not None:
        path.write_text(text)
    got, out, err = run(capsys, "graft", path, "-o", tmp_path / "out")
    assert got == code
    assert message in err
    assert out == ""
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_clips_of_different_skeletons_are_refused(capsys, folder, tmp_path):
    text = (folder / "a.bvh").read_text().replace("LeftForeArm", "LeftElbow")
    (tmp_path / "other.bvh").write_text(text)
    code, _, err = run(
        capsys, "graft", folder / "a.bvh", tmp_path / "other.bvh", "-o", tmp_path / "out"
    )
    assert code == 1
    assert "other lacks LeftForeArm and has also LeftElbow" in err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["dance"],
        ["graft", "a.bvh"],
        ["graft", "a.bvh", "-o", "x.bvh", "-n", "2"],
        ["graft", "a.bvh", "-o", "out", "-n", "0"],
        ["graft", "a.bvh", "-o", "out", "--seed", "-1"],
        ["graft", "a.bvh", "-o", "out", "--groups", "wings"],
        ["graft", "a.bvh", "-o", "out", "--choice", "whim"],
        ["graft", "a.bvh", "-o", "out", "--reach", "5:Hand:1,2"],
        ["graft", "a.bvh", "-o", "out", "--reach", "Hand:1,2,3"],
        ["graft", "a.bvh", "-o", "out", "--avoid", "sphere:1,2,3"],
        ["graft", "a.bvh", "-o", "out", "--avoid", "cone:1,2,3"],
        ["graft", "a.bvh", "-o", "out", "--keep", "9-3"],
        ["graft", "a.bvh", "-o", "out", "--radius", "0"],
        ["graft", "a.bvh", "-o", "out", "--repair", "-n", "2"],
        ["candidates", "a.bvh"],
        ["candidates", "a.bvh", "--segment", "1", "--frame", "2"],
    ],
)
def test_wrong_usage_ends_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "option", "value", "wanted"),
    [
        ("graft", "--seed", "x", "an integer of at least 0"),
        ("graft", "--count", "1.5", "an integer of at least 1"),
        ("graft", "--sigma-scale", "nan", "a number above 0"),
        ("graft", "--temperature", "-1", "a number above 0"),
        ("graft", "--max-stretch", "nan", "a number of at least 0"),
        ("graft", "--max-angle", "-4", "a number above 0"),
        ("graft", "--radius", "0", "a number above 0"),
        ("index", "--sigma-scale", "-1", "a number above 0"),
        ("index", "--rate", "0", "a number above 0"),
        ("evaluate", "--rate", "inf", "a number above 0"),
        ("export", "--rate", "fast", "a number above 0"),
        ("export", "--scale", "furlong", "m, cm, mm, inch, CMU or a number above 0"),
    ],
)
def test_a_number_out_of_range_names_the_option_and_what_is_wanted(
    capsys, command, option, value, wanted
):
    with pytest.raises(SystemExit) as stop:
        main([command, "a.bvh", "-o", "out", option, value])
    assert stop.value.code == 2
    err = capsys.readouterr().err
    assert option in err.splitlines()[-1]
    assert f"must be {wanted}, got {value}" in err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            "graft {} --temperature 1 --choice best",
            "--temperature requires --choice sample, got best",
        ),
        ("graft {} --avoid sphere:0,0,0,-1", "--avoid sphere: radius must not be negative"),
        ("plot pca {} --frames 1-5", "--frames requires strip, timeline, energy; got pca"),
        ("plot strip {} --group lower", "--group requires pca, dendrogram, clusters; got strip"),
        ("view {} --groups wings", "--groups must be a TOML file or one of lower_upper"),
        ("evaluate {} enrichmen", "expected a file or one of enrichment, balance, naturalness"),
    ],
)
def test_what_would_be_passed_over_is_refused(capsys, folder, tmp_path, words, told):
    target = tmp_path / "new.png"
    words = [word.format(folder / "a.bvh") for word in words.split()]
    with pytest.raises(SystemExit) as stop:
        main([*words, "-o", str(target)])
    assert stop.value.code == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", [("plot", "strip"), ("export",)])
def test_frames_that_are_not_there_are_refused(capsys, folder, tmp_path, command):
    ending = "png" if command[0] == "plot" else "npz"
    target, last = tmp_path / f"a.{ending}", read_bvh(folder / "a.bvh").n_frames - 1
    words = (*command, folder / "a.bvh", "-o", target, "--frames")
    code, _, err = run(capsys, *words, f"5-{last + 1}")
    assert code == 1
    assert f"--frames must be within 0-{last} of a, got 5-{last + 1}" in err
    assert not target.exists()
    assert run(capsys, *words, f"{last - 4}-{last}")[0] == 0


def test_own_groups_are_taken_wherever_groups_are(capsys, folder, tmp_path):
    groups = tmp_path / "groups.toml"
    groups.write_text('base = "all"\n[groups]\nall = ["*"]\n')
    assert run(capsys, "groups", folder / "a.bvh", "-o", groups, "--force")[0] == 0
    groups.write_text(groups.read_text().replace("upper", "above"))
    clip = folder / "a.bvh"
    for words in (
        ("plot", "clusters", clip, "--group", "above", "-o", tmp_path / "a.png"),
        ("plot", "strip", clip, "-o", tmp_path / "strip.png"),
        ("view", clip, "-o", tmp_path / "a.html"),
        ("export", clip, "-o", tmp_path / "a.glb"),
        ("candidates", clip, "--segment", 3, "--group", "above"),
    ):
        code, _, err = run(capsys, *words, "--groups", groups)
        assert code == 0, err
    assert '"above"' in (tmp_path / "a.html").read_text()


def test_the_base_may_be_named_as_one_of_the_files(capsys, folder, tmp_path):
    made = []
    for index, name in enumerate([folder / "b.bvh", "b.bvh", "b"]):
        target = tmp_path / f"{index}.bvh"
        assert run(capsys, "graft", folder, "--base", name, "-o", target)[0] == 0
        made.append(target.read_bytes())
    assert len(set(made)) == 1
    code, _, err = run(capsys, "graft", folder, "--base", "c.bvh", "-o", tmp_path / "c.bvh")
    assert code == 1
    assert "--base must be a clip, one of a, b, or a file; got 'c.bvh'" in err


def test_folders_of_what_is_written_are_made(capsys, folder, tmp_path):
    clip = folder / "a.bvh"
    for number, words in enumerate(
        [
            ("groups", clip, "-o", "g.toml"),
            ("view", clip, "-o", "p.html"),
            ("plot", "energy", clip, "-o", "p.png"),
            ("export", clip, "-o", "p.csv"),
        ]
    ):
        target = tmp_path / str(number) / "deep" / words[-1]
        assert run(capsys, *words[:-1], target)[0] == 0
        assert [own.name for own in target.parent.iterdir()] == [words[-1]]


def test_a_file_where_a_folder_is_wanted_is_told_before_the_work(capsys, folder, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    for words in (("graft", folder, "-o", taken), ("demo", "-o", taken)):
        code, _, err = run(capsys, *words, "--force")
        assert code == 1
        assert f"{taken} is a file; expected a folder" in err
    assert taken.read_text() == "mine"
    code, _, err = run(capsys, "view", folder, "-o", tmp_path, "--force")
    assert code == 1
    assert f"{tmp_path}: is a folder, expected a file" in err


def test_a_library_is_no_folder_of_files(capsys, folder, tmp_path):
    library = tmp_path / "lib"
    assert run(capsys, "index", folder, "-o", library)[0] == 0
    code, _, err = run(capsys, "export", library, "-o", tmp_path / "a.glb")
    assert code == 1
    assert f"{library} is a library; expected BVH files" in err
    with pytest.raises(SystemExit):
        main(["graft", str(folder / "a.bvh"), str(library), "-o", str(tmp_path / "out")])
    assert "expected one library or BVH files" in capsys.readouterr().err


def test_what_a_library_leaves_out_is_named_once(capsys, folder, tmp_path):
    bad, library = folder / "bad.bvh", tmp_path / "lib"
    bad.write_text("HIERARCHY")
    code, _, err = run(capsys, "index", folder, "-o", library)
    bad.unlink()
    told = [line for line in err.splitlines() if line.startswith("excluded: ")]
    assert code == 0
    assert len(told) == 1
    assert told[0].count("bad.bvh") == 1
    assert f"  {told[0]}" in run(capsys, "lib", "info", library)[1]


def test_rates_and_tags_of_no_clip_are_told(capsys, folder, tmp_path):
    tags = tmp_path / "tags.csv"
    tags.write_text("clip,tag\na.bvh,slow\nz*,fast\n")
    words = ["--tags", tags, "--true-rate", "b=60", "--true-rate", "c=60"]
    code, _, err = run(capsys, "index", folder, "-o", tmp_path / "lib", *words)
    assert code == 0
    assert "--true-rate or --tags match no clip of these files: c, z*" in err


def test_a_strip_asks_for_no_known_body(capsys, tmp_path):
    path = tmp_path / "chain.bvh"
    rows = "\n".join(f"0 0 0 {angle} 0 0 0 0 {angle}" for angle in range(9))
    joint = "OFFSET 0 9 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 9 0\n}"
    root = "OFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    path.write_text(
        f"HIERARCHY\nROOT a\n{{\n{root}\nJOINT b\n{{\n{joint}\n}}\n}}\n"
        f"MOTION\nFrames: 9\nFrame Time: 0.04\n{rows}\n"
    )
    assert run(capsys, "plot", "strip", path, "-o", tmp_path / "strip.png")[0] == 0
    code, _, err = run(
        capsys, "plot", "strip", path, "-o", tmp_path / "no.png", "--groups", "lower_upper"
    )
    assert code == 1
    assert "needs legs" in err
