"""How every command behaves: settings, JSON, exit codes, completion, and Ctrl-C."""

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import read_bvh, write_bvh
from mograft.cli import COMMANDS, main
from mograft.cli.settings import CONFIG_FILE, find_settings
from mograft.dancer import dance

BY_NAME = {command.name: command for command in COMMANDS}
LEAVES = {
    (command.name, action.name) if command.actions else (command.name,): action
    for command in COMMANDS
    for action in command.actions or (command,)
}


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    path = tmp_path_factory.mktemp("clips") / "a.bvh"
    write_bvh(dance(seed=1, strides=1).motion[:400], path)
    return path


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A working folder of its own, and an environment without settings."""
    for name in [name for name in os.environ if name.startswith("MOGRAFT_")]:
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(capsys, *words):
    code = main([str(word) for word in words])
    told = capsys.readouterr()
    return code, told.out, told.err


def refused(capsys, *words):
    """What is said of wrong usage."""
    with pytest.raises(SystemExit) as stop:
        main([str(word) for word in words])
    assert stop.value.code == 2
    told = capsys.readouterr()
    assert told.out == ""
    return told.err


def graft(capsys, clip, *words):
    """The configuration and seed that a graft was made with."""
    code, out, err = run(capsys, "graft", clip, "-o", "x.bvh", "--force", "--json", *words)
    assert code == 0, err
    document = json.loads(out)["grafts"][0]
    return document["config"]["choice"], document["config"]["seam"], document["seed"]


def test_the_file_is_below_the_environment_and_that_below_the_command_line(
    capsys, clip, monkeypatch
):
    assert graft(capsys, clip) == ("sample", "offset", 0)
    Path(CONFIG_FILE).write_text('seed = 3\nchoice = "best"\n[graft]\nchoice = "viterbi"\n')
    assert graft(capsys, clip) == ("viterbi", "offset", 3)
    monkeypatch.setenv("MOGRAFT_CHOICE", "nearest")
    monkeypatch.setenv("MOGRAFT_SEAM", "dead")
    assert graft(capsys, clip) == ("nearest", "dead", 3)
    monkeypatch.setenv("MOGRAFT_GRAFT_CHOICE", "random")
    assert graft(capsys, clip) == ("random", "dead", 3)
    assert graft(capsys, clip, "--choice", "sample", "--seed", 5) == ("sample", "dead", 5)


VALUES = {"seed": ["1", "2"], "choice": ["best", "viterbi"], "seam": ["dead", "paper"]}
PLACES = ("shared", "own", "MOGRAFT_{}", "MOGRAFT_GRAFT_{}", "flag")


@given(
    st.fixed_dictionaries(
        {
            n: st.dictionaries(st.sampled_from(PLACES), v)
            for n, v in ((n, st.sampled_from(v)) for n, v in VALUES.items())
        }
    )
)
def test_whoever_is_nearer_decides_each_option_by_itself(tmp_path_factory, said):
    folder = tmp_path_factory.mktemp("s")
    document = {"shared": {}, "own": {}}
    environment, flags = {}, []
    for name, places in said.items():
        for place, value in places.items():
            if place in document:
                document[place][name] = value
            elif place == "flag":
                flags += [f"--{name}", value]
            else:
                environment[place.format(name.upper())] = value
    lines = [f'{n} = "{v}"' for n, v in document["shared"].items()]
    lines += ["[graft]", *(f'{n} = "{v}"' for n, v in document["own"].items())]
    (folder / CONFIG_FILE).write_text("\n".join(lines))
    (folder / "below" / "it").mkdir(parents=True)
    found = find_settings(BY_NAME["graft"], COMMANDS, folder / "below" / "it", environment)
    for name, places in said.items():
        nearest = [place for place in PLACES[:-1] if place in places]
        if not nearest:
            assert name not in found
            continue
        assert str(found[name].value) == places[nearest[-1]]
        origin = found[name].origin
        file = str(folder.resolve() / CONFIG_FILE)
        wanted = file if "{" not in nearest[-1] else nearest[-1].format(name.upper())
        assert origin == wanted


def test_what_is_shown_is_what_a_file_may_say(capsys, here):
    Path(CONFIG_FILE).write_text('[plot]\ndark = true\ngroups = "lower_torso_arms"\n')
    code, out, _ = run(capsys, "config", "show")
    assert code == 0
    shown = tomllib.loads(out)
    assert shown["plot"]["dark"] is True
    assert shown["plot"]["groups"] == "lower_torso_arms"
    # Read back as a file it settles the same.
    Path(CONFIG_FILE).write_text(out)
    assert run(capsys, "config", "show")[1] == out
    code, out, _ = run(capsys, "config", "show", "plot", "--origin")
    origins = {line.split(" = ")[0]: line.split("# ")[-1] for line in out.splitlines()}
    assert origins["dark"] == str(here / CONFIG_FILE)
    Path(CONFIG_FILE).unlink()
    code, out, _ = run(capsys, "config", "show", "plot", "--json")
    document = json.loads(out)
    assert document["file"] is None
    assert {s["origin"] for s in document["settings"]} == {"default"}
    assert {s["command"] for s in document["settings"]} == {"plot"}


def test_a_switch_that_the_file_turns_on_the_environment_turns_off(capsys, clip, monkeypatch):
    Path(CONFIG_FILE).write_text("[graft]\nreport = true\n")
    assert "x.html" in run(capsys, "graft", clip, "-o", "x.bvh")[1]
    monkeypatch.setenv("MOGRAFT_REPORT", "0")
    assert "html" not in run(capsys, "graft", clip, "-o", "y.bvh")[1]


def test_groups_of_a_file_lie_where_the_file_says(capsys, clip, here, monkeypatch):
    assert run(capsys, "groups", clip, "--preset", "lower_torso_arms", "-o", "own.toml")[0] == 0
    Path(CONFIG_FILE).write_text('[graft]\ngroups = "own.toml"\n')
    (here / "below").mkdir()
    monkeypatch.chdir(here / "below")
    _, out, _ = run(capsys, "graft", clip, "-o", "x.bvh", "--json")
    groups = {s["group"] for s in json.loads(out)["grafts"][0]["substitutions"]}
    assert groups == {"torso", "arms"}


def test_settings_are_no_options_that_were_given(capsys, clip):
    Path(CONFIG_FILE).write_text(
        '[graft]\ngroups = "lower_upper"\n[index]\ngroups = "lower_upper"\n'
        'sigma-scale = 0.9\n[export]\nscale = "cm"\ndark = true\n'
    )
    assert run(capsys, "index", clip, "-o", "lib")[0] == 0
    assert run(capsys, "index", clip, "-o", "lib", "--add")[0] == 0
    assert run(capsys, "graft", "lib", "-o", "x.bvh")[0] == 0
    assert run(capsys, "export", clip, "-o", "x.csv")[0] == 0
    assert "fixed when a library is created" in refused(
        capsys, "graft", "lib", "-o", "y.bvh", "--groups", "lower_upper"
    )
    assert "--scale requires .glb" in refused(
        capsys, "export", clip, "-o", "y.csv", "--scale", "cm"
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("seed = ", "mograft.toml: Invalid value"),
        ("sed = 1", "unknown setting 'sed'; mograft config show lists"),
        ("[graft]\npreset = 'x'", "preset must be one of default, paper, got 'x'"),
        ("[graft]\nseed = -1", "seed: must be an integer of at least 0, got -1"),
        ("[graft]\nseed = [1]", "seed must be a string or a number, got [1]"),
        ("[graft]\nseed = true", "seed must be a string or a number, got true"),
        ("[graft]\nreport = 1", "report must be true or false, got 1"),
        ("[graft]\nforce = true", "mograft graft has no setting 'force'"),
        ("[graft]\noutput = 'x'", "mograft graft has no setting 'output'"),
        ("[grafts]\nseed = 1", "table must be one of demo, "),
        (b"\xff", "mograft.toml: "),
    ],
)
def test_a_wrong_file_is_named_with_the_place(capsys, clip, text, told):
    Path(CONFIG_FILE).write_bytes(text if isinstance(text, bytes) else text.encode())
    assert told in refused(capsys, "graft", clip, "-o", "x.bvh")
    assert not Path("x.bvh").exists()
    # Help is given all the same.
    with pytest.raises(SystemExit) as stop:
        main(["graft", "--help"])
    assert stop.value.code == 0


@pytest.mark.parametrize(("name", "value"), [("SEED", "x"), ("CHOICE", "whim"), ("REPORT", "yes")])
def test_a_wrong_variable_is_named(capsys, clip, monkeypatch, name, value):
    monkeypatch.setenv(f"MOGRAFT_{name}", value)
    told = refused(capsys, "graft", clip, "-o", "x.bvh")
    assert f"MOGRAFT_{name}" in told
    assert value in told


def test_no_setting_says_on_what_a_command_works():
    for command in COMMANDS:
        flags = {flag for argument in command.settings() for flag in argument.flags}
        assert flags.isdisjoint({"-o", "--output", "--force", "--json", "--help"}), command.name


# A way to run every command that prints, by its words.
RUNS = {
    ("demo",): ["-o", "demo"],
    ("info",): ["CLIP"],
    ("check",): ["CLIP"],
    ("groups",): ["CLIP"],
    ("index",): ["CLIP", "-o", "new"],
    ("lib", "info"): ["LIB"],
    ("lib", "verify"): ["LIB"],
    ("lib", "export"): ["LIB", "--csv", "-o", "tables"],
    ("candidates",): ["CLIP", "--segment", "3"],
    ("graft",): ["CLIP", "-o", "new.bvh"],
    ("view",): ["CLIP", "-o", "page.html"],
    ("plot",): ["energy", "CLIP", "-o", "x.png"],
    ("export",): ["CLIP", "-o", "x.npz"],
    ("doctor",): [],
    ("config", "show"): [],
}
SILENT = {("completion",)}
"""It prints a script for a shell, which no one reads otherwise."""


@pytest.mark.parametrize("words", sorted(set(LEAVES) - SILENT), ids="-".join)
def test_every_command_tells_its_results_as_one_json_document(capsys, clip, words):
    if words == ("plot",):
        pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    if words not in RUNS:
        # A command without an example here has to have the option all the same.
        assert any("--json" in argument.flags for argument in LEAVES[words].arguments)
        return
    main(["index", str(clip), "-o", "lib"])
    capsys.readouterr()
    places = {"CLIP": str(clip), "LIB": "lib"}
    code, out, _ = run(capsys, *words, *(places.get(w, w) for w in RUNS[words]), "--json")
    assert code == 0
    kind, version = json.loads(out)["schema"].split("/")
    assert kind.startswith("mograft.")
    assert version.isdecimal()


def process(*words, **options):
    return subprocess.Popen(
        [sys.executable, "-u", "-m", "mograft", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )


def wait_for(what, child):
    """Wait until something is true, or the command is over."""
    for _ in range(30_000):
        if child.poll() is not None or what():
            return
        time.sleep(0.002)
    raise AssertionError("never came to be")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["info", "CLIP"], 0),
        (["info", "none.bvh"], 1),
        (["graft", "CLIP"], 2),
        (["info", "BAD"], 3),
        (["graft", "CLIP", "-o", "x.bvh", "--reach", "5:LeftHand:0,9999,0"], 4),
    ],
)
def test_exit_codes_are_those_of_the_process(clip, here, words, code):
    (here / "bad.bvh").write_text("HIERARCHY\nnonsense\n")
    places = {"CLIP": clip, "BAD": here / "bad.bvh"}
    child = process(*(places.get(word, word) for word in words))
    out, err = child.communicate()
    assert child.returncode == code
    assert (code == 0) == (err == "")
    assert (code == 0) == (out != "")
    assert "Traceback" not in err
    if code == 3:
        assert err.startswith(f"error: {here / 'bad.bvh'}:2:")


def whole_or_absent(folder):
    """Assert that a folder holds nothing that is half written; return the motions."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert [path for path in files if path.name.startswith(".")] == []
    motions = [path for path in files if path.suffix == ".bvh"]
    for path in motions:
        read_bvh(path, strict=True)
    for path in files:
        if path.suffix == ".json":
            json.loads(path.read_text())
    return motions


