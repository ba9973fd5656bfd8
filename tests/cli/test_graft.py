"""`mograft graft`, `candidates` and `demo`: files, options and messages."""

import json
import math
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from mograft import Config, Library, __version__, graft, read_bvh, write_bvh
from mograft.cli import main
from mograft.cli.syntax.arguments import arguments_of
from mograft.cli.syntax.options import GraftOptions
from mograft.evaluation import world_measures
from tests.hierarchies import DATA


def test_graft_help_states_defaults_of_the_configuration():
    """The help texts repeat the values, so that they are shown without importing NumPy."""
    helps = {own.dest: own.help for own in arguments_of(GraftOptions)}
    config = Config()
    values = {"max_stretch": config.max_stretch, "max_angle": math.degrees(config.max_angle)}
    for name, value in values.items():
        stated = re.search(r"default: ([\d.]+)", helps[name])
        assert float(stated[1]) == pytest.approx(value)


def test_candidates_lists_allowed_and_refused_donors(fail, succeed, folder):
    words = ["candidates", folder, "--clip", "a"]
    segment = ["--segment", 12]
    assert "segments are outside the ball" in succeed(*words, *segment)[0]
    of_cluster = succeed(*words, *segment, "--set", "neighbourhood=cluster")[0]
    assert "segments are in other clusters" in of_cluster
    ball = ["--avoid", "sphere:0,0,0,9999", "--json"]
    document = json.loads(succeed(*words, *segment, *ball)[0])
    assert document["allowed"] == []
    assert all("Avoid: penetration depth" in c["refused"] for c in document["refused"])
    first, last = document["frames"]
    # As on pages, the frame that two segments share belongs to the later one.
    found = [json.loads(succeed(*words, "--frame", n, *ball)[0]) for n in (first, last - 1, last)]
    assert found[0] == found[1] == document
    assert found[2]["segment"] == 13
    assert "--segment must be 0 to" in fail(1, "candidates", folder, "--segment", 99999)


def test_candidates_and_graft_agree_on_segments_frames_and_gaps(succeed, folder, tmp_path):
    listed = json.loads(succeed("candidates", folder, "--segment", 9, "--json")[0])
    table = succeed("candidates", folder, "--segment", 9)[0]
    others = [own for own in listed["allowed"] if own["index"] != listed["index"]]
    before, after = listed["frames"]
    assert f"a, segment 9, frames {before} to {after}: upper of {len(others)} other" in table
    assert (table.count("\n + "), table.count("\n = ")) == (len(others), 1)
    assert f"seam angle {listed['max_angle_degrees']:.0f}°" in table
    donor = others[-1]
    begin, end = donor["frames"]
    options = ["--take", f"9={donor['clip']}:{begin}-{end}", "--set", "self_repair=false"]
    options += ["--keep", f"0-{before}", "--keep", f"{after}-599"]
    succeed("graft", folder, *options, "-o", tmp_path / "new.bvh")
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
    words = ["graft", folder, "-o", tmp_path, "--measure", "--report"]
    out, err = succeed(*words, "--json")
    expected = world_measures(graft(Library.build(folder)))
    for text in (out, (tmp_path / "a_graft0.json").read_text()):
        document = json.loads(text)
        document = document.get("grafts", [document])[0]
        assert document["quality"] == json.loads(json.dumps(expected.as_dict()))
    head = expected.columns()["head jerk, ratio"]
    assert f"head jerk, ratio {head}" in err
    assert f"<td>{head}</td>" in (tmp_path / "index.html").read_text()


def test_graft_measure_without_scipy_names_extra(fail, folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy", None)
    err = fail(1, "graft", folder, "-o", tmp_path / "out", "--measure")
    assert "--measure needs SciPy: pip install 'mograft[evaluate]'" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("graft", "-o", "x"),
        ("candidates", "--segment", 3),
        ("plot", "pca", "-o", "x.png"),
        ("evaluate", "balance", "--runs", 1, "--bases", 1),
        ("index", "-o", "x.mograft"),
    ],
)
def test_commands_exclude_grafts_in_folders(run, succeed, folder, tmp_path, words):
    clips = shutil.copytree(folder, tmp_path / "clips")
    shutil.copy(clips / "a.bvh", clips / "c.bvh")
    (clips / "c.json").write_text('{"schema": "mograft.graft/2"}')
    position = 2 if words[0] == "plot" else 1
    command = [*words[:position], clips, *words[position:]]
    assert succeed(*command)[1].count("1 graft of mograft excluded") == 1
    if words[0] == "index":
        assert Library.open("x.mograft").names == ("a", "b")
        succeed(*command, "--add", "--include-grafts")
        assert Library.open("x.mograft").names == ("a", "b", "c")
    else:
        force = ["--force"] if words[0] in ("graft", "plot") else []
        assert "--include-grafts" not in run(*command, "--include-grafts", *force)[2]


