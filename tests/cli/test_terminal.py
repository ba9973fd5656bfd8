"""Output of names that contain control characters."""

import io
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.cli import main
from mograft.cli.output import EscapingStream, escape_output


@given(st.text())
def test_escaped_text_has_no_control_character_but_line_ends_and_tabs(text):
    stream = io.StringIO(newline="")
    assert EscapingStream(stream).write(text) == len(text)
    written = stream.getvalue()
    is_control = [ord(c) < 32 or 127 <= ord(c) < 160 for c in written]
    assert {c for c, control in zip(written, is_control, strict=True) if control} <= {"\n", "\t"}
    if not any(ord(c) < 32 or 127 <= ord(c) < 160 for c in text):
        assert written == text


def test_escape_output_restores_the_streams():
    streams = sys.stdout, sys.stderr
    with escape_output():
        assert (sys.stdout.unescaped, sys.stderr.unescaped) == streams
    assert (sys.stdout, sys.stderr) == streams


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
