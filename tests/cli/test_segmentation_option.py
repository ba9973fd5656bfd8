"""The option ``--segmentation`` of all commands that segment motions."""

import json

import pytest

import mograft as mg
from mograft.cli import main


@pytest.mark.parametrize(
    "words",
    [
        "graft {folder} -o x --segmentation com",
        "candidates {folder} --segment 1 --segmentation com",
        "view {folder} -o x.html --segmentation com",
        "plot energy {folder}/a.bvh -o x.png --segmentation com",
        "plot timeline {folder} -o x.png --segmentation com",
        "index {folder} -o x --segmentation com",
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
    assert set(used) == {"com"}


def test_index_stores_the_method_with_its_parameters_for_add(folder, capsys):
    assert (
        main(["index", f"{folder}/a.bvh", "-o", "lib", "--segmentation", "com:min_depth=0.02"]) == 0
    )
    assert main(["index", f"{folder}/b.bvh", "-o", "lib", "--add"]) == 0
    capsys.readouterr()
    assert main(["lib", "info", "lib"]) == 0
    assert "segments by com, min_depth 0.02" in capsys.readouterr().out
    library = mg.Library.open("lib")
    assert library.config.segmentation_parameters == {"min_depth": 0.02}
    expected = [mg.segment(clip, method="com", min_depth=0.02) for clip in library.clips]
    assert len(library.segments) == sum(map(len, expected))


def test_cut_frames_are_read_from_a_json_file(folder, working_folder, capsys):
    (working_folder / "cuts.json").write_text(json.dumps({"a": [20, 50], "b": [7]}))
    assert main(["index", str(folder), "-o", "lib", "--segmentation", "cuts.json"]) == 0
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
        assert main(["graft", str(folder), "-o", "x", "--segmentation", "cuts.json"]) == 1
        assert message in capsys.readouterr().err


def test_setting_selects_the_method_of_new_libraries_only(folder, working_folder):
    assert main(["index", str(folder), "-o", "lib"]) == 0
    (working_folder / "mograft.toml").write_text('segmentation = "contacts:events=touchdown"\n')
    assert main(["graft", "lib", "-o", "x"]) == 0
    assert main(["index", str(folder), "-o", "other"]) == 0
    config = mg.Library.open("other").config
    assert (config.segmentation, config.segmentation_parameters) == (
        "contacts",
        {"events": "touchdown"},
    )