pytestmark_posix = pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is a signal here")


def interrupted(child):
    """Send Ctrl-C to a command as a terminal does, to all of its processes."""
    os.killpg(child.pid, signal.SIGINT)
    try:
        _, err = child.communicate(timeout=60)
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
    assert child.returncode == 130
    assert err.splitlines()[-1] == "interrupted"
    assert "Traceback" not in err
    return err


@pytestmark_posix
def test_an_interrupted_demo_leaves_whole_files(here):
    child = process("demo", "-o", "demo")
    # The sample is written, the library is being built.
    assert child.stdout.readline().startswith("sample ")
    interrupted(child)
    assert {path.name for path in whole_or_absent(here)} == {"dance.bvh"}


@pytestmark_posix
def test_interrupted_grafts_have_their_provenance(here, clip):
    child = process("graft", clip, "-o", "out", "-n", "200")
    wait_for(lambda: (here / "out" / "a_graft1.bvh").exists(), child)
    interrupted(child)
    motions = whole_or_absent(here / "out")
    assert len(motions) >= 2
    for path in motions:
        assert path.with_suffix(".json").exists()


@pytestmark_posix
@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupted_index_leaves_the_library_that_was(here, clip, jobs):
    (here / "clips").mkdir()
    shutil.copy(clip, here / "clips" / "c0.bvh")
    assert main(["index", "clips", "-o", "lib"]) == 0
    before = (here / "lib" / "manifest.json").read_bytes()
    for number in range(1, 40):
        shutil.copy(clip, here / "clips" / f"c{number}.bvh")
    child = process("index", "clips", "-o", "lib", "--add", "-j", str(jobs))
    seen = set((here / "lib").rglob("*"))
    below = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    if jobs > 1 and below.exists():
        # Its processes have begun: what they are doing then, they would tell of.
        wait_for(lambda: len(below.read_text().split()) > jobs, child)
    else:
        wait_for(lambda: set((here / "lib").rglob("*")) - seen, child)
    interrupted(child)
    assert (here / "lib" / "manifest.json").read_bytes() == before
    assert main(["lib", "verify", "lib"]) == 0


