"""`mograft graft`, `candidates` and `demo`: files, options and messages."""

import json
import math
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mograft import Config, Library, __version__, graft_many, read_bvh, write_bvh
from mograft.body.mass import mass_model
from mograft.cli import main
from mograft.evaluation import world_measures
from tests.hierarchies import DATA


@pytest.mark.parametrize("field", ["max_stretch", "max_angle"])
def test_graft_help_states_defaults_of_the_configuration(capsys, field):
    """The help texts repeat the values, so that they are shown without importing NumPy."""
    with pytest.raises(SystemExit):
        main(["graft", "--help-all"])
    text = " ".join(capsys.readouterr().out.split())
    stated = re.search(rf" --{field.replace('_', '-')} [A-Z].*?\(default: \D*([\d.]*\d)", text)
    value = getattr(Config(), field)
    assert float(stated[1]) == pytest.approx(math.degrees(value) if field == "max_angle" else value)


def test_candidates_lists_allowed_and_refused_donors(run, fail, succeed, folder):
    options = ["--clip", "a", "--segment", 12]
    out = succeed("candidates", folder, *options)[0]
    assert "a, segment 12, frames " in out
    assert "\n + " in out
    assert "segments are outside the ball" in out
    of_cluster = succeed("candidates", folder, *options, "--set", "neighbourhood=cluster")[0]
    assert "segments are in other clusters" in of_cluster
    assert of_cluster.count("\n") != out.count("\n")
    ball = ["--avoid", "sphere:0,0,0,9999", "--json"]
    document = json.loads(run("candidates", folder, *options, *ball)[1])
    assert document["schema"] == "mograft.candidates/2"
    assert document["allowed"] == []
    assert all("Avoid: penetration depth" in c["refused"] for c in document["refused"])
    first, last = document["frames"]
    for frame in (first, last - 1):
        again = run("candidates", folder, "--clip", "a", "--frame", frame, *ball)[1]
        assert json.loads(again) == document
    # As on pages, the frame that two segments share belongs to the later one.
    again = run("candidates", folder, "--clip", "a", "--frame", last, *ball)[1]
    assert json.loads(again)["segment"] == document["segment"] + 1
    assert "--segment must be 0 to" in fail(1, "candidates", folder, "--segment", 99999)


def test_candidates_and_graft_agree_on_segments_frames_and_gaps(run, succeed, folder, tmp_path):
    listed = json.loads(succeed("candidates", folder, "--segment", 9, "--json")[0])
    _, table, _ = run("candidates", folder, "--segment", 9)
    others = [own for own in listed["allowed"] if own["index"] != listed["index"]]
    assert len(others) == len(listed["allowed"]) - 1
    assert f"a, segment 9, frames {listed['frames'][0]} to {listed['frames'][1]}" in table
    assert f"upper of {len(others)} other segment" in table
    assert table.count("\n + ") == len(others)
    assert table.count("\n = ") == 1
    assert f"seam angle {listed['max_angle_degrees']:.0f}°" in table
    donor = others[-1]
    begin, end = donor["frames"]
    options = ["--take", f"9={donor['clip']}:{begin}-{end}"]
    before, after = listed["frames"]
    options += ["--keep", f"0-{before}", "--keep", f"{after}-599", "--set", "self_repair=false"]
    assert run("graft", folder, *options, "-o", tmp_path / "new.bvh")[0] == 0
    made = json.loads((tmp_path / "new.json").read_text())["substitutions"][9]
    assert made["frames"] == listed["frames"]
    assert (made["clip"], made["clip_frames"]) == (donor["clip"], donor["frames"])
    assert made["gaps_degrees"] == donor["gaps_degrees"]


def test_graft_few_donors_give_fewer_motions_and_a_warning(succeed, folder, tmp_path):
    motion = read_bvh(folder / "a.bvh")
    write_bvh(motion[:40], tmp_path / "short.bvh")
    short = tmp_path / "short.bvh"
    fixed = ["-o", tmp_path / "fixed", "-n", 2, "--set", "sigma_scale=0.001"]
    out, err = succeed("graft", short, *fixed)
    assert len(out.split()) == 1
    assert "the donors allow only 1 different motion, not 2" in err
    assert "had no candidate and were kept" in err
    assert "a larger --" in err


def test_graft_equal_motions_give_a_warning_that_distinct_prevents(run, tmp_path):
    knight = f"{DATA / 'glb' / 'kaykit_Knight.glb'}"
    if not Path(knight).exists():
        pytest.skip(f"{knight} is missing")
    for distinct, is_warned in ((0, True), (2, False)):
        words = ["--base", "Lie_Idle", "-n", 3, "--distinct", distinct]
        code, _, err = run("graft", knight, *words, "-o", tmp_path / str(distinct))
        assert code == 0
        assert ("differ from an earlier one by less than 1°" in err) is is_warned


