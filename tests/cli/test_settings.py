"""Options from mograft.toml and the environment, `mograft config show`, and ``--set``."""

import json
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.analysis import segmentation
from mograft.cli import main
from mograft.cli.syntax.commands import COMMANDS
from mograft.cli.syntax.parser import CONFIG_FILE, parse
from mograft.config import CHOICES
from mograft.config_text import parse_fields
from tests.cli.field_table import field_table

VALUES = {
    "seed": {"1": 1, "2": 2},
    "variety": {"0.1": 0.1, "0.2": 0.2},
    "swap": {"upper": ("upper",), "arms,legs": ("arms", "legs")},
}
SOURCES = ("shared", "table", "MOGRAFT_{}", "MOGRAFT_GRAFT_{}", "--")
"""Where an option can be set, in ascending order of precedence."""


def test_settings_of_fields_are_merged_with_those_of_the_file_above(succeed, clip, monkeypatch):
    def graft(*words):
        out = succeed("graft", clip, "-o", "x.bvh", "--force", "--json", *words)[0]
        config = json.loads(out)["grafts"][0]["config"]
        return config["choice"], config["seam"]

    Path(CONFIG_FILE).write_text(
        '[set]\nchoice = "random"\nseam = "paper"\n[graft.set]\nchoice = "viterbi"\n'
    )
    assert graft() == ("viterbi", "paper")
    monkeypatch.setenv("MOGRAFT_SET", "choice=nearest seam=offset")
    assert graft() == ("nearest", "offset")
    monkeypatch.setenv("MOGRAFT_GRAFT_SET", "choice=random")
    assert graft("--set", "seam=paper") == ("random", "paper")


