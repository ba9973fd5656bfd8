"""Mistakes in the calls and the commands of data sets are named, and nothing is written."""

import pytest

from mograft import datasets
from tests.exit_codes import exit_code


@pytest.mark.parametrize(
    ("function", "options", "message"),
    [
        ("augment", {"seconds": 0.0}, "`seconds`"),
        ("augment", {"stride": 0.01}, "`stride` must be at least one frame, got 0.01"),
        ("augment", {"stride": float("nan")}, "`stride`"),
        ("augment", {"min_new": 2.0}, "`min_new`"),
        ("augment", {"features": []}, "`features` must name"),
        ("augment", {"features": ["humanml3d"]}, "needs the 22 joints of SMPL"),
        ("augment", {"split": {"p0*": "a", "p1*": "b"}, "part": "tset"}, "`part` must be one of"),
        ("augment", {"split": "auto:"}, "`split`"),
        ("augment", {"split": "auto:clip:x"}, "`split`"),
        ("augment", {"split": "auto:tag:none*"}, "`split`"),
        ("find", {}, "`query` or `text` is required"),
        ("find", {"text": '"'}, "`text` must be words"),
        ("find", {"query": "p0_100", "part": "arms"}, "`group` must be one of lower, upper"),
        ("find", {"query": "p0_100", "top": 0}, "`top`"),
        ("curate", {"radius": 1.0, "keep": 0.1}, "together with `radius`"),
        ("curate", {"keep": 1.5}, "`keep` must be"),
        ("curate", {"radius": 0.0}, "`radius` must be"),
        ("curate", {"shards": 0}, "`shards` must be"),
    ],
)
def test_wrong_options_are_refused(stored, function, options, message):
    with pytest.raises(ValueError, match=message):
        getattr(datasets, function)(stored, **options)


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("augment {lib} -o {out} -n 5 --resume", 1, "No such folder"),
        ("augment {lib} -o {full} -n 5", 1, "exists; use --resume to continue it"),
        ("augment {lib} -o {out} -n 5 --split none.csv", 1, "none.csv"),
        ("augment {lib} -o {out} -n 5 --split auto:clips", 1, "--split must be a file, auto:clip"),
        ("augment {lib} -o {out} -n 5 --bases none", 1, "--bases must match"),
        ("augment {lib} -o {out} -n 5 --features roots", 1, "did you mean 'root'?"),
        ("augment {lib} -o {out}.bvh -n 5", 2, "-o must be a folder"),
        ("augment {clips} -o {out} -n 3 -j 2", 2, "--jobs requires a library in a folder"),
        ("augment {lib} -o {out} -n 0", 2, "--count: must be from 1 to 10000000"),
        ("find {lib}", 2, " is read as LIB, the last word; before it give the clip or file"),
        ("find {lib} --text x --part upper", 2, "--part requires a clip or file before LIB"),
        ("find none {lib}", 1, "must be a clip"),
        ("find p0_100 {lib} -o {out}.png", 2, "-o must be a file that ends in .html"),
        ("find p0_100 {lib} --frames 1s-99s", 1, "--frames must be two or more frames within"),
        ("curate {lib} --keep 10% --radius 1", 2, "--keep cannot be combined with --radius"),
        ("curate {lib} --keep 200%", 2, "must be a share from 0 to 1, or a percentage"),
        ("curate {lib} --keep 0.1%", 1, "--keep must be at least"),
        ("curate {lib} --part arms", 1, "must be one of lower, upper"),
        ("curate {lib} -o {out}.bvh", 2, "-o must be a folder or a file that ends in .csv"),
        ("curate {lib} -o {out}.csv --files copy", 2, "--files requires -o with a folder"),
        ("curate {lib} -o {full}", 1, "exists; choose another folder"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(
    stored, clip_folder, tmp_path, capsys, words, code, message
):
    (tmp_path / "full").mkdir()
    (tmp_path / "full/a.txt").write_text("mine")
    places = {"lib": stored.folder, "out": tmp_path / "out", "full": tmp_path / "full"}
    places["clips"] = clip_folder
    assert exit_code(words.format(**places).split()) == code
    assert message in capsys.readouterr().err.splitlines()[-1]
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.txt", "full"]
