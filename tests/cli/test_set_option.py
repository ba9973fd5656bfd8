"""The option ``--set`` of all commands, and the table of the fields in docs/settings.md."""

import json
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.cli import main
from mograft.config import CHOICES
from mograft.config_text import parse_fields
from tests.cli.field_table import field_table

FIELD_VALUES = {float: st.floats(0, 1e9), int: st.integers(2, 99), bool: st.booleans()}


@pytest.mark.parametrize(
    "words",
    [
        "graft {folder} -o x --set smoothing=0.2",
        "candidates {folder} --segment 1 --set smoothing=0.2",
        "view {folder} -o x.html --set smoothing=0.2",
        "plot energy {folder}/a.bvh -o x.png --set smoothing=0.2",
        "plot timeline {folder} -o x.png --set smoothing=0.2",
        "index {folder} -o x --set smoothing=0.2",
    ],
)
def test_commands_segment_by_the_given_fields(words, folder, monkeypatch):
    pytest.importorskip("matplotlib")
    used = []
    from mograft.analysis import segmentation

    original = segmentation.segment_clip
    for module in ("analysis.segmentation", "library.ingest"):
        monkeypatch.setattr(
            f"mograft.{module}.segment_clip",
            lambda motion, config, rate: (
                used.append(config.smoothing) or original(motion, config, rate)
            ),
        )
    assert main([word.format(folder=folder) for word in words.split()]) == 0
    assert set(used) == {0.2}


def test_cut_frames_are_read_from_a_json_file(folder, working_folder, capsys):
    (working_folder / "cuts.json").write_text(json.dumps({"a": [20, 50], "b": [7]}))
    assert main(["index", str(folder), "-o", "lib", "--set", "segmentation=cuts.json"]) == 0
    assert mg.Library.open("lib").segments.start.tolist() == [0, 20, 50, 0, 7]
    capsys.readouterr()
    assert main(["lib", "info", "lib"]) == 0
    assert "segments by given cut frames" in capsys.readouterr().out
    for text, message in [
        ("[1]", "a mapping from names of clips"),
        ("{", "cuts.json: Expecting"),
        ('{"a": [2, 1]}', "for the clip 'a' must be ascending"),
    ]:
        (working_folder / "cuts.json").write_text(text)
        with pytest.raises(SystemExit):
            main(["graft", str(folder), "-o", "x", "--set", "segmentation=cuts.json"])
        assert message in capsys.readouterr().err


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
