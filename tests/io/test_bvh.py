"""Laws of reading and writing BVH."""

import io
import re
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft.dancer import dance
from mograft.io.bvh import cursor, writer
from mograft.motion import rotations
from tests.dialects import Clip, Dialect, clips, dialects, layouts, motions, written
from tests.fuzz_bvh import SEEDS, check

SHARED = Path(__file__).parents[3] / "shared"
DATA, ODD = SHARED / "data", SHARED / "odd"
RECORDINGS = sorted(DATA.glob("*/*.bvh")) or [None]
ODD_FILES = sorted(ODD.glob("*.bvh")) or [None]

PLAIN = """\
HIERARCHY
ROOT Hips
{
	OFFSET 0.0 0.0 0.0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Spine
	{
		OFFSET 0.0 10.0 0.0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0.0 5.0 0.0
		}
	}
}
MOTION
Frames: 3
Frame Time: 0.04
0.0 90.0 0.0 1.5 -2.25 3.0 4.0 -5.5 6.0
0.5 90.5 1.0 2.5 -3.25 4.0 5.0 -6.5 7.0
1.0 91.0 2.0 3.5 -4.25 5.0 6.0 -7.5 8.0
"""
PLAIN_VALUES = np.array([line.split() for line in PLAIN.splitlines()[-3:]], dtype=float)
# Its numbers, six on each line.
REFLOWED = "\n".join(
    " ".join(map(str, PLAIN_VALUES.ravel()[n : n + 6])) for n in range(0, PLAIN_VALUES.size, 6)
)


def read(text, **options):
    file = io.BytesIO(text) if isinstance(text, bytes) else io.StringIO(text)
    return mg.read_bvh(file, **options)


def rewritten(motion):
    file = io.BytesIO()
    mg.write_bvh(motion, file)
    file.seek(0)
    return mg.read_bvh(file, strict=False)


def named(path):
    return "none" if path is None else f"{path.parent.name}/{path.stem}"


def need(path, folder):
    if path is None:
        pytest.skip(f"no files in {folder}")
    return path


def assert_same_numbers(actual, desired):
    """Compare bit for bit, zeros' signs included."""
    assert actual.shape == desired.shape
    np.testing.assert_array_equal(actual.view(np.int64), desired.view(np.int64))


def assert_same_skeleton(actual, desired):
    assert actual.names == desired.names
    assert actual.channels == desired.channels
    np.testing.assert_array_equal(actual.parents, desired.parents)
    assert_same_numbers(actual.offsets, desired.offsets)
    sites = [
        [
            (site.parent, site.before, site.name, site.offset.tobytes())
            for site in skeleton.end_sites
        ]
        for skeleton in (actual, desired)
    ]
    assert sites[0] == sites[1]


# Reading.


@given(clips(), dialects())
def test_every_dialect_says_the_same(clip, dialect):
    motion = read(written(clip, dialect))
    assert_same_skeleton(motion.skeleton, clip.skeleton)
    assert motion.frame_time == clip.frame_time
    assert_same_numbers(motion.channel_values, clip.values)


@given(clips(), dialects())
def test_strict_reading_refuses_what_is_listed_and_nothing_else(clip, dialect):
    text = written(clip, dialect)
    repairs = read(text).repairs
    if not repairs:
        read(text, strict=True)
        return
    with pytest.raises(mg.BvhError, match="refused in strict mode") as caught:
        read(text, strict=True)
    lines = [int(re.match(r"line (\d+): ", repair).group(1)) for repair in repairs]
    assert lines == sorted(lines)
    assert caught.value.line in lines


@given(clips(), layouts())
def test_white_space_is_no_repair(clip, layout):
    plain, other = (read(written(clip, dialect)).repairs for dialect in (Dialect(), layout))
    without_lines = [[repair.split(": ", 1)[1] for repair in own] for own in (plain, other)]
    assert sorted(without_lines[0]) == sorted(without_lines[1])


@settings(max_examples=50)
@given(clips(), dialects(), st.sampled_from([3, 50, 301]))
def test_the_pieces_in_which_a_file_comes_do_not_matter(clip, dialect, size):
    text = written(clip, dialect)
    whole = read(text)
    with patch.multiple(cursor, CHUNK_BYTES=size, MAX_WORD_BYTES=400):
        pieces = read(text)
        summary = mg.scan_bvh(io.BytesIO(text))
    assert_same_skeleton(pieces.skeleton, whole.skeleton)
    assert_same_numbers(pieces.channel_values, whole.channel_values)
    assert pieces.repairs == whole.repairs == summary.repairs
    assert summary.n_frames == whole.n_frames