def test_graft_base_given_as_path_file_name_or_clip_is_same(run, folder, tmp_path):
    motions = []
    for index, name in enumerate([folder / "b.bvh", "b.bvh", "b"]):
        target = tmp_path / f"{index}.bvh"
        assert run("graft", folder, "--base", name, "-o", target)[0] == 0
        motions.append(target.read_bytes())
    assert len(set(motions)) == 1


def test_graft_measure_writes_quality_to_document_and_page(succeed, folder, tmp_path):
    pytest.importorskip("scipy", reason="SciPy is not installed")
    out = tmp_path / "out"
    err = succeed("graft", folder, "-o", out, "-n", 2, "--measure", "--report")[1]
    library = Library.build([read_bvh(path) for path in sorted(folder.glob("*.bvh"))])
    page = (out / "index.html").read_text()
    for index, new in enumerate(graft_many(library, count=2)):
        expected = world_measures(new)
        document = json.loads((out / f"a_graft{index}.json").read_text())
        found, measures = document["quality"], expected.as_dict()
        for name, ends in measures.pop("ranges").items():
            assert found["ranges"][name] == pytest.approx(ends, rel=1e-9, abs=1e-12)
        del found["ranges"]
        assert found == pytest.approx(measures, rel=1e-9, abs=1e-12)
        low, high = expected.ranges["head_jerk"]
        head = expected.columns()["head jerk, ratio"]
        assert head.startswith(f"{expected.head_jerk:.2f} (")
        assert head.endswith(f"n {low:.2f} to {high:.2f})") or not low <= expected.head_jerk <= high
        assert f"head jerk, ratio {head}" in err
        assert f"<td>{head}</td>" in page
    assert "head jerk, ratio</th>" in page
    out_text = succeed("graft", folder, "-o", tmp_path / "b", "--measure", "--json")[0]
    first = json.loads(out_text)["grafts"][0]
    assert first["quality"] == json.loads((out / "a_graft0.json").read_text())["quality"]


