"""Tolerated deviations from the BVH format, and errors with their positions."""

import os
import re
import tracemalloc
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given

import mograft as mg
from mograft.motion import limits
from tests.dialects import clips, dialects, to_text
from tests.io.bvh_helpers import REFLOWED_ROWS, TEXT, TEXT_VALUES, read
from tests.strategies import few_examples

CHANNELS = "CHANNELS 3 Zrotation Xrotation Yrotation"
OFFSET_FIRST = f"OFFSET 0.0 10.0 0.0\n\t\t{CHANNELS}"
SITE = "\t\tEnd Site\n\t\t{\n\t\t\tOFFSET 0.0 5.0 0.0\n\t\t}\n"
JOINT = f"\t\tJOINT Arm {{ OFFSET 0 0 0 {CHANNELS} }}\n"
TIMES = ("Frames: 3", "Frame Time: 0.04")
ROWS = TEXT[TEXT.index("0.0 90") :]
SURPLUS = "numbers on each line for 9 channels; the last ones are ignored"
REPAIRS = [
    ("HIERARCHY", "\ufeffHIERARCHY", "line 1: a byte-order mark: the text is UTF-8"),
    ("\tJOINT", "\t# the back\n\tJOINT", "line 6: a comment"),
    ("JOINT", "Joint", "line 6: Joint read as JOINT"),
    ("3 Zrotation", "3 ZROTATION", "line 9: ZROTATION read as Zrotation"),
    ("End Site", "End SITE", "line 10: End SITE read as End Site"),
    ("End Site", "End Site tip", "line 10: End Site with a name, tip"),
    ("Spine\n", "Spine ", "line 6: '{' on the line of JOINT"),
    ("\t}\n}", "\t}\n" + SITE + "}", "line 2: Hips has an End Site and other children"),
    (SITE, "", "line 6: Spine has neither JOINT nor End Site"),
    ("Spine", "Bip01 Spine", "line 6: a space in the name 'Bip01 Spine'"),
    ("Spine", "Hips", "line 6: the name 'Hips' is repeated"),
    (OFFSET_FIRST, CHANNELS + " OFFSET 0 10 0", "line 8: CHANNELS before OFFSET"),
    ("\n".join(TIMES), "\n".join(TIMES[::-1]), "line 17: Frame Time before Frames"),
    ("Frame Time:", "FrameTime:", "line 18: 'FrameTime:' read as 'Frame Time:'"),
    ("Frames: ", "Frames:", "line 17: no space after 'Frames:'"),
    ("Frames: 3", "Frames: 3.0", "line 17: 3.0 read as 3"),
    ("90.5 1.0", "90.5\n1.0", "line 20: a frame wrapped over lines"),
    ("7.0\n", "7.0 ", "line 20: several frames on one line"),
    (ROWS, REFLOWED_ROWS, "line 19: frames continue across line ends"),
    ("8.0\n", "8.0\n\x00\x00\n", "line 22: NUL or control bytes after the numbers"),
    (ROWS, ROWS.replace("\n", " 7.0 7.0\n"), f"line 19: 11 {SURPLUS}"),
    *(
        ("Frames: 3", f"Frames: {n}", f"line 17: {n} frames declared, 3 found and used")
        for n in (1, 2, 4, 10**12)
    ),
]


@pytest.mark.parametrize(("old", "new", "listed"), REPAIRS, ids=[row[2] for row in REPAIRS])
def test_read_bvh_tolerated_deviation_is_listed_with_line(old, new, listed):
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    motion = read(text)
    assert motion.repairs == (listed,)
    np.testing.assert_array_equal(motion.channel_values, TEXT_VALUES)


def test_read_bvh_repeated_deviations_are_counted():
    assert read(TEXT.lower().replace("hips", "Hips")).repairs[2:4] == (
        "line 4: offset read as OFFSET (and 2 more like it)",
        "line 5: channels read as CHANNELS (and 1 more like it)",
    )


def test_read_bvh_names_not_utf_8_are_read_as_cp1252_or_latin_1():
    motion = read(TEXT.replace("Spine", "Épaule").encode("cp1252"))
    assert motion.skeleton.names == ("Hips", "Épaule")
    assert motion.repairs == ("line 6: names are not UTF-8; read as cp1252",)
    motion = read(TEXT.replace("Spine", "Sp\x81ne").encode("latin-1"))
    assert motion.skeleton.names == ("Hips", "Sp\x81ne")


