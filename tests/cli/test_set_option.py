"""The option ``--set`` of all commands, and the table of the fields in docs/settings.md."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util.registry import CONFIG_OPTIONS
from mograft.cli import main
from mograft.config_text import parse_fields
from tests.cli.field_table import field_table

NAMES = CONFIG_OPTIONS["segmentation"].names
FIELD_VALUES = {float: st.floats(0, 1e9), int: st.integers(2, 99), bool: st.booleans()}


@pytest.mark.parametrize("name", NAMES)
def test_every_entry_point_takes_every_method_and_libraries_remember_it(name, clip, run):
    config = mg.Config(segmentation=name)
    motion = mg.read_bvh(clip)
    expected = mg.segment(motion, config)
    stops = str(expected.stop.tolist()).replace(" ", "")

    library = mg.Library.index(clip, "indexed", config=config)
    assert mg.graft(library, seed=1).library.config == config
    assert len(mg.candidates(library, 0, "upper")) >= 1
    assert stops in mg.view(motion, config=config, show=False).html
    if name == "energy":
        stream = mg.Stream(library)
        stream.push(motion)
        stream.close()
        assert mg.join_pieces(stream.pieces()).n_frames == motion.n_frames
    else:
        with pytest.raises(ValueError, match="segmentation` must be 'energy' in a stream"):
            mg.Stream(library)

    option = ("--set", f"segmentation={name}")
    assert run("index", clip, "-o", "lib", *option)[0] == 0
    assert run("graft", clip, "-o", "new", *option)[0] == 0
    (record,) = [json.loads(path.read_text()) for path in Path("new").glob("*.json")]
    assert record["config"].get("segmentation", "energy") == name
    assert run("view", clip, "-o", "page.html", *option)[0] == 0
    assert stops in Path("page.html").read_text()
    for words in ((clip, *option), ("lib",)):
        code, out, _ = run("candidates", *words, "--segment", "0", "--json")
        assert code == 0
        assert json.loads(out)["frames"] == [0, expected.stop[0]]
    for folder in ("indexed", "lib"):
        opened = mg.Library.open(folder)
        assert opened.config == config
        np.testing.assert_array_equal(opened.segments.start, expected.start)


@pytest.mark.parametrize(
    "words",
    [
        "graft {folder} -o x --set segmentation=beats",
        "candidates {folder} --segment 1 --set segmentation=beats",
        "view {folder} -o x.html --set segmentation=beats",
        "plot energy {folder}/a.bvh -o x.png --set segmentation=beats",
        "plot timeline {folder} -o x.png --set segmentation=beats",
        "index {folder} -o x --set segmentation=beats",
    ],
)
def test_commands_segment_by_the_given_method(words, folder, monkeypatch):
    pytest.importorskip("matplotlib")
    used = []
    from mograft.analysis import segmentation

    original = segmentation.segment_clip
    for module in ("analysis.segmentation", "library.ingest"):
        monkeypatch.setattr(
            f"mograft.{module}.segment_clip",
            lambda motion, config, rate: (
                used.append(config.segmentation) or original(motion, config, rate)
            ),
        )
    assert main([word.format(folder=folder) for word in words.split()]) == 0
    assert set(used) == {"beats"}


def test_index_stores_the_method_with_its_parameters_for_add(folder, capsys):
    fields = ["--set", "segmentation=beats", "--set", "segmentation_parameters.longest=1.2"]
    assert main(["index", f"{folder}/a.bvh", "-o", "lib", *fields]) == 0
    assert main(["index", f"{folder}/b.bvh", "-o", "lib", "--add"]) == 0
    capsys.readouterr()
    assert main(["lib", "info", "lib"]) == 0
    assert "segments by beats, longest 1.2" in capsys.readouterr().out
    library = mg.Library.open("lib")
    assert library.config.segmentation_parameters == {"longest": 1.2}
    expected = [mg.segment(clip, method="beats", longest=1.2) for clip in library.clips]
    assert len(library.segments) == sum(map(len, expected))


def test_cut_frames_are_read_from_a_json_file(folder, working_folder, capsys):
    (working_folder / "cuts.json").write_text(json.dumps({"a": [20, 50], "b": [7]}))
    assert main(["index", str(folder), "-o", "lib", "--set", "segmentation=cuts.json"]) == 0
    assert mg.Library.open("lib").segments.start.tolist() == [0, 20, 50, 0, 7]
    capsys.readouterr()
    assert main(["lib", "info", "lib"]) == 0
    assert "segments by given cut frames" in capsys.readouterr().out
    for text, message in [
        ("[1]", "expected an object"),
        ("{", "cuts.json: Expecting"),
        ('{"a": [2, 1]}', "for the clip 'a' must be ascending"),
    ]:
        (working_folder / "cuts.json").write_text(text)
        with pytest.raises(SystemExit):
            main(["graft", str(folder), "-o", "x", "--set", "segmentation=cuts.json"])
        assert message in capsys.readouterr().err


def test_setting_selects_the_method_of_new_libraries_only(folder, working_folder):
    assert main(["index", str(folder), "-o", "lib"]) == 0
    (working_folder / "mograft.toml").write_text(
        '[set]\nsegmentation = "beats"\nsegmentation_parameters.longest = 1.2\n'
    )
    assert main(["graft", "lib", "-o", "x"]) == 0
    assert main(["index", str(folder), "-o", "other"]) == 0
    config = mg.Library.open("other").config
    assert (config.segmentation, config.segmentation_parameters) == (
        "beats",
        {"longest": 1.2},
    )


@given(st.data())
def test_parse_fields_returns_the_values_of_any_configuration(data):
    changes = {
        field.name: data.draw(FIELD_VALUES[field.type], label=field.name)
        for field in fields(mg.Config)
        if field.type in FIELD_VALUES and data.draw(st.booleans())
    }
    changes |= {
        name: data.draw(st.sampled_from(registry.names))
        for name, registry in CONFIG_OPTIONS.items()
        if name != "segmentation" and data.draw(st.booleans())
    }
    texts = [(name, str(value)) for name, value in changes.items()]
    assert parse_fields(texts) == changes
    assert all(type(value) is type(changes[k]) for k, value in parse_fields(texts).items())


def test_settings_page_lists_all_fields():
    page = Path(__file__).parents[2] / "docs" / "settings.md"
    assert field_table() in page.read_text(encoding="utf-8"), "python -m tests.cli.field_table"
