"""Invalid command lines: the exit code and the message."""

import pytest

from mograft.cli import main


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
        ["graft", "a.bvh", "-o", "out", "--set", "choice=whim"],
        ["graft", "a.bvh", "-o", "out", "--reach", "5:Hand:1,2"],
        ["graft", "a.bvh", "-o", "out", "--reach", "Hand:1,2,3"],
        ["graft", "a.bvh", "-o", "out", "--avoid", "sphere:1,2,3"],
        ["graft", "a.bvh", "-o", "out", "--avoid", "cone:1,2,3"],
        ["graft", "a.bvh", "-o", "out", "--keep", "9-3"],
        ["graft", "a.bvh", "-o", "out", "--take", "24"],
        ["graft", "a.bvh", "-o", "out", "--take", "24=b"],
        ["graft", "a.bvh", "-o", "out", "--take", "24=b:9-3"],
        ["graft", "a.bvh", "-o", "out", "--take", "x=b:3-9"],
        ["graft", "a.bvh", "-o", "out", "--ban", "x"],
        ["graft", "a.bvh", "-o", "out", "--ban", "3="],
        ["graft", "a.bvh", "-o", "out", "--ban", "3=b:9-3"],
        ["graft", "a.bvh", "-o", "out", "--repair", "-n", "2"],
        ["candidates", "a.bvh"],
        ["candidates", "a.bvh", "--segment", "1", "--frame", "2"],
    ],
)
def test_main_wrong_usage_returns_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "option", "value", "expected"),
    [
        ("graft", "--seed", "x", "an integer of at least 0"),
        ("graft", "--count", "1.5", "an integer of at least 1"),
        ("graft", "--max-stretch", "nan", "a number of at least 0"),
        ("graft", "--max-angle", "-4", "a number above 0"),
        ("graft", "--variety", "1.5", "a number from 0 to 1"),
        ("index", "--rate", "0", "a number above 0"),
        ("evaluate", "--rate", "inf", "a number above 0"),
        ("export", "--rate", "fast", "a number above 0"),
        ("export", "--scale", "furlong", "m, cm, mm, inch, CMU or a number above 0"),
    ],
)
def test_main_number_out_of_range_names_option_and_range(capsys, command, option, value, expected):
    with pytest.raises(SystemExit) as stop:
        main([command, "a.bvh", "-o", "out", option, value])
    assert stop.value.code == 2
    err = capsys.readouterr().err
    assert option in err.splitlines()[-1]
    assert f"must be {expected}, got {value}" in err


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("sigma_scale=nan", "`sigma_scale` must be above 0, got nan"),
        ("temperature=-1", "`temperature` must be above 0, got -1.0"),
        ("temperature=hot", "`temperature` must be a number, got 'hot'"),
        ("components=1.5", "`components` must be a whole number of at least 1, got '1.5'"),
        ("self_repair=maybe", "`self_repair` must be True or False, got 'maybe'"),
        ("choice=whim", "`choice` must be one of 'viterbi', 'best', 'sample', 'nearest', 'random'"),
        ("smoothing.x=1", "'smoothing.x' is no field of Config"),
    ],
)
def test_main_invalid_field_names_it_and_what_is_expected(capsys, folder, assignment, message):
    for command in ("graft", "index"):
        with pytest.raises(SystemExit) as stop:
            main([command, str(folder), "-o", "out", "--set", assignment])
        assert stop.value.code == 2
        assert f"error: --set: {message}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("graft {} --avoid sphere:0,0,0,-1", "--avoid sphere: `radius` must not be negative"),
        ("plot pca {} --frames 1-5", "--frames requires strip, timeline, energy; got pca"),
        (
            "plot strip {} --group lower",
            "--group requires pca, dendrogram, clusters; got strip",
        ),
        (
            "view {} --groups wings",
            "--groups must be a TOML file, auto, auto:N or one of lower_upper",
        ),
        ("evaluate {} qualiti", "expected a file or one of quality, world, detectability"),
    ],
)
def test_main_option_without_effect_is_usage_error(capsys, folder, tmp_path, words, message):
    target = tmp_path / {"graft": "new", "view": "new.html"}.get(words.split()[0], "new.png")
    words = [word.format(folder / "a.bvh") for word in words.split()]
    with pytest.raises(SystemExit) as stop:
        main([*words, "-o", str(target)])
    assert stop.value.code == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
