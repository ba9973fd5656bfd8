"""Films: duration, timing, contents and failures."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import EndSite, Motion, Skeleton, write_bvh, write_video
from mograft.cli import main
from mograft.dancer import dance
from mograft.io.export_figure import PALETTE
from mograft.viewing.film_pictures import draw_pictures
from tests.browser import chromium
from tests.io.recorded_files import DATA, require
from tests.strategies import HOSTILE_NAMES

Image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
SIZE = (160, 120)


@pytest.fixture(scope="module")
def motion():
    return dance(seed=1, strides=1).motion[:40]


def program():
    found = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    return found.get_ffmpeg_exe()


def frames_of(path, size=SIZE):
    """Return the pictures of a film, decoded by another program."""
    if path.suffix == ".gif":
        with Image.open(path) as film:
            return np.array([np.array(_at(film, i).convert("RGB")) for i in range(film.n_frames)])
    words = [program(), "-loglevel", "error", "-i", str(path), "-f", "rawvideo"]
    words += ["-fps_mode", "passthrough", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(words, capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


def _at(film, index):
    film.seek(index)
    return film


def shares(picture):
    """Return the share of a picture in the colour of each joint group."""
    colours = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in PALETTE[:4]])
    far = np.abs(picture[None].astype(int) - colours[:, None, None]).max(axis=-1)
    return (far < 40).mean(axis=(1, 2))


@pytest.mark.parametrize("ending", ["gif", "mp4"])
@pytest.mark.parametrize("dark", [False, True])
def test_write_video_shows_moving_figure(motion, tmp_path, ending, dark):
    if ending == "mp4":
        program()
    path = tmp_path / f"m.{ending}"
    # The figure stays in place, and with it the camera: only the limbs move.
    places = np.tile(motion.positions[:1], (motion.n_frames, 1, 1))
    motion = replace(motion, positions=places, channel_values=None)
    for target in (path, path.with_stem("again")):
        assert write_video(motion, target, rate=15, size=SIZE, dark=dark) == 15
    assert path.read_bytes() == target.read_bytes()
    film = frames_of(path)
    assert len(film) == motion.resample(15).n_frames
    paper = np.median(film[0].reshape(-1, 3), axis=0)
    assert (paper.mean() < 100) == dark
    for picture in (film[0], film[-1]):
        # The video format stores colours at a quarter of the pixels.
        assert (shares(picture) > 0.0003).all()
        assert shares(picture).sum() < 0.3
    above = film[:, :100].astype(int)  # The clock is below.
    assert (np.abs(above[-1] - above[0]).max(axis=-1) > 60).mean() > 0.005


@settings(max_examples=30)
@given(st.integers(1, 30), st.floats(2, 50))
def test_write_video_gif_duration_is_exact_to_a_hundredth(tmp_path_factory, n_frames, rate):
    motion = dance(seed=1, strides=1).motion[:n_frames]
    path = tmp_path_factory.mktemp("gif") / "m.gif"
    write_video(motion, path, rate=rate, size=(64, 64))
    count = motion.resample(rate).n_frames
    with Image.open(path) as film:
        # Pillow merges equal pictures into one of a longer duration.
        assert film.n_frames <= count
        shown = [_at(film, i).info["duration"] for i in range(film.n_frames)]
    assert abs(sum(shown) - 1000 * count / rate) <= 5.001


def test_write_video_default_rate_divides_motion_rate(motion, tmp_path):
    program()
    fast = replace(motion, frame_time=1 / 120)[:8]
    for own, name, rate in (
        (motion, "a.gif", 15),
        (fast, "b.gif", 20),
        (motion[:2], "a.mp4", 30),
        (fast, "b.mp4", 60),
    ):
        assert write_video(own, tmp_path / name, size=SIZE) == rate
    assert len(frames_of(tmp_path / "b.mp4")) == 5


def test_write_video_short_motion_keeps_last_frame(motion, tmp_path):
    write_video([motion, motion[:10]], tmp_path / "m.gif", rate=30, size=(320, 120))
    film = frames_of(tmp_path / "m.gif").astype(int)
    left, right = film[:, :, :158], film[:, :100, 162:]  # The clock is below.
    for half in (left[0], right[0]):
        assert (shares(half) > 0.0005).all()
    assert (np.abs(right[12] - right[-1]).max() <= 2).all()
    assert np.abs(left[12] - left[-1]).max() > 60


@settings(max_examples=10, deadline=None)
@given(st.integers(1, 12), st.integers(1, 12), st.integers(1, 12))
def test_draw_pictures_block_length_gives_same_pictures(motion, block, first, second):
    motions = [motion[:first], motion[10 : 10 + second]]
    films = []
    for length in (256, block):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("mograft.viewing.film_pictures._FRAMES_PER_BLOCK", length)
            pictures = draw_pictures(motions, 30.0, SIZE, None, dark=False)
            films.append([picture.tobytes() for picture in pictures])
    assert len(films[0]) == max(first, second)
    assert films[0] == films[1]


@pytest.mark.parametrize("name", [*HOSTILE_NAMES, "엉덩이", "x" * 500])
def test_write_video_hostile_names_succeed(tmp_path, name):
    lone = Skeleton([name], [-1], [[0, 0, 0]], end_sites=(EndSite(0, [0, 0, 0]),))
    motion = Motion(lone, 0.1, [[[0, 0, 0, 1]]] * 2, [[[0, 0, 0]]] * 2, name=name)
    write_video([motion] * 70, tmp_path / "m.gif", size=(64, 64))  # more than pixels
    assert frames_of(tmp_path / "m.gif")[0].shape == (64, 64, 3)


def test_draw_pictures_single_joint_draws_the_floor():
    lone = Skeleton(["a"], [-1], [[0, 0, 0]])
    motion = Motion(lone, 0.1, [[[0, 0, 0, 1]]] * 2, [[[0, 0, 0]]] * 2)
    first, second = draw_pictures([motion], 10.0, SIZE, None, dark=False)
    assert len(np.unique(np.array(first))) > 1
    assert first.size == second.size == SIZE


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (161, 120)}, "`size` must be even numbers from 64 to 4096, got 161x120"),
        ({"size": (62, 120)}, "`size` must be even numbers"),
        ({"rate": 0}, r"`rate` must be above 0 and at most 50 for \.gif, got 0"),
        ({"rate": 51}, "`rate` must be above 0 and at most 50"),
        ({"rate": np.nan}, "`rate` must be above 0"),
        ({"groups": "wings"}, "`preset` must be one of"),
        ({"renderer": "lines"}, "`renderer` must be 'capsules' or 'browser', got 'lines'"),
        ({"character": "a.glb"}, "`renderer` must be 'browser' for a character, got 'capsules'"),
        ({"motions": []}, "`motions` must contain at least one"),
        ({"path": "m.avi"}, r"`path` must end in \.mp4 or \.gif, got m\.avi"),
    ],
)
def test_write_video_invalid_arguments_raise_value_error(
    motion, tmp_path, monkeypatch, options, message
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=message):
        write_video(**{"motions": motion, "path": "m.gif"} | options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no sessions")
def test_write_video_failing_ffmpeg_raises_os_error_with_message(motion, tmp_path, monkeypatch):
    """The process is of another session than ours: Ctrl-C does not reach it."""
    program = tmp_path / "ffmpeg"
    text = "import os, sys; sys.exit(f'leads its session: {os.getsid(0) == os.getpid()}')"
    program.write_text(f"#!{sys.executable}\n{text}\n")
    program.chmod(0o755)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OSError, match="could not write the film: leads its session: True"):
        write_video(motion, tmp_path / "new.mp4", size=(64, 64))
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


def test_export_command_writes_films_and_names_missing_extra(
    motion, tmp_path, succeed, fail, monkeypatch
):
    write_bvh(motion, tmp_path / "a.bvh")
    words = ["export", tmp_path / "a.bvh", tmp_path / "a.bvh", "--size", "160x120", "-o"]
    options = ["--rate", "10", "--frames", "10-29", "--dark"]
    _, told = succeed(*words, tmp_path / "x.gif", *options)
    assert "160 by 120 pixels, 10 pictures per second" in told
    assert len(frames_of(tmp_path / "x.gif")) == motion[10:30].resample(10).n_frames
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setenv("PATH", "")
    told = fail(1, *words, tmp_path / "x.mp4")
    assert "films need imageio-ffmpeg: pip install 'mograft[video]'" in told
    monkeypatch.setitem(sys.modules, "PIL", None)
    told = fail(1, *words, tmp_path / "y.gif")
    assert "films need Pillow: pip install 'mograft[video]'" in told
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    told = fail(1, *words, tmp_path / "z.gif", "--renderer", "browser")
    assert "playwright: pip install 'mograft[browser]'" in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bvh", "x.gif"]


def film_of_browser(folder, name, *words):
    """Return the pictures of a film, made in a process of its own: playwright runs once in each."""
    given = [*words, "-o", f"{name}.gif", "--renderer", "browser", "--size", "160x120"]
    command = [sys.executable, "-m", "mograft", "export", *map(str, given), "--frames", "0-10"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return frames_of(folder / f"{name}.gif").astype(int)


@pytest.mark.browser
def test_film_of_browser_moves_and_is_the_same_twice(motion, tmp_path):
    with chromium():  # Skips without one.
        pass
    write_bvh(motion, tmp_path / "dancer.bvh")
    first, second = (film_of_browser(tmp_path, name, "dancer.bvh") for name in "ab")
    np.testing.assert_array_equal(first, second)
    assert np.abs(first[0] - first[-1]).max() > 60
    assert 0.01 < (np.ptp(first, axis=3) > 40).mean() < 0.5  # colours of the joint groups


@pytest.mark.browser
@pytest.mark.thorough
def test_film_of_browser_shows_the_mesh_of_the_character(tmp_path):
    knight = require(DATA / "glb" / "kaykit_Knight.glb")
    with chromium():
        pass
    assert main(["export", f"{knight}#Cheer", "-o", str(tmp_path / "cheer.bvh")]) == 0
    mesh = film_of_browser(tmp_path, "mesh", f"{knight}#Cheer")
    given = film_of_browser(tmp_path, "given", "cheer.bvh", "--character", knight)
    capsules = film_of_browser(tmp_path, "capsules", "cheer.bvh")
    difference = [np.abs(own - mesh).mean() for own in (given, capsules)]
    assert difference[0] < 0.1 * difference[1]