@given(
    st.fixed_dictionaries(
        {
            name: st.dictionaries(st.sampled_from(SOURCES), st.sampled_from([*texts]))
            for name, texts in VALUES.items()
        }
    )
)
def test_option_takes_the_value_of_the_nearest_source(tmp_path_factory, given_texts):
    folder = tmp_path_factory.mktemp("s").resolve()
    (folder / "a" / "b").mkdir(parents=True)

    def texts(source, form):
        pairs = [(name, own[source]) for name, own in given_texts.items() if source in own]
        return [form.format(*pair) for pair in pairs]

    lines = [*texts("shared", '{} = "{}"'), "[graft]", *texts("table", '{} = "{}"')]
    (folder / CONFIG_FILE).write_text("\n".join(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder / "a" / "b")
        for source in SOURCES[2:4]:
            for name, own in given_texts.items():
                if source in own:
                    patch.setenv(source.format(name.upper()), own[source])
        words = ["graft", "a.bvh", "-o", "x", *texts("--", "--{}={}")]
        options = parse(words)[1]
    for name, own in given_texts.items():
        nearest = max(own, key=SOURCES.index, default="--")
        assert getattr(options, name) == VALUES[name].get(own.get(nearest))
        origin = folder / CONFIG_FILE if nearest in SOURCES[:2] else nearest.format(name.upper())
        assert options.origins.get(name, "--") == str(origin)


def test_config_show_output_is_valid_config_file(succeed, working_folder):
    Path(CONFIG_FILE).write_text(
        '[plot]\ndark = true\ngroups = "lower_torso_arms"\n[info.fps]\n"a b*" = 30\nc = 2\n'
    )
    out = succeed("config", "show")[0]
    shown = tomllib.loads(out)["plot"]
    assert (shown["dark"], shown["groups"]) == (True, "lower_torso_arms")
    # The output, saved as a configuration file, gives the same settings.
    Path(CONFIG_FILE).write_text(out)
    assert succeed("config", "show")[0] == out
    assert f"# {working_folder / CONFIG_FILE}" in succeed("config", "show", "plot", "--origin")[0]
    Path(CONFIG_FILE).unlink()
    document = json.loads(succeed("config", "show", "plot", "--json")[0])
    assert document["file"] is None
    assert {(s["command"], s["origin"]) for s in document["settings"]} == {("plot", "default")}


@pytest.mark.parametrize("text", ['a"b', "a\\b", "\x7f\t\n", "é", "\N{GRINNING FACE}"])
def test_config_show_any_text_is_valid_toml(run, monkeypatch, text):
    monkeypatch.setenv("MOGRAFT_AMONG", text)
    assert tomllib.loads(run("config", "show", "graft")[1])["graft"]["among"] == text


def test_settings_environment_switches_off_switch_of_file(run, clip, monkeypatch):
    Path(CONFIG_FILE).write_text("[graft]\nreport = true\n")
    assert "x.html" in run("graft", clip, "-o", "x.bvh")[1]
    monkeypatch.setenv("MOGRAFT_REPORT", "0")
    assert "html" not in run("graft", clip, "-o", "y.bvh")[1]


def test_settings_groups_path_is_relative_to_config_file(run, clip, working_folder, monkeypatch):
    assert run("groups", clip, "--preset", "lower_torso_arms", "-o", "groups.toml")[0] == 0
    Path(CONFIG_FILE).write_text('[graft]\ngroups = "groups.toml"\n')
    (working_folder / "below").mkdir()
    monkeypatch.chdir(working_folder / "below")
    (made,) = json.loads(run("graft", clip, "-o", "x.bvh", "--json")[1])["grafts"]
    groups = {s["group"] for s in made["substitutions"]}
    assert groups == {"torso", "arms"}


def test_settings_without_effect_are_not_refused(succeed, clip):
    succeed("index", clip, "-o", "lib")
    Path(CONFIG_FILE).write_text(
        'groups = "lower_torso_arms"\n[index]\nvariety = 0.9\n[export]\nscale = "cm"\ndark = true\n'
        "[graft]\nbeats = 90\n"
    )
    for words in (
        ("index", clip, "-o", "lib", "--add"),
        ("plot", "strip", "lib", "-o", "a.png"),
        ("view", "lib", "-o", "a.html"),
        ("candidates", "lib", "--segment", "3", "--group", "upper"),
        ("graft", "lib", "-o", "a.bvh"),
        ("export", clip, "-o", "x.csv"),
        ("groups", clip),
        ("config", "show"),
    ):
        succeed(*words)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seed = ", "mograft.toml: Invalid value"),
        ("sed = 1", "unknown setting 'sed'; did you mean 'seed'?"),
        ("[graft]\npreset = 'x'", "preset: must be one of default, paper, paper-rms; got 'x'"),
        ("[graft]\nseed = -1", "seed: must be an integer of at least 0, got -1"),
        ("[graft]\nseed = [1]", "seed must be a string or a number, got [1]"),
        ("[graft]\nseed = true", "seed must be a string or a number, got true"),
        ("set = 1", "set must be a table such as [set], got 1"),
        ("[graft.fps]\n'*' = 'x'", "fps: must be FPS or GLOB=FPS, got *=x"),
        ("[set]\nseem = 1", "'seem' is no field of Config; did you mean 'seam'?"),
        ("[graft]\nreport = 1", "report must be true or false, got 1"),
        ("[graf]\nseed = 1", "got [graf]; did you mean 'graft'?"),
        ("[graft]\nforce = true", "unknown setting 'force'"),
        (b"\xff", "mograft.toml: "),
    ],
)
def test_settings_invalid_file_is_usage_error_with_place(usage_error, clip, text, message):
    Path(CONFIG_FILE).write_bytes(text if isinstance(text, bytes) else text.encode())
    assert message in usage_error("graft", clip, "-o", "x.bvh")
    assert not Path("x.bvh").exists()
    # An invalid file does not prevent the help.
    with pytest.raises(SystemExit) as stop:
        main(["graft", "--help"])
    assert stop.value.code == 0


@pytest.mark.parametrize("setting", ["SEED=x", "SET=whim", "REPORT=yes"])
def test_settings_invalid_variable_is_named(usage_error, clip, monkeypatch, setting):
    name, _, value = setting.partition("=")
    monkeypatch.setenv(f"MOGRAFT_{name}", value)
    text = usage_error("graft", clip, "-o", "x.bvh")
    assert f"MOGRAFT_{name}" in text
    assert value in text