@few_examples(40)
@given(clips(), dialects())
def test_read_bvh_strict_refuses_exactly_the_repairs(clip, dialect):
    text = to_text(clip, dialect)
    repairs = read(text).repairs
    if not repairs:
        read(text, strict=True)
        return
    with pytest.raises(mg.BvhError, match="refused in strict mode") as caught:
        read(text, strict=True)
    lines = [int(re.match(r"line (\d+): ", repair).group(1)) for repair in repairs]
    assert lines == sorted(lines)
    assert caught.value.line in lines


@pytest.mark.parametrize("length", range(5))
def test_read_bvh_missing_frames_and_no_line_end_is_refused(length):
    """The file may have been cut inside its last number, which is then another number."""
    text = TEXT.rstrip() + "7311"
    text = text[: len(text) - length]
    assert read(text).n_frames == 3
    cut = text.replace("Frames: 3", "Frames: 4")
    with pytest.raises(mg.BvhError, match=r"^<.*>:21:1: expected 4 frames, got 3 and no line end"):
        read(cut)
    assert read(f"{cut}\n").n_frames == 3


def test_read_bvh_coordinate_beyond_limit_is_an_error_of_the_file():
    text = TEXT.rstrip().rpartition("\n")[0]
    width = read(TEXT).channel_values.shape[1]
    with pytest.raises(mg.BvhError, match=r"^<.*>: `positions` must be at most 1e\+100"):
        read(f"{text}\n{' '.join(['1e308'] * 3 + ['0'] * (width - 3))}\n")


def test_read_bvh_run_of_line_ends_takes_little_memory():
    text = TEXT.encode() + b"\r" * 4_000_000
    tracemalloc.start()
    try:
        assert read(text).n_frames == 3
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2 * len(text)


FRAMES = TEXT[TEXT.index("Frames: 3") :]
NO_CHANNEL = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 0\n}\nMOTION\nFrames: 9\n"
REFUSALS = [
    (TEXT, NO_CHANNEL, 6, 1, "expected at least one channel"),
    (TEXT, "<html>", 1, 1, "expected HIERARCHY, got <html>"),
    (TEXT, "", 1, 1, "expected HIERARCHY, got the end of the file"),
    ("ROOT Hips", "JOINT Hips", 2, 1, "expected ROOT, got JOINT"),
    ("JOINT Spine", "JOINT", 7, 2, "expected a name after JOINT, got {"),
    ("Spine\n\t{", "Spine\n\t", 8, 3, "expected {, got OFFSET"),
    ("\t\tOFFSET 0.0 10.0 0.0\n", "", 9, 3, "expected OFFSET, got End"),
    ("CHANNELS 3", "OFFSET 1 2 3 CHANNELS 3", 9, 3, "expected CHANNELS, got OFFSET"),
    ("10.0 0.0", "10.0", 9, 3, "expected a number of OFFSET, got CHANNELS"),
    ("\t\tCHANNELS 3 Zrotation Xrotation Yrotation\n", "", 9, 3, "expected CHANNELS, got End"),
    ("3 Zrotation", "3 Wrotation", 9, 14, "3 channels from Xposition to Zrotation for Spine, got"),
    ("3 Zrotation Xrotation", "3 Zrotation Zrotation", 9, 24, "each channel of Spine once, got Zr"),
    ("CHANNELS 3", "CHANNELS 4", 10, 3, "got End after 3"),
    ("CHANNELS 3", "CHANNELS 2", 9, 34, "expected JOINT, End Site or the }"),
    ("End Site", "End Effector", 10, 7, "expected Site after End, got Effector"),
    ("}\nMOTION", "MOTION", 15, 1, "JOINT, End Site or the } of Hips (line 2), got MOTION"),
    ("MOTION", "ROOT Other", 16, 1, "MOTION, got a second ROOT: a motion has one skeleton with on"),
    (TEXT[TEXT.index("MOTION") :], "", 16, 1, "expected MOTION, got the end"),
    ("Frames: 3\n", "", 18, 1, "expected Frames:, got 0.0"),
    ("Frame Time: 0.04\n", "", 18, 1, "expected Frame Time:, got 0.0"),
    ("Frames: 3", "Frames: -3", 17, 9, "expected the number of frames, got -3"),
    ("Frames: 3", "Frames: 2.5", 17, 9, "expected the number of frames, got 2.5"),
    ("0.04", "0", 18, 13, "expected a frame time of 1e-05 to 1000 seconds, got 0"),
    ("0.04", "0,04", 18, 13, "got 0,04 with a decimal comma"),
    ("90.5", "NaN", 20, 5, "expected a number, got NaN, which is not a finite number"),
    ("90.5", "-1.#IND", 20, 5, "got -1.#IND, which is not a finite number"),
    ("90.5", "1e999", 20, 5, "got 1e999, which is too large for a double"),
    ("90.5", "90,5", 20, 5, "got 90,5 with a decimal comma"),
    ("90.5", "9_0.5", 20, 5, "expected a number, got 9_0.5 with an underscore"),
    ("90.5", "0x5A", 20, 5, "expected a number, got 0x5A"),
    ("0.5 90.5 1.0", "0.5 90.5-1.0", 20, 5, "a number, got 90.5-1.0 without a space before -1.0"),
    ("8.0\n", "8.0\nEND OF FILE\n", 22, 1, "expected a number, got END"),
    ("8.0\n", "8.0\n" + TEXT, 22, 1, "got HIERARCHY: a file holds one motion"),
    ("8.0\n", "8.0\n\x00\x00 1.0", 22, 1, "expected a number, got"),
    (" 90.5", "", 20, 1, "expected a frame of 9 numbers, got 8 and then 9 on line 21"),
    ("90.5", "90.5 1", 20, 1, "expected a frame of 9 numbers, got 10"),
    ("7.0\n1.0", "\n7.0 1.0", 20, 1, "got 8 and then 10 on line 21"),
    (FRAMES, "Frames: 4\nFrame Time: 1\n" + REFLOWED_ROWS, 19, 1, "a frame of 9 numbers,"),
    (" 8.0", "", 21, 1, "expected 9 numbers in the last frame, got 8"),
    (FRAMES, "Frames: 0\nFrame Time: 1\n", 17, 9, "at least 1 frame, got"),
    (ROWS, "", 19, 1, "expected 3 frames, got the end of"),
    (SITE, SITE + 3 * JOINT, 24, 1, "expected 18 numbers in the last frame, got 9"),
]