def test_graft_measure_without_scipy_names_extra(fail, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("mograft.cli.actions.graft.find_spec", {}.get)
    err = fail(1, "graft", folder, "-o", tmp_path / "out", "--measure")
    assert "--measure needs SciPy: pip install 'mograft[evaluate]'" in err
    assert not (tmp_path / "out").exists()


def copy_clips(folder, target):
    target.mkdir()
    for path in folder.glob("*.bvh"):
        (target / path.name).write_bytes(path.read_bytes())
    return target


@pytest.mark.parametrize(
    "words",
    [
        ("graft", "-o", "x"),
        ("candidates", "--segment", 3),
        ("plot", "clusters", "-o", "x.png"),
        ("evaluate", "balance", "--runs", 1, "--bases", 1),
        ("index", "-o", "x.mograft"),
    ],
)
def test_commands_exclude_grafts_in_folders(run, succeed, folder, tmp_path, words):
    clips = copy_clips(folder, tmp_path / "clips")
    write_bvh(read_bvh(clips / "a.bvh"), clips / "c.bvh")
    (clips / "c.json").write_text('{"schema": "mograft.graft/2"}')
    position = 2 if words[0] == "plot" else 1
    command = [*words[:position], clips, *words[position:]]
    err = succeed(*command)[1]
    assert err.count("1 graft of mograft excluded") == 1
    if words[0] == "graft":
        clips = json.loads(Path("x/a_graft0.json").read_text())["clips"]
        assert [clip["name"] for clip in clips] == ["a", "b"]
    if words[0] == "index":
        names = [entry.name for entry in Library.open("x.mograft").entries]
        assert names == ["a", "b"]
        assert run(*command, "--add", "--include-grafts")[0] == 0
        names = [entry.name for entry in Library.open("x.mograft").entries]
        assert names == ["a", "b", "c"]
    else:
        force = ["--force"] if words[0] in ("graft", "plot") else []
        assert "--include-grafts" not in run(*command, "--include-grafts", *force)[2]


def write_first(run, folder, tmp_path, *options):
    """Make a graft, and return its path."""
    path = tmp_path / "first" / "new.bvh"
    path.parent.mkdir()
    assert run("graft", folder, "-o", path, *options)[0] == 0
    return path


def test_graft_from_provenance_writes_same_bytes_and_keeps_the_command(run, folder, tmp_path):
    options = ["--avoid", "sphere:0,100,30,5", "--best-effort", "--measure"]
    path = write_first(run, folder, tmp_path, *options)
    provenance = path.with_suffix(".json")
    code, out, _ = run("graft", "--from", provenance, "-o", tmp_path / "second")
    name = json.loads(provenance.read_text())["name"]
    again = tmp_path / "second" / f"{name}.bvh"
    assert (code, out) == (0, f"{again}\n")
    assert again.read_bytes() == path.read_bytes()
    documents = [json.loads(own.with_suffix(".json").read_text()) for own in (path, again)]
    command = shlex.join(["mograft", "graft", str(folder), "-o", str(path), *options])
    assert documents[0]["request"]["command"] == command
    assert documents[0]["mograft"] == __version__
    documents[0].pop("quality")
    assert documents[0] == documents[1]


def test_graft_digits_option_is_recorded_and_may_be_replaced(run, folder, tmp_path):
    path = write_first(run, folder, tmp_path, "--digits", "8")
    provenance = path.with_suffix(".json")
    written = []
    for words in ([], ["--digits", "3"]):
        assert run("graft", "--from", provenance, "-o", "again.bvh", "--force", *words)[0] == 0
        written.append(Path("again.bvh").read_bytes())
    assert written[0] == path.read_bytes() != written[1]


def test_graft_from_with_a_variety_prints_a_command_that_makes_new_motions(
    usage_error, succeed, folder, tmp_path
):
    succeed("graft", folder, "-o", tmp_path / "out", "-n", 2, "--swap", "upper")
    source, target = next((tmp_path / "out").glob("*.json")), tmp_path / "new.bvh"
    message = usage_error("graft", "--from", source, "--variety", "0.6", "-o", target)
    command = shlex.split(message.rpartition("same files: ")[2])
    assert command[-4:] == ["--variety", "0.6", "-o", str(target)]
    succeed(*command[1:])
    request = json.loads(target.with_suffix(".json").read_text())["request"]
    assert request["swap"] == ["upper"]


@pytest.fixture(scope="module")
def first(folder, tmp_path_factory):
    """The path of a graft of the clips in a folder."""
    path = tmp_path_factory.mktemp("first") / "new.bvh"
    assert main(["graft", str(folder), "-o", str(path), "--seed", "4"]) == 0
    return path


def test_graft_from_with_edits_prints_changes_and_records_command_and_seed(
    succeed, first, tmp_path
):
    target, seeds = tmp_path / "edited.bvh", []
    for words in ((), ("--seed", "0"), ("--seed", "7")):
        words = (*words, "--force", "--ban", "55")
        out, err = succeed("graft", "--from", first.with_suffix(".json"), "-o", target, *words)
        assert out == f"{target}\n"
        assert "segment 55, frames" in err
        assert "all others are unchanged" in err
        document = json.loads(target.with_suffix(".json").read_text())
        assert document["edits"][0]["command"].endswith("--ban 55")
        seeds.append(document["seed"])
    assert seeds == [4, 0, 7]


@pytest.mark.parametrize("start", ["300", "10s"])
def test_graft_change_to_the_end_equals_the_one_to_the_last_frame(succeed, first, tmp_path, start):
    words = ["graft", "--from", first.with_suffix(".json"), "--change"]
    for end in ("", "599" if start == "300" else "19.96s"):
        succeed(*words, f"larm@{start}-{end}=b:10-280", "-o", tmp_path / f"to{end}.bvh")
    one, other = (path.read_bytes() for path in sorted(tmp_path.glob("*.bvh")))
    assert one == other
    assert json.loads((tmp_path / "to.json").read_text())["changes"][0]["frames"] == [300, 599]


def test_graft_changes_vary_where_other_parts_exist(succeed, folder, tmp_path):
    """A range with frames of its own keeps them in every version; alone, it has one version."""
    fixed, free = "upper@20-90=b:10-70", "upper@100-130"
    words = ["graft", folder, "-n", 3, "--change", fixed]
    succeed(*words, "--change", free, "-o", tmp_path / "both")
    versions = [read_bvh(path).rotations for path in sorted((tmp_path / "both").glob("*.bvh"))]
    assert len(versions) == 3
    assert (versions[0][:91] == versions[1][:91]).all()
    assert len({own[100:131].tobytes() for own in versions}) == 3
    _, err = succeed(*words, "-o", tmp_path / "one")
    assert len(list((tmp_path / "one").glob("*.bvh"))) == 1
    assert "warning: 1 of 3 motions are written: there are no other parts" in err


def test_graft_from_with_edits_takes_moved_library(run, fail, first, folder, tmp_path):
    shutil.copy(first.with_suffix(".json"), tmp_path / "new.json")
    words = ["graft", "--from", tmp_path / "new.json", "--ban", "24"]
    shutil.copytree(folder, tmp_path / "clips")
    assert run(*words, tmp_path / "clips", "-o", tmp_path / "one.bvh")[0] == 0
    assert run("index", folder, "-o", tmp_path / "lib")[0] == 0
    assert run(*words, tmp_path / "lib", "-o", tmp_path / "two.bvh")[0] == 0
    assert (tmp_path / "one.bvh").read_bytes() == (tmp_path / "two.bvh").read_bytes()
    err = fail(3, *words, tmp_path / "clips" / "a.bvh", "-o", tmp_path / "three.bvh")
    assert "is another library: SHA-256" in err


def test_graft_from_in_another_folder_finds_the_folder_of_the_command(
    succeed, folder, tmp_path, monkeypatch
):
    shutil.copytree(folder, tmp_path / "work" / "clips")
    monkeypatch.chdir(tmp_path / "work")
    succeed("graft", "clips", "-o", "out")
    monkeypatch.chdir(tmp_path / "work" / "out")
    succeed("graft", "--from", "a_graft0.json", "--ban", "9", "-o", "here.bvh")
    monkeypatch.chdir(tmp_path)
    succeed("graft", "--from", "work/out/a_graft0.json", "--ban", "9", "-o", "there.bvh")
    assert Path("there.bvh").read_bytes() == Path("work/out/here.bvh").read_bytes()


def test_graft_nothing_exchanged_is_a_warning_and_exit_code_0(run, succeed, folder):
    code, out, err = run("graft", folder / "a.bvh", "-o", "x.bvh", "--set", "sigma_scale=0.0001")
    assert (code, out) == (0, "x.bvh\n")
    assert "warning: no segment was exchanged: no segment has a candidate" in err
    assert "no similar segment" in err
    err = succeed("graft", folder / "a.bvh", "-o", "y.bvh", "--only-violations", "--avoid-self")[1]
    assert "warning: no segment was exchanged: the base satisfies the constraints" in err
    assert "--variety" not in err


def test_graft_obstacle_at_kept_joints_ends_before_the_search(run, folder, monkeypatch, tmp_path):
    def search(*_, **__):
        raise AssertionError("the search started")

    for name in ("repair", "graft_many"):
        monkeypatch.setattr(f"mograft.{name}", search)
    clip = read_bvh(folder / "a.bvh")
    _, positions = clip.world_transforms()
    foot = ",".join(f"{value:.3f}" for value in positions[100, clip.skeleton.index("LeftFoot")])
    for words in (
        ["--avoid", f"sphere:{foot},5", "--only-violations"],
        ["--avoid", f"sphere:{foot},5@95-105", "-n", "2"],
        ["--reach", "100:LeftFoot:0,900,0"],
    ):
        code, out, err = run("graft", folder / "a.bvh", "-o", tmp_path / "out", *words)
        assert (code, out) == (4, "")
        assert re.search("by Left|LeftFoot is", err)
        assert "joints that are not exchanged violate constraints" in err.splitlines()[-1]
        assert not (tmp_path / "out").exists()
    with pytest.raises(AssertionError, match="the search started"):
        run("graft", folder / "a.bvh", "-o", "out", "--avoid", f"sphere:{foot},5", "--best-effort")
    with pytest.raises(AssertionError, match="the search started"):
        run("graft", folder / "a.bvh", "-o", "out", "--avoid", f"sphere:{foot},5@200-210")


def test_graft_from_moves_a_hand_from_where_it_is_and_keeps_all_donors(fail, succeed, folder):
    succeed("graft", folder / "a.bvh", "-o", "old.bvh", "-q")
    reach = ["--from", "old.json", "--reach", "100:LeftHand:@LeftHand+0,0.15,0", "-o", "new.bvh"]
    err = fail(4, "graft", *reach, "--set", "reach_ik=0")
    assert "--set reach_ik=1 bends an arm or leg farther; --best-effort" in err.splitlines()[-1]
    err = succeed("graft", *reach, "--set", "reach_ik=1")[1]
    assert "instead of" not in err
    old, new = read_bvh("old.bvh"), read_bvh("new.bvh")
    hand, height = old.skeleton.index("LeftHand"), mass_model(old.skeleton).height
    moved = (new.world_positions() - old.world_positions())[100, hand] / height
    assert_allclose(moved, [0, 0.15, 0], atol=0.03)
    changed = np.flatnonzero((new.rotations != old.rotations).any(axis=(1, 2)))
    assert 70 < changed[0] <= 100 <= changed[-1] < 130