@pytestmark_posix
@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_an_interrupted_film_leaves_none(here, clip, ending):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    if ending == "mp4":
        pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    child = process("export", clip, "-o", f"x.{ending}", "--size", "1920x1080")
    wait_for(lambda: any(path.name.startswith(".x") for path in here.iterdir()), child)
    interrupted(child)
    assert list(here.iterdir()) == []


SHELLS = {
    "bash": "source {script}; COMP_WORDS=({words}); COMP_CWORD={at}; "
    "COMP_LINE='{line}'; COMP_POINT=${{#COMP_LINE}}; _shtab_mograft; "
    'printf "%s\\n" "${{COMPREPLY[@]}}"',
    "fish": "source {script}; complete -C '{line}'",
}


@pytest.mark.parametrize("shell", sorted(SHELLS))
@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("mograft gr", {"graft", "groups"}),
        ("mograft graft --choi", {"--choice"}),
        ("mograft lib ve", {"verify"}),
        ("mograft graft --choice v", {"viterbi"}),
    ],
)
def test_shells_complete_commands_options_and_choices(capsys, here, shell, line, wanted):
    pytest.importorskip("shtab", reason="shtab is not installed")
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (here / "script").write_text(run(capsys, "completion", shell)[1])
    words = line.split(" ")
    code = SHELLS[shell].format(
        script=here / "script", words=" ".join(words), at=len(words) - 1, line=line
    )
    told = subprocess.run([shell, "-c", code], capture_output=True, text=True, check=False)
    # fish tells what each is for, too.
    found = {own.split("\t")[0] for own in told.stdout.split("\n") if own}
    assert wanted <= found, told.stderr
    assert all(own.startswith(words[-1]) for own in found)


def test_scripts_of_all_shells_name_all_commands(capsys):
    pytest.importorskip("shtab", reason="shtab is not installed")
    for shell in ("bash", "zsh", "fish", "tcsh"):
        text = run(capsys, "completion", shell)[1]
        for words in itertools.islice(BY_NAME, 6):
            assert words in text, (shell, words)


def test_without_shtab_the_extra_is_named(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    code, out, err = run(capsys, "completion", "bash")
    assert (code, out) == (1, "")
    assert "pip install 'mograft[completion]'" in err


def test_groups_of_a_file_are_no_matter_to_a_library_that_has_its_own(capsys, clip):
    assert run(capsys, "index", clip, "-o", "lib")[0] == 0
    Path(CONFIG_FILE).write_text('groups = "lower_torso_arms"\n')
    for number, words in enumerate(
        [
            ("plot", "strip", "lib", "-o", "a.png"),
            ("view", "lib", "-o", "a.html"),
            ("candidates", "lib", "--segment", "3", "--group", "upper"),
            ("graft", "lib", "-o", "a.bvh"),
        ]
    ):
        code, _, err = run(capsys, *words)
        assert code == 0, (number, err)