@pytest.mark.parametrize(("old", "new", "line", "column", "message"), REFUSALS)
def test_read_bvh_invalid_file_error_names_position_and_expectation(
    old, new, line, column, message
):
    assert old in TEXT
    text = new if old == TEXT else TEXT.replace(old, new, 1)
    with pytest.raises(mg.BvhError) as caught:
        read(text)
    error = caught.value
    assert (error.line, error.column) == (line, column)
    assert str(error).startswith(f"<stream>:{line}:{column}: expected ")
    assert message in str(error)


@pytest.mark.parametrize(("name", "line", "column"), [("MAX_JOINTS", 14, 9), ("MAX_LEVELS", 6, 8)])
def test_read_bvh_joint_beyond_limit_is_refused_at_its_name(name, line, column):
    arms = TEXT.replace(SITE, SITE + JOINT + "no keyword")
    read(TEXT)  # the reader remembers this hierarchy
    maximum = patch.object(limits, name, 2 if name == "MAX_JOINTS" else 1)
    with maximum, pytest.raises(mg.BvhError, match="expected at most") as caught:
        read(arms)
    assert (caught.value.line, caught.value.column) == (line, column)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="requires /dev/zero")
def test_read_bvh_endless_file_of_zeros_is_refused(tmp_path):
    path = tmp_path / "z.bvh"
    path.symlink_to("/dev/zero")
    with pytest.raises(mg.BvhError, match=r"z.bvh:1:1: expected a word of fewer than 65536 char"):
        mg.read_bvh(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("n", [3, 6000, 50_000])
def test_read_bvh_file_after_comments_of_any_length_is_read(tmp_path, encoding, n):
    path = tmp_path / "a.bvh"
    path.write_bytes(("# a comment\n" * n + TEXT.replace("HIER", "hier")).encode(encoding))
    np.testing.assert_array_equal(mg.read_bvh(path).channel_values, TEXT_VALUES)


@pytest.mark.parametrize("broken", ["lone surrogate", "half a character"])
def test_read_bvh_invalid_utf_16_raises_bvh_error(broken):
    text = TEXT.encode("utf-16")
    text = text[:-1] if broken == "half a character" else text[:200] + b"\x00\xd8" + text[200:]
    with pytest.raises(mg.BvhError, match="expected UTF-16 text, got invalid bytes"):
        read(text)


@pytest.mark.parametrize("word", ["Spine", "90.5", "Zrotation"])
def test_read_bvh_too_long_word_raises_bvh_error(word):
    with pytest.raises(mg.BvhError, match="got a longer one"):
        read(TEXT.replace(word, "9" * 3_000_000))