@given(clips())
def test_text_and_binary_files_and_paths_say_the_same(tmp_path_factory, clip):
    text = written(clip, Dialect())
    path = tmp_path_factory.mktemp("clips") / "walk 1.bvh"
    path.write_bytes(text)
    from_path = mg.read_bvh(path)
    assert (from_path.name, from_path.path) == ("walk 1", path)
    with path.open(encoding="utf-8", newline="") as file:
        from_text = mg.read_bvh(file)
    assert from_text.path == path
    assert read(text).path is None
    for other in (from_text, mg.read_bvh(str(path)), read(text)):
        assert_same_skeleton(other.skeleton, from_path.skeleton)
        assert_same_numbers(other.channel_values, from_path.channel_values)


@given(clips())
def test_rotations_are_the_channels_turned_one_after_the_other(clip):
    values = np.clip(clip.values, -1e4, 1e4)
    motion = read(written(replace(clip, values=values), Dialect()))
    skeleton = motion.skeleton
    for joint, columns in enumerate(skeleton.channel_columns):
        turned = np.tile(rotations.IDENTITY, (len(values), 1))
        for name, column in zip(skeleton.channels[joint], columns, strict=True):
            if name.endswith("rotation"):
                axis = np.eye(3)["XYZ".index(name[0])]
                step = rotations.from_axis_angle(axis, np.radians(values[:, column]))
                turned = rotations.multiply(turned, step)
        np.testing.assert_allclose(
            rotations.angle(motion.rotations[:, joint], turned), 0.0, atol=1e-11
        )


@given(clips())
def test_quaternions_do_not_change_sign_from_frame_to_frame(clip):
    quats = read(written(clip, Dialect())).rotations
    assert (np.einsum("fji,fji->fj", quats[1:], quats[:-1]) >= 0).all()
    assert (quats[0, :, 3] >= 0).all()


@given(clips(), st.booleans())
def test_position_channels_stand_for_offsets_or_add_to_them(clip, add_offsets):
    motion = read(written(clip, Dialect()), add_offsets=add_offsets)
    skeleton = motion.skeleton
    expected = np.tile(skeleton.offsets, (len(clip.values), 1, 1))
    for joint, columns in enumerate(skeleton.channel_columns):
        for name, column in zip(skeleton.channels[joint], columns, strict=True):
            if name.endswith("position"):
                axis = "XYZ".index(name[0])
                own = clip.values[:, column]
                expected[:, joint, axis] = own + expected[:, joint, axis] * add_offsets
    np.testing.assert_array_equal(motion.positions, expected)
    # A file written from it means the same without the switch.
    np.testing.assert_array_equal(rewritten(motion).positions, expected)


def test_chains_deeper_than_python_recurses_are_read_and_written():
    n_joints = 6000
    skeleton = mg.Skeleton(
        tuple(f"j{joint}" for joint in range(n_joints)),
        np.arange(-1, n_joints - 1),
        np.tile([0.0, 1.0, 0.0], (n_joints, 1)),
        (("Yposition",), *[("Xrotation",)] * (n_joints - 1)),
    )
    clip = Clip(skeleton, 0.5, np.zeros((2, n_joints)))
    motion = rewritten(read(written(clip, Dialect(indent=""))))
    assert motion.n_joints == n_joints
    assert motion.world_positions()[0, -1].tolist() == [0.0, n_joints - 1, 0.0]


@pytest.mark.parametrize("declared", [1, 2, 4, 10**12])
def test_frames_are_those_found_whatever_number_is_declared(declared):
    text = PLAIN.replace("Frames: 3", f"Frames: {declared}")
    motion = read(text)
    np.testing.assert_array_equal(motion.channel_values, PLAIN_VALUES)
    assert motion.repairs == (f"line 17: {declared} frames declared, 3 found and used",)
    summary = mg.scan_bvh(io.StringIO(text))
    assert (summary.n_frames, summary.declared_frames) == (3, declared)
    assert not summary.counts_agree


