"""The option ``--segmentation`` of all commands that segment motions."""

import json
from pathlib import Path

import numpy as np
import pytest

import mograft as mg
from mograft._util.registry import CONFIG_OPTIONS
from mograft.cli import main

NAMES = CONFIG_OPTIONS["segmentation"].names


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

    option = ("--segmentation", name)
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


def test_unknown_method_names_the_methods_and_the_file(clip, usage_error):
    message = usage_error("graft", clip, "-o", "x", "--segmentation", "nope")
    assert (
        f"--segmentation: must be one of {', '.join(NAMES)} or the name of a .json file with cut "
        "frames; got 'nope'"
    ) in message
    assert "did you mean 'beats'?" in usage_error("view", clip, "-o", "x", "--segmentation", "beat")


@pytest.mark.parametrize(
    "words",
    [
        "graft {folder} -o x --segmentation beats",
        "candidates {folder} --segment 1 --segmentation beats",
        "view {folder} -o x.html --segmentation beats",
        "plot energy {folder}/a.bvh -o x.png --segmentation beats",
        "plot timeline {folder} -o x.png --segmentation beats",
        "index {folder} -o x --segmentation beats",
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
    assert (
        main(["index", f"{folder}/a.bvh", "-o", "lib", "--segmentation", "beats:longest=1.2"]) == 0
    )
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
    (working_folder / "mograft.toml").write_text('segmentation = "beats:longest=1.2"\n')
    assert main(["graft", "lib", "-o", "x"]) == 0
    assert main(["index", str(folder), "-o", "other"]) == 0
    config = mg.Library.open("other").config
    assert (config.segmentation, config.segmentation_parameters) == (
        "beats",
        {"longest": 1.2},
    )
