"""What commands print: usage errors, suggestions, warnings, ``--quiet``, and escaped names."""

import contextlib
import io
import json
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import read_bvh
from mograft.cli import main
from mograft.cli.output import EscapingStream
from mograft.cli.syntax.commands import COMMANDS
from mograft.cli.syntax.parser import parse
from tests.exit_codes import exit_code


def option_flags(command):
    """Return the long flags of all options of a command."""
    return [flag for own in command.arguments() for flag in own.flags if flag.startswith("--")]


LEAVES = [((own.name,), own) for own in COMMANDS if not own.actions]
LEAVES += [((own.name, action.name), action) for own in COMMANDS for action in own.actions]


@given(leaf=st.sampled_from(LEAVES), data=st.data())
def test_option_with_doubled_letter_is_suggested(leaf, data):
    words, command = leaf
    flag = data.draw(st.sampled_from(option_flags(command)))
    index = data.draw(st.integers(2, len(flag) - 1))
    wrong = flag[:index] + flag[index] + flag[index:]
    stream = io.StringIO()
    with contextlib.redirect_stderr(stream), pytest.raises(SystemExit):
        main([*words, "a.bvh", wrong])
    usage, error = stream.getvalue().splitlines()
    assert error.startswith(f"error: {' '.join(words)} has no option {wrong}; did you mean")
    assert usage.startswith(f"usage: mograft {' '.join(words)} ")


@given(parts=st.permutations([["a.bvh"], ["b.bvh"], ["-n", "2"], ["-o", "out"], ["-q"]]))
def test_files_and_options_may_alternate(parts):
    words = [word for part in parts for word in part]
    options = parse(["graft", *words])[1]
    assert [str(file) for file in options.files] == [own for own in words if own[-4:] == ".bvh"]
    assert (options.count, str(options.output), options.quiet) == (2, "out", True)


@pytest.mark.parametrize(("words", "command"), LEAVES, ids=["-".join(words) for words, _ in LEAVES])
def test_help_has_at_most_45_lines_and_help_all_has_all_options(
    capsys, monkeypatch, words, command
):
    monkeypatch.setenv("COLUMNS", "80")
    texts = []
    for line in ([*words, "--help"], [*words, "--help-all"], [*words[:-1], "--help-all"]):
        assert exit_code(line) == 0
        texts.append(capsys.readouterr().out)
    assert 0 < len(texts[0].splitlines()) <= 45
    shown = texts[1] if "--help-all" in texts[0] else texts[0]
    assert all(flag in shown for flag in option_flags(command))
    assert "usage: mograft" in texts[2]


def test_usage_error_is_one_usage_line_and_one_error(usage_error):
    assert usage_error("plot", "pca", "a.bvh").splitlines() == [
        "usage: mograft plot KIND LIB|FILE ... -o FILE [options] (see mograft plot --help)",
        "error: the following arguments are required: -o/--output",
    ]
    assert usage_error().splitlines()[0] == "usage: mograft COMMAND [options] (see mograft --help)"


def test_quiet_prints_results_measures_and_errors_only(run, fail, clip, monkeypatch):
    pytest.importorskip("scipy", reason="SciPy is not installed")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    measured = ["graft", clip, "--measure", "-o"]
    loud, quiet = run(*measured, "a.bvh")[2], run(*measured, "b.bvh", "--quiet")
    assert "segments exchanged" in loud
    measures = [line for line in loud.splitlines() if "head jerk, ratio" in line]
    assert quiet == (0, "b.bvh\n", f"{measures[0]}\n")
    code, out, err = run("graft", clip, "-o", "b.bvh", "-q")
    assert (code, out, err.count("\n")) == (1, "", 1)
    err = fail(4, "graft", clip, "-o", "c.bvh", "-q", "--reach", "5:LeftHand:0,9999,0")
    assert "LeftHand" in err
    assert "of the parts of" in run("evaluate", clip, "quality", "-q", "--runs", 1, "--bases", 1)[2]
    # Later commands of the same process print remarks again.
    assert run("graft", clip, "-o", "d.bvh")[2]


def test_verbose_graft_lists_every_exchanged_segment(run, clip):
    short = run("graft", clip, "-o", "a.bvh")[2]
    long = run("graft", clip, "-o", "b.bvh", "--verbose")[2]
    n_exchanged = sum(
        own["exchanged"] for own in json.loads(Path("b.json").read_text())["substitutions"]
    )
    assert n_exchanged > 0
    assert long.count("    segment ") == n_exchanged
    assert short.count("    segment ") == 0


def test_damaged_library_gives_one_warning_in_plain_words(run, clip):
    """Velocities at the ends of segments of which a bit was changed overflow in the search."""
    assert run("index", clip, "-o", "lib")[0] == 0
    for file in Path("lib").rglob("first_velocity.npy"):
        velocities = np.load(file)
        velocities[::2, :, 0] = 1e200
        np.save(file, velocities)
    code, _, err = run("graft", "lib", "-o", "g.bvh")
    assert code == 0
    assert [line for line in err.splitlines() if "warning" in line] == [
        "warning: the input has numbers that are too large, so that the result may be wrong: find "
        "them with mograft lib verify LIBRARY or mograft check FILE"
    ]


def test_equal_warnings_are_printed_once(run, clip, monkeypatch):
    def warn(_):
        for text in ("first", "second", "first"):
            warnings.warn(text, stacklevel=1)
        return 0

    monkeypatch.setattr("mograft.cli.actions.motions.run_info", warn)
    assert run("info", clip)[2] == "warning: first\nwarning: second\n"
    assert run("info", clip)[2] == "warning: first\nwarning: second\n"


def test_angle_wrap_is_listed_only_with_verbose(run, clip, tmp_path):
    lines = clip.read_text().splitlines()
    for index in range(len(lines) - read_bvh(clip).n_frames // 2, len(lines)):
        numbers = lines[index].split()
        numbers[3] = repr(float(numbers[3]) + 360.0)
        lines[index] = " ".join(numbers)
    path = tmp_path / "wrapped.bvh"
    path.write_text("\n".join(lines) + "\n")
    for command in ("check", "info"):
        short, long = run(command, path)[1], run(command, path, "--verbose")[1]
        assert len(long.splitlines()) == len(short.splitlines()) + 1
    assert run("check", path)[1] == f"{path}: good\n"
    assert "wrap: frame" in run("check", path, "-v")[1]


@given(st.text())
def test_escaped_text_has_no_control_character_but_line_ends_and_tabs(text):
    stream = io.StringIO(newline="")
    assert EscapingStream(stream).write(text) == len(text)
    controls = {c for c in map(chr, [*range(32), *range(127, 160)]) if c not in "\n\t"}
    assert not controls & set(stream.getvalue())
    assert stream.getvalue() == text or controls & set(text)


@pytest.mark.parametrize("words", [["info"], ["check"], ["candidates", "--segment", "1"]])
def test_commands_escape_names_of_files(words, clip, tmp_path, capsys):
    name = tmp_path / "walk\x1b[31m\x9b.bvh"
    name.write_bytes(clip.read_bytes())
    main([*words, str(name)])
    main([*words, str(name.with_suffix(".x.bvh"))])
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err
    assert "\x9b" not in out + err
    assert "\\x1b[31m\\x9b" in err