# What is tolerated: (what is changed in the plain file, by what, what is listed).
REPAIRS = {
    "a mark": ("HIERARCHY", "\ufeffHIERARCHY", "line 1: a byte-order mark: the text is UTF-8"),
    "a comment": ("\tJOINT", "\t# the back\n\tJOINT", "line 6: a comment"),
    "a keyword": ("JOINT", "Joint", "line 6: Joint read as JOINT"),
    "a channel": ("3 Zrotation", "3 ZROTATION", "line 9: ZROTATION read as Zrotation"),
    "a site": ("End Site", "End SITE", "line 10: End SITE read as End Site"),
    "a named site": ("End Site", "End Site tip", "line 10: End Site with a name, tip"),
    "a brace": ("Spine\n", "Spine ", "line 6: '{' on the line of JOINT"),
    "a site beside": (
        "\t}\n}",
        "\t}\n\tEnd Site\n\t{\n\tOFFSET 0 0 0\n\t}\n}",
        "line 2: Hips has End Sites beside others",
    ),
    "no site": (
        "\t\tEnd Site\n\t\t{\n\t\t\tOFFSET 0.0 5.0 0.0\n\t\t}\n",
        "",
        "line 6: Spine has neither JOINT nor End Site",
    ),
    "a blank": ("Spine", "Bip01 Spine", "line 6: a space in the name 'Bip01 Spine'"),
    "a twin": ("Spine", "Hips", "line 6: the name 'Hips' is repeated"),
    "channels first": (
        "OFFSET 0.0 10.0 0.0\n\t\tCHANNELS 3 Zrotation Xrotation Yrotation",
        "CHANNELS 3 Zrotation Xrotation Yrotation OFFSET 0 10 0",
        "line 8: CHANNELS before OFFSET",
    ),
    "time first": (
        "Frames: 3\nFrame Time: 0.04",
        "Frame Time: 0.04\nFrames: 3",
        "line 17: Frame Time before Frames",
    ),
    "a label": ("Frame Time:", "FrameTime:", "line 18: 'FrameTime:' read as 'Frame Time:'"),
    "no blank": ("Frames: ", "Frames:", "line 17: no space after 'Frames:'"),
    "a count": ("Frames: 3", "Frames: 3.0", "line 17: 3.0 read as 3"),
    "a wrapped row": ("90.5 1.0", "90.5\n1.0", "line 20: a frame wrapped over lines"),
    "a joined row": ("7.0\n", "7.0 ", "line 20: several frames on one line"),
    "a row reflowed": (
        PLAIN[PLAIN.index("0.0 90") :],
        REFLOWED,
        "line 19: frames continue across line ends",
    ),
    "padding": ("8.0\n", "8.0\n\0\0\n", "line 22: NUL or control bytes after the numbers"),
}


@pytest.mark.parametrize("case", REPAIRS)
def test_what_is_tolerated_is_listed_with_its_line(case):
    old, new, listed = REPAIRS[case]
    assert old in PLAIN
    text = PLAIN.replace(old, new, 1)
    motion = read(text)
    assert motion.repairs == (listed,)
    np.testing.assert_array_equal(motion.channel_values, PLAIN_VALUES)
    assert mg.scan_bvh(io.StringIO(text)).repairs == (listed,)


def test_repairs_of_a_kind_are_counted():
    assert read(PLAIN.lower().replace("hips", "Hips")).repairs[2:4] == (
        "line 4: offset read as OFFSET (and 2 more like it)",
        "line 5: channels read as CHANNELS (and 1 more like it)",
    )


@pytest.mark.parametrize("size", [1, 2, 3, 5, 64])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_are_counted_over_the_ends_of_pieces(end, size):
    text = PLAIN.replace("MOTION", "\n" * 500 + "MOTION").replace("90.5", "9O.5")
    with (
        patch.multiple(cursor, CHUNK_BYTES=size, MAX_WORD_BYTES=80),
        pytest.raises(mg.BvhError) as caught,
    ):
        read(text.replace("\n", end).encode())
    assert (caught.value.line, caught.value.column) == (520, 5)


def test_names_that_are_not_utf_8_are_read_as_windows_wrote_them():
    motion = read(PLAIN.replace("Spine", "Épaule").encode("cp1252"))
    assert motion.skeleton.names == ("Hips", "Épaule")
    assert motion.repairs == ("line 6: names are not UTF-8; read as cp1252",)
    motion = read(PLAIN.replace("Spine", "Sp\x81ne").encode("latin-1"))
    assert motion.skeleton.names == ("Hips", "Sp\x81ne")