def test_settings_exclude_output_force_json_and_help():
    for command in COMMANDS:
        flags = {flag for argument in command.settings() for flag in argument.flags}
        assert flags.isdisjoint({"-o", "--output", "--force", "--json", "--help"}), command.name


@pytest.mark.parametrize(
    ("settings", "words", "expected"),
    [
        ("", "--variety 1", 1.875),
        ("", "--set sigma_scale=2", 2.0),
        ("", "--variety 1 --set sigma_scale=2", None),
        ("variety = 1", "", 1.875),
        ("variety = 1", "--set sigma_scale=2", 2.0),
        ("variety = 1", "--variety 0", 0.3),
        ("[set]\nsigma_scale = 2", "--variety 1", 1.875),
        ("variety = 1\n[set]\nsigma_scale = 2", "", None),
    ],
)
def test_variety_and_sigma_scale_nearest_source_wins_and_both_are_an_error(
    succeed, usage_error, clip, settings, words, expected
):
    Path(CONFIG_FILE).write_text(settings)
    options = ["graft", clip, "-o", "x.bvh", "--json", *words.split()]
    if expected is None:
        assert "--variety sets sigma_scale: give one of them, not both" in usage_error(*options)
    else:
        found = json.loads(succeed(*options)[0])["grafts"][0]["config"]["sigma_scale"]
        assert found == pytest.approx(expected)


FIELD_VALUES = {float: st.floats(0, 1e9), int: st.integers(2, 99), bool: st.booleans()}


@pytest.mark.parametrize(
    "words",
    [
        "graft FOLDER -o x",
        "candidates FOLDER --segment 1",
        "view FOLDER -o x.html",
        "plot energy FOLDER/a.bvh -o x.png",
        "plot timeline FOLDER -o x.png",
        "index FOLDER -o x",
    ],
)
def test_commands_segment_by_the_given_fields(words, succeed, folder, monkeypatch):
    pytest.importorskip("matplotlib")
    used, original = [], segmentation.segment_clip

    def segment_clip(motion, config, rate):
        used.append(config.smoothing)
        return original(motion, config, rate)

    for module in ("analysis.segmentation", "library.ingest"):
        monkeypatch.setattr(f"mograft.{module}.segment_clip", segment_clip)
    succeed(*words.replace("FOLDER", str(folder)).split(), "--set", "smoothing=0.2")
    assert set(used) == {0.2}


def test_cut_frames_are_read_from_a_json_file(succeed, usage_error, folder):
    words = ("--set", "segmentation=cuts.json")
    Path("cuts.json").write_text(json.dumps({"a": [20, 50], "b": [7]}))
    succeed("index", folder, "-o", "lib", *words)
    assert mg.Library.open("lib").segments.start.tolist() == [0, 20, 50, 0, 7]
    assert "segments by given cut frames" in succeed("lib", "info", "lib")[0]
    for text, message in [("[1]", "a mapping from names of clips"), ("{", "cuts.json: Expecting")]:
        Path("cuts.json").write_text(text)
        assert message in usage_error("graft", folder, "-o", "x", *words)


@given(st.data())
def test_parse_fields_returns_the_values_of_any_configuration(data):
    changes = {
        field.name: data.draw(FIELD_VALUES[field.type], label=field.name)
        for field in fields(mg.Config)
        if field.type in FIELD_VALUES and data.draw(st.booleans())
    }
    changes |= {
        name: data.draw(st.sampled_from(words))
        for name, words in CHOICES.items()
        if name != "segmentation" and data.draw(st.booleans())
    }
    texts = [(name, str(value)) for name, value in changes.items()]
    assert parse_fields(texts) == changes
    assert all(type(value) is type(changes[k]) for k, value in parse_fields(texts).items())


def test_settings_page_lists_all_fields():
    page = Path(__file__).parents[2] / "docs" / "settings.md"
    assert field_table() in page.read_text(encoding="utf-8"), "python -m tests.cli.field_table"
