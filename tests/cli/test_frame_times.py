"""Frames and times in options, and the numbers of frames that they select."""

import json
from argparse import ArgumentTypeError

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import read_bvh
from mograft.cli.syntax import values
from mograft.cli.syntax.values import frame, frames, resolve_frames

NUMBERS = st.integers(0, 10**6)
RATES = st.floats(1, 1000)


@given(NUMBERS, RATES)
def test_time_of_a_frame_resolves_to_the_frame(number, rate):
    assert resolve_frames(frame(f"{number / rate:.9f}s"), rate) == number
    assert resolve_frames(frame(str(number)), rate) == number


@given(NUMBERS, NUMBERS, st.sampled_from(["", "s"]))
def test_range_is_accepted_only_if_ascending(first, last, suffix):
    text = f"{first}{suffix}-{last}{suffix}"
    if first > last:
        with pytest.raises(ArgumentTypeError, match="FIRST not above LAST"):
            frames(text)
    else:
        factor = 7 if suffix else 1
        assert resolve_frames(frames(text), 7.0) == (factor * first, factor * last)


@given(NUMBERS, st.sampled_from(["", "s"]), st.sampled_from(["", "=wave", "=a-b:3-9"]))
def test_change_without_last_frame_reads_as_with_it_but_for_the_end(first, suffix, donor):
    group, span, chosen = values.change(f"larm@{first}{suffix}-{donor}")
    whole = values.change(f"larm@{first}{suffix}-{first + 1}{suffix}{donor}")
    assert (group, (span[0], whole[1][1]), chosen) == whole
    assert span[1] is None


@given(st.text(alphabet="0123456789.s-e+_ ", max_size=6))
def test_frame_accepts_digits_and_one_point_only(text):
    digits = text.removesuffix("s")
    is_time = text.endswith("s") and digits.replace(".", "", 1).isdigit()
    if text.isdigit() or is_time:
        expected = float(digits) if is_time else int(text)
        assert (frame(text), type(frame(text))) == (expected, type(expected))
    else:
        with pytest.raises(ArgumentTypeError, match="must be a frame such as"):
            frame(text)


@pytest.mark.parametrize("digits", [11, 300, 400])
def test_time_above_the_limit_is_refused(digits):
    with pytest.raises(ArgumentTypeError, match="at most 1e\\+09 s"):
        frame("9" * digits + "s")


def test_avoid_and_reach_accept_ranges(tmp_path):
    assert values.obstacle("sphere:0,90,0,20") == ("sphere", (0.0, 90.0, 0.0, 20.0), None)
    assert values.obstacle("sphere:0,90,0,20@5-9") == ("sphere", (0.0, 90.0, 0.0, 20.0), (5, 9))
    assert values.obstacle("b.bvh@1s-2s") == ("b.bvh", (0.0,) * 4, (1.0, 2.0))
    assert values.obstacle("b.bvh@1,2,3@4-5") == ("b.bvh", (1.0, 2.0, 3.0, 0.0), (4, 5))
    assert values.obstacle("b@2.bvh@1,2,3") == ("b@2.bvh", (1.0, 2.0, 3.0, 0.0), None)
    (tmp_path / "m=1.glb").write_bytes(b"")
    for clip in ("", "#Rig: Walk, 2"):
        path = f"{tmp_path / 'm=1.glb'}{clip}"
        assert values.obstacle(path) == (path, (0.0,) * 4, None)
        assert values.obstacle(f"{path}@1,2,3") == (path, (1.0, 2.0, 3.0, 0.0), None)
    assert values.frame_or_frames("7") == (7, 7)
    place = (1.0, 2.0, 3.0)
    assert values.reach("5-9:Hand:1,2,3") == ((5, 9), "Hand", None, place, 0.03)
    assert values.reach("1.5s:a:b:1,2,3~0.1") == ((1.5, 1.5), "a:b", None, place, 0.1)
    assert values.reach("7:a:b:@c:d+1,2,3~0.1") == ((7, 7), "a:b", "c:d", place, 0.1)


def test_commands_accept_seconds_for_frames(succeed, folder):
    clip = folder / "a.bvh"
    succeed("export", clip, "-o", "a.bvh", "--frames", "1s-2.5s")
    assert read_bvh("a.bvh").n_frames == 46
    words = ("candidates", folder, "--frame")
    assert succeed(*words, "120") == succeed(*words, "4s")
    words = ("graft", folder, "--scenario", "graph", "--json", "-o")
    for length, n_frames in (("90", 90), ("3s", 91)):
        out = succeed(*words, f"{length}.bvh", "--length", length)[0]
        assert json.loads(out)["grafts"][0]["frames"] == n_frames