def test_graft_records_command_and_digits_for_later_ones(succeed, folder, tmp_path):
    path, again = tmp_path / "first" / "new.bvh", tmp_path / "again"
    options = ["--avoid", "sphere:0,100,30,5", "--best-effort", "--digits", "8"]
    succeed("graft", folder, "-o", path, *options)
    document = json.loads(path.with_suffix(".json").read_text())
    command = shlex.join(["mograft", "graft", str(folder), "-o", str(path), *options])
    assert document["request"]["command"] == command
    assert document["mograft"] == __version__
    source, target = path.with_suffix(".json"), again / f"{document['name']}.bvh"
    assert succeed("graft", "--from", source, "-o", again)[0] == f"{target}\n"
    assert target.read_bytes() == path.read_bytes()
    assert json.loads(target.with_suffix(".json").read_text()) == document
    succeed("graft", "--from", source, "-o", again, "--force", "--digits", "3")
    assert target.read_bytes() != path.read_bytes()


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


def test_graft_from_with_edits_records_command_and_seed(succeed, first, tmp_path):
    target, seeds = tmp_path / "edited.bvh", []
    for seed in ([], ["--seed", "0"], ["--seed", "7"]):
        words = ("graft", "--from", first.with_suffix(".json"), "-o", target, *seed, "--force")
        err = succeed(*words, "--ban", "55")[1]
        assert re.search("segment 55, frames.*all others are unchanged", err, re.DOTALL)
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


def test_graft_from_with_edits_takes_moved_library(succeed, fail, first, folder, tmp_path):
    shutil.copy(first.with_suffix(".json"), tmp_path / "new.json")
    words = ["graft", "--from", tmp_path / "new.json", "--ban", "24"]
    clips, library = shutil.copytree(folder, tmp_path / "clips"), tmp_path / "lib"
    succeed("index", folder, "-o", library)
    for source in (clips, library):
        succeed(*words, source, "-o", tmp_path / f"{source.name}.bvh")
    assert (tmp_path / "clips.bvh").read_bytes() == (tmp_path / "lib.bvh").read_bytes()
    err = fail(3, *words, clips / "a.bvh", "-o", tmp_path / "three.bvh")
    assert "is another library: SHA-256" in err


def test_graft_from_in_another_folder_finds_the_folder_of_the_command(
    succeed, folder, tmp_path, monkeypatch
):
    shutil.copytree(folder, tmp_path / "work" / "clips")
    monkeypatch.chdir(tmp_path / "work")
    succeed("graft", "clips", "-o", "out")
    for place, source in ((tmp_path / "work" / "out", ""), (tmp_path, "work/out/")):
        monkeypatch.chdir(place)
        succeed("graft", "--from", f"{source}a_graft0.json", "--ban", "9", "-o", "new.bvh")
    assert Path("new.bvh").read_bytes() == Path("work/out/new.bvh").read_bytes()


def test_graft_nothing_exchanged_is_a_warning_and_exit_code_0(run, succeed, folder):
    code, out, err = run("graft", folder / "a.bvh", "-o", "x.bvh", "--set", "sigma_scale=0.0001")
    assert (code, out) == (0, "x.bvh\n")
    assert "warning: no segment was exchanged: no segment has a candidate" in err
    assert "no similar segment" in err
    err = succeed("graft", folder / "a.bvh", "-o", "y.bvh", "--only-violations", "--avoid-self")[1]
    assert "warning: no segment was exchanged: the base satisfies the constraints" in err
    assert "--variety" not in err


def test_graft_obstacle_at_kept_joints_ends_before_the_search(run, folder, monkeypatch):
    def search(*_, **__):
        raise AssertionError("the search started")

    for name in ("repair", "graft_many"):
        monkeypatch.setattr(f"mograft.{name}", search)
    clip = read_bvh(folder / "a.bvh")
    _, positions = clip.world_transforms()
    foot = ",".join(f"{value:.3f}" for value in positions[100, clip.skeleton.index("LeftFoot")])
    words = ["graft", folder / "a.bvh", "-o", "out"]
    for more in (
        ["--avoid", f"sphere:{foot},5", "--only-violations"],
        ["--avoid", f"sphere:{foot},5@95-105", "-n", "2"],
        ["--reach", "100:LeftFoot:0,900,0"],
    ):
        code, out, err = run(*words, *more)
        assert (code, out) == (4, "")
        assert re.search("by Left|LeftFoot is", err)
        assert "joints that are not exchanged violate constraints" in err.splitlines()[-1]
    for more in ([f"sphere:{foot},5", "--best-effort"], [f"sphere:{foot},5@200-210"]):
        with pytest.raises(AssertionError, match="the search started"):
            run(*words, "--avoid", *more)


def test_graft_from_reaches_with_a_whole_arm_and_keeps_all_donors(fail, succeed, folder):
    succeed("graft", folder / "a.bvh", "-o", "old.bvh")
    reach = ["--from", "old.json", "--reach", "100:LeftHand:@LeftHand+0,0.15,0", "-o", "new.bvh"]
    err = fail(4, "graft", *reach, "--set", "reach_ik=0")
    assert "--set reach_ik=1 bends an arm or leg farther; --best-effort" in err.splitlines()[-1]
    assert "instead of" not in succeed("graft", *reach, "--set", "reach_ik=1")[1]