def test_a_surplus_at_the_end_of_each_line_is_left_out():
    rows = PLAIN.splitlines()
    text = "\n".join([*rows[:-3], *(row + " 7.0 7.0" for row in rows[-3:])])
    motion = read(text)
    np.testing.assert_array_equal(motion.channel_values, PLAIN_VALUES)
    assert motion.repairs == (
        "line 19: 11 numbers on each line for 9 channels; the last ones are ignored",
    )


# Refusals: (what is changed in the plain file, by what, line, column, what is said).
REFUSALS = {
    "another format": (PLAIN, "<html>", 1, 1, "expected HIERARCHY, got <html>"),
    "nothing": (PLAIN, "", 1, 1, "expected HIERARCHY, got the end of the file"),
    "blanks": (PLAIN, "\n \n ", 3, 2, "expected HIERARCHY, got the end of the file"),
    "no root": ("ROOT Hips", "JOINT Hips", 2, 1, "expected ROOT, got JOINT"),
    "no name": ("JOINT Spine", "JOINT", 7, 2, "expected a name after JOINT, got {"),
    "no brace": ("Spine\n\t{", "Spine\n\t", 8, 3, "expected {, got OFFSET"),
    "no offset": ("\t\tOFFSET 0.0 10.0 0.0\n", "", 9, 3, "expected OFFSET, got End"),
    "two offsets": (
        "CHANNELS 3",
        "OFFSET 1 2 3 CHANNELS 3",
        9,
        3,
        "expected CHANNELS, got OFFSET",
    ),
    "short offset": ("10.0 0.0", "10.0", 9, 3, "expected a number of OFFSET, got CHANNELS"),
    "no channels": (
        "\t\tCHANNELS 3 Zrotation Xrotation Yrotation\n",
        "",
        9,
        3,
        "expected CHANNELS, got End",
    ),
    "no such channel": (
        "3 Zrotation",
        "3 Wrotation",
        9,
        14,
        "expected 3 channels from Xposition to Zrotation for Spine, got Wrotation after 0",
    ),
    "scale channels": ("3 Zrotation", "3 Xscale", 9, 14, "got Xscale after 0"),
    "a channel twice": (
        "3 Zrotation Xrotation",
        "3 Zrotation Zrotation",
        9,
        24,
        "expected each channel of Spine once, got Zrotation again",
    ),
    "too few channels": ("CHANNELS 3", "CHANNELS 4", 10, 3, "got End after 3"),
    "too many channels": ("CHANNELS 3", "CHANNELS 2", 9, 34, "expected JOINT, End Site or the }"),
    "a broken count": ("CHANNELS 3", "CHANNELS 3.5", 9, 12, "expected the number of channels"),
    "no site": ("End Site", "End Effector", 10, 7, "expected Site after End, got Effector"),
    "a brace too many": ("MOTION", "}\nMOTION", 16, 1, "expected MOTION, got }"),
    "a brace too few": (
        "}\nMOTION",
        "MOTION",
        15,
        1,
        "expected JOINT, End Site or the } of Hips (line 2), got MOTION",
    ),
    "two roots": (
        "MOTION",
        "ROOT Other",
        16,
        1,
        "expected MOTION, got a second ROOT: a motion has one skeleton with one root",
    ),
    "no motion": (PLAIN[PLAIN.index("MOTION") :], "", 16, 1, "expected MOTION, got the end"),
    "no frames": ("Frames: 3\n", "", 18, 1, "expected Frames:, got 0.0"),
    "no frame time": ("Frame Time: 0.04\n", "", 18, 1, "expected Frame Time:, got 0.0"),
    "negative frames": ("Frames: 3", "Frames: -3", 17, 9, "expected the number of frames, got -3"),
    "half a frame": ("Frames: 3", "Frames: 2.5", 17, 9, "expected the number of frames, got 2.5"),
    "no time": ("0.04", "0", 18, 13, "expected a frame time above 0 seconds, got 0"),
    "negative time": ("0.04", "-0.04", 18, 13, "expected a frame time above 0 seconds, got -0.04"),
    "nan time": ("0.04", "nan", 18, 13, "expected the frame time in seconds, got nan"),
    "comma time": ("0.04", "0,04", 18, 13, "got 0,04 with a decimal comma"),
    "nan": ("90.5", "NaN", 20, 5, "expected a number, got NaN, which is not a finite number"),
    "windows' nan": ("90.5", "-1.#IND", 20, 5, "got -1.#IND, which is not a finite number"),
    "infinity": (
        "90.5",
        "-inf",
        20,
        5,
        "expected a number, got -inf, which is not a finite number",
    ),
    "overflow": ("90.5", "1e999", 20, 5, "got 1e999, which is too large for a double"),
    "decimal comma": ("90.5", "90,5", 20, 5, "got 90,5 with a decimal comma"),
    "underscore": ("90.5", "9_0.5", 20, 5, "expected a number, got 9_0.5 with an underscore"),
    "hexadecimal": ("90.5", "0x5A", 20, 5, "expected a number, got 0x5A"),
    "glued": (
        "0.5 90.5 1.0",
        "0.5 90.5-1.0",
        20,
        5,
        "expected a number, got 90.5-1.0 without a space before -1.0",
    ),
    "glued points": ("0.5 90.5 1.0", "0.5 90.51.0", 20, 5, "without a space before .0"),
    "text after": ("8.0\n", "8.0\nEND OF FILE\n", 22, 1, "expected a number, got END"),
    "comment after": ("8.0\n", "8.0\n# end\n", 22, 1, "expected a number, got #"),
    "two motions": ("8.0\n", "8.0\n" + PLAIN, 22, 1, "got HIERARCHY: a file holds one motion"),
    "text after nul": ("8.0\n", "8.0\n\0\0 1.0", 22, 1, "expected a number, got"),
    "a number missing": (
        " 90.5",
        "",
        20,
        1,
        "expected a frame of 9 numbers, got 8 and then 9 on line 21",
    ),
    "a number too many": ("90.5", "90.5 1", 20, 1, "expected a frame of 9 numbers, got 10"),
    "a number moved": ("7.0\n1.0", "\n7.0 1.0", 20, 1, "got 8 and then 10 on line 21"),
    "reflowed to another count": (
        PLAIN[PLAIN.index("Frames: 3") :],
        "Frames: 4\nFrame Time: 0.04\n" + REFLOWED,
        19,
        1,
        "expected a frame of 9 numbers, got 6 and then 6 on line 20",
    ),
    "the last number missing": (" 8.0", "", 21, 1, "expected 9 numbers in the last frame, got 8"),
    "no frames at all": (
        PLAIN[PLAIN.index("Frames: 3") :],
        "Frames: 0\nFrame Time: 1\n",
        19,
        1,
        "expected 1 frames, got the end of the file",
    ),
    "no rows": (PLAIN[PLAIN.index("0.0 90") :], "", 19, 1, "expected 3 frames, got the end of"),
    "channels doubled": (
        "CHANNELS 3 Zrotation Xrotation Yrotation\n\t\tEnd",
        "CHANNELS 3 Zrotation Xrotation Yrotation\n"
        "\t\tJOINT Head { OFFSET 0 0 0 CHANNELS 6 "
        "Xposition Yposition Zposition Zrotation Xrotation Yrotation }\n"
        "\t\tJOINT Hand { OFFSET 0 0 0 CHANNELS 3 Zrotation Xrotation Yrotation }\n\t\tEnd",
        23,
        1,
        "expected 18 numbers in the last frame, got 9",
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_refusals_name_the_place_and_what_was_expected(case):
    old, new, line, column, message = REFUSALS[case]
    assert old in PLAIN
    text = new if old == PLAIN else PLAIN.replace(old, new, 1)
    for source in (read, lambda text: mg.scan_bvh(io.StringIO(text))):
        with pytest.raises(mg.BvhError) as caught:
            source(text)
        error = caught.value
        assert (error.line, error.column) == (line, column)
        assert str(error).startswith(f"<stream>:{line}:{column}: expected ")
        assert message in str(error)


def test_no_channel_at_all_is_refused():
    text = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 0\n}\nMOTION\nFrames: 9\nFrame Time: 1\n"
    with pytest.raises(mg.BvhError, match="6:1: expected at least one channel"):
        read(text)


@pytest.mark.parametrize("broken", ["lone surrogate", "half a character"])
def test_broken_utf_16_is_refused(broken):
    text = PLAIN.encode("utf-16")
    text = text[:-1] if broken == "half a character" else text[:200] + b"\x00\xd8" + text[200:]
    with pytest.raises(mg.BvhError, match="expected UTF-16 text, got invalid bytes"):
        read(text)


@pytest.mark.parametrize("where", ["name", "number", "channel"])
def test_words_without_end_are_refused(where):
    endless = "9" * 3_000_000
    text = {
        "name": PLAIN.replace("Spine", endless),
        "number": PLAIN.replace("90.5", endless),
        "channel": PLAIN.replace("3 Zrotation", "3 " + endless),
    }[where]
    with pytest.raises(mg.BvhError, match="got a longer one"):
        read(text)


def test_sources_that_are_none_are_refused():
    with pytest.raises(TypeError, match="source must be a path or a file object, got int"):
        mg.read_bvh(3)
    with pytest.raises(FileNotFoundError):
        mg.read_bvh("no/such/file.bvh")


def test_a_folder_that_is_not_there_is_named(tmp_path):
    motion = dance(strides=1).motion[:3]
    for write, name in ((mg.write_bvh, "a.bvh"), (mg.write_npz, "a.npz"), (mg.write_glb, "a.glb")):
        with pytest.raises(FileNotFoundError, match="no such folder") as caught:
            write(motion, tmp_path / "none" / name)
        assert caught.value.filename == str(tmp_path / "none")


@given(st.integers(0, 2**32))
def test_damaged_files_are_read_or_refused(seed):
    check(seed)


@pytest.mark.parametrize("seed", SEEDS)
def test_damaged_files_that_once_failed_are_read_or_refused(seed):
    check(seed)


# Writing.


@given(clips())
def test_what_was_read_is_written_as_it_was_read(clip):
    motion = read(written(clip, Dialect()))
    again = rewritten(motion)
    assert_same_skeleton(again.skeleton, clip.skeleton)
    assert again.frame_time == clip.frame_time
    assert_same_numbers(again.channel_values, clip.values)
    assert_same_numbers(again.rotations, motion.rotations)


@given(motions())
def test_what_is_new_is_written_in_the_channels_there_are(motion):
    again = rewritten(motion)
    skeleton = motion.skeleton
    for joint, channels in enumerate(skeleton.channels):
        if len(skeleton.rotation_order(joint)) == 3:
            off = rotations.angle(again.rotations[:, joint], motion.rotations[:, joint])
            np.testing.assert_allclose(off, 0.0, atol=1e-7)
        for axis, letter in enumerate("XYZ"):
            if f"{letter}position" in channels:
                own = motion.positions[:, joint, axis]
                np.testing.assert_array_equal(again.positions[:, joint, axis], own)


@given(motions())
def test_new_angles_do_not_jump_by_more_than_half_a_turn(motion):
    numbers = rewritten(motion).channel_values
    for joint, columns in enumerate(motion.skeleton.channel_columns):
        for name, column in zip(motion.skeleton.channels[joint], columns, strict=True):
            if name.endswith("rotation"):
                assert (np.abs(np.diff(numbers[:, column])) <= 180.0 + 1e-9).all()


@given(clips(), st.data())
def test_numbers_of_joints_left_alone_stay_bit_for_bit(clip, data):
    # Near angles of many turns new ones have no more digits than those.
    motion = read(written(replace(clip, values=clip.values % 1e3), Dialect()))
    skeleton = motion.skeleton
    joint = data.draw(st.integers(0, skeleton.n_joints - 1))
    frames = slice(*sorted(data.draw(st.tuples(*[st.integers(0, motion.n_frames)] * 2))))
    columns = list(skeleton.channel_columns[joint])
    values = motion.channel_values.copy()
    values[frames, columns] = np.nan
    turned = motion.rotations.copy()
    turned[frames, joint] = rotations.from_axis_angle([1.0, 2.0, 3.0], 0.7)
    again = rewritten(replace(motion, rotations=turned, channel_values=values))
    known = ~np.isnan(values)
    np.testing.assert_array_equal(
        again.channel_values[known].view(np.int64), values[known].view(np.int64)
    )
    if len(skeleton.rotation_order(joint)) == 3:
        off = rotations.angle(again.rotations[frames, joint], turned[frames, joint])
        np.testing.assert_allclose(off, 0.0, atol=1e-7)


def test_joints_are_written_in_the_order_of_the_hierarchy_whatever_their_own():
    names = ("root", "left", "right", "left hand", "right hand")
    skeleton = mg.Skeleton(names, np.array([-1, 0, 0, 1, 2]), np.eye(5, 3))
    turned = rotations.from_axis_angle([0, 1, 0], np.arange(10.0).reshape(2, 5) / 9)
    motion = mg.Motion(skeleton, 0.1, turned, np.tile(skeleton.offsets, (2, 1, 1)))
    again = rewritten(motion)
    assert again.skeleton.names == ("root", "left", "left hand", "right", "right hand")
    order = [0, 1, 3, 2, 4]
    off = rotations.angle(again.rotations, motion.rotations[:, order])
    np.testing.assert_allclose(off, 0.0, atol=1e-12)


def test_text_and_binary_files_and_paths_are_written_alike(tmp_path):
    motion = read(PLAIN)
    as_text, as_bytes = io.StringIO(), io.BytesIO()
    mg.write_bvh(motion, as_text)
    mg.write_bvh(motion, as_bytes)
    mg.write_bvh(motion, tmp_path / "a.bvh")
    assert as_text.getvalue() == as_bytes.getvalue().decode() == PLAIN
    assert (tmp_path / "a.bvh").read_bytes() == PLAIN.encode()


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text("precious")
    motion = read(PLAIN)
    with (
        patch.object(writer._core, "format_rows", side_effect=MemoryError),
        pytest.raises(MemoryError),
    ):
        mg.write_bvh(motion, path)
    assert path.read_text() == "precious"
    mg.write_bvh(motion, path)
    assert path.read_text() == PLAIN
    assert [child.name for child in tmp_path.iterdir()] == ["walk.bvh"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "link.bvh").symlink_to(tmp_path / "walk.bvh")
    mg.write_bvh(read(PLAIN), tmp_path / "link.bvh")
    assert (tmp_path / "link.bvh").is_symlink()
    assert (tmp_path / "walk.bvh").read_text() == PLAIN


@pytest.mark.parametrize("name", ["", "a\nb", "a{b", " a", "a\t", "\ud800"])
def test_names_that_the_format_cannot_hold_are_not_written(name):
    motion = read(PLAIN)
    skeleton = replace(motion.skeleton, names=("Hips", name))
    with pytest.raises(ValueError, match="joint 1 "):
        mg.write_bvh(replace(motion, skeleton=skeleton), io.BytesIO())


def test_a_motion_without_channels_is_not_written():
    skeleton = mg.Skeleton(("a",), np.array([-1]), np.zeros((1, 3)), ((),))
    still = mg.Motion(skeleton, 1.0, np.array([[rotations.IDENTITY]]), np.zeros((1, 1, 3)))
    # An empty tuple of channels is what the default stands for; that of a joint is not.
    assert still.skeleton.n_channels == 0
    with pytest.raises(ValueError, match="must have a channel"):
        mg.write_bvh(still, io.BytesIO())


# Recordings, and files that people met.


@pytest.mark.parametrize("path", RECORDINGS, ids=named)
def test_recordings_come_back_as_the_numbers_that_were_read(path):
    motion = mg.read_bvh(need(path, DATA))
    again = rewritten(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)
    assert_same_numbers(again.rotations, motion.rotations)
    assert again.frame_time == motion.frame_time
    assert mg.scan_bvh(path).counts_agree


def sensible_behaviour():
    """What the list of odd files asks for: accept or refuse, and joints and frames."""
    table = ODD / "README.md"
    if not table.exists():
        return {}
    rows = re.findall(
        r"^\| (\w+) \| [^\n]*?\| ((?:accept|clear reject|reject)[^|]*)\|", table.read_text(), re.M
    )
    return dict(rows)


SENSIBLE = sensible_behaviour()


@pytest.mark.parametrize("path", ODD_FILES, ids=named)
def test_odd_files_are_read_or_refused_as_is_sensible(path):
    sensible = SENSIBLE[need(path, ODD).stem]
    if not re.search("accept|or ", sensible):
        with pytest.raises(mg.BvhError, match=rf"{path.name}:\d+:\d+: expected .*, got "):
            mg.read_bvh(path)
        return
    try:
        motion = mg.read_bvh(path)
    except mg.BvhError:
        if "reject" in sensible:
            return
        raise
    if counts := re.search(
        r"\((\d+) joints?, (?:\d+ channels, )?(\d+)(?: or (\d+))? frames?", sensible
    ):
        joints, *frames = (int(count) for count in counts.groups() if count)
        assert motion.n_joints == joints
        assert motion.n_frames in frames
    assert np.isfinite(motion.channel_values).all()
    again = rewritten(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)


def test_no_odd_file_is_left_out():
    need(ODD_FILES[0], ODD)
    assert {path.stem for path in ODD_FILES} == set(SENSIBLE)
