"""Films of motions: MP4 and GIF."""

import contextlib
import io
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mograft._util.atomic import checked_path, write_bytes
from mograft._util.extras import import_extra
from mograft._util.signals import clean_up_by
from mograft.body.groups import JointGroups
from mograft.motion.motion import Motion
from mograft.viewing.browser_pictures import browser_pictures
from mograft.viewing.film_pictures import draw_pictures

if TYPE_CHECKING:
    from PIL.Image import Image

_MAX_DEFAULT_RATE = {".mp4": 60.0, ".gif": 20.0}
_MAX_RATE = {".mp4": 240, ".gif": 50}
RENDERERS = ("capsules", "browser")
_MIN_SIDE, _MAX_SIDE = 64, 4096
_GIF_COLOURS = 64


def write_video(
    motions: Motion | Sequence[Motion],
    path: str | os.PathLike[str],
    *,
    rate: float | None = None,
    size: tuple[int, int] = (720, 480),
    groups: JointGroups | str | None = None,
    dark: bool = False,
    renderer: str = "capsules",
    character: str | os.PathLike[str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> float:
    """Write a film that shows motions side by side in real time; needs the extra ``video``.

    Parameters
    ----------
    motions : Motion or sequence of Motion
        What to show. A motion that ends before the others keeps its last frame.
    path : str or path
        The file to write: ``.mp4`` (H.264) or ``.gif``, which repeats endlessly.
    rate : float, optional
        Pictures per second, at most 240 for MP4 and 50 for GIF. Default: the rate of the first
        motion, divided by the smallest integer that gives at most 60 for MP4 or 20 for GIF.
    size : tuple of int
        Width and height in pixels, even numbers from 64 to 4096.
    groups : JointGroups or str, optional
        Joint groups that set the colours, or the name of a preset. Default: trunk, arms and
        legs.
    dark : bool
        Whether to draw light colours on a dark background.
    renderer : {"capsules", "browser"}
        What draws the figures. "browser" shows them as a page does, with the mesh of the character,
        by a Chromium without a window; it needs the extra ``browser``.
    character : str or path, optional
        A glTF file with the mesh of the figures, for "browser". Default: the files of the motions.
    progress : callable, optional
        Called for each picture with ``"film"``, its index from 0, and the number of pictures.

    Returns
    -------
    float
        The pictures per second.

    Raises
    ------
    ModuleNotFoundError
        If Pillow is not installed, for MP4 neither imageio-ffmpeg nor ffmpeg, or for "browser" not
        playwright.
    OSError
        If ffmpeg fails; the message contains the last line that ffmpeg printed. If Chromium fails.
    ValueError
        If there is no motion, the ending of the path or the renderer is unknown, a number is out of
        range, or "capsules" is given a character.

    Notes
    -----
    A camera follows each figure, and looks at it from 30 degrees to the side of its front. GIF
    stores the duration of each picture in hundredths of a second. The durations of the pictures
    differ by at most one hundredth, so that the total duration is correct.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> write_video(dance(strides=1).motion, "dance.mp4", rate=30)  # doctest: +SKIP
    30.0
    """
    motions = [motions] if isinstance(motions, Motion) else list(motions)
    target = Path(path)
    ending = target.suffix.lower()
    if not motions:
        raise ValueError("`motions` must contain at least one motion, got none")
    if ending not in _MAX_RATE:
        raise ValueError(f"`path` must end in {' or '.join(_MAX_RATE)}, got {target.name}")
    if any(not _MIN_SIDE <= side <= _MAX_SIDE or side % 2 for side in size):
        expected = f"even numbers from {_MIN_SIDE} to {_MAX_SIDE}"
        raise ValueError(f"`size` must be {expected}, got {size[0]}x{size[1]}")
    if rate is None:
        rate = motions[0].rate / np.ceil(motions[0].rate / _MAX_DEFAULT_RATE[ending] - 1e-6)
    if not 0 < rate <= _MAX_RATE[ending]:
        limit = f"above 0 and at most {_MAX_RATE[ending]} for {ending}"
        raise ValueError(f"`rate` must be {limit}, got {rate:g}")
    if renderer not in RENDERERS or (character is not None and renderer != "browser"):
        expected = "'browser' for a character" if character else " or ".join(map(repr, RENDERERS))
        raise ValueError(f"`renderer` must be {expected}, got {renderer!r}")
    import_extra("PIL", "films need Pillow", "video")
    program = _find_ffmpeg() if ending == ".mp4" else ""
    resampled = [
        motion if abs(motion.rate - rate) < 1e-6 * rate else motion.resample(rate)
        for motion in motions
    ]
    if renderer == "browser":
        path_of_mesh = None if character is None else Path(character)
        pictures = browser_pictures(resampled, size, groups, path_of_mesh, dark=dark)
    else:
        pictures = draw_pictures(resampled, rate, size, groups, dark=dark)
    count = max(motion.n_frames for motion in resampled)
    if progress is not None:
        pictures = _report(pictures, count, progress)
    if ending == ".gif":
        write_bytes(target, _gif(pictures, rate, count))
    else:
        with checked_path(target, partial(_is_whole_mp4, program)) as draft:
            _write_mp4(pictures, draft, rate, size, program)
    return float(rate)


def _report(
    pictures: "Iterator[Image]", count: int, progress: Callable[[str, int, int], None]
) -> "Iterator[Image]":
    for index, picture in enumerate(pictures):
        progress("film", index, count)
        yield picture


def _find_ffmpeg() -> str:
    found = shutil.which("ffmpeg")
    if found is not None and find_spec("imageio_ffmpeg") is None:
        return found
    package = import_extra("imageio_ffmpeg", "films need imageio-ffmpeg", "video")
    return package.get_ffmpeg_exe()


def _gif(pictures: "Iterator[Image]", rate: float, count: int) -> bytes:
    """Return a film as GIF: Pillow ignores short writes to a file."""
    from PIL import Image

    hundredths = np.round(100 * np.arange(count + 1) / rate).astype(int)
    first = next(pictures)
    palette = first.quantize(_GIF_COLOURS, Image.Quantize.MEDIANCUT)

    def reduce(picture: "Image.Image") -> "Image.Image":
        return picture.quantize(palette=palette, dither=Image.Dither.NONE)

    options: dict[str, Any] = {"format": "GIF", "save_all": True, "loop": 0, "optimize": False}
    options["duration"] = (10 * np.diff(hundredths)).tolist()
    film = io.BytesIO()
    reduce(first).save(film, append_images=map(reduce, pictures), **options)
    return film.getvalue()


def _write_mp4(
    pictures: "Iterator[Image]", path: Path, rate: float, size: tuple[int, int], program: str
) -> None:
    """Send pictures to ffmpeg; if ffmpeg fails, raise an OSError with its last line of output.

    `imageio_ffmpeg.write_frames` ignores ffmpeg's exit code: on a full disk it returns without
    an error and leaves a truncated film.
    """
    # Of flat drawings, "veryfast" makes smaller files than the default in half the time. With a
    # fixed number of threads and without a date, equal input gives equal bytes.
    options = (
        f"-loglevel error -nostdin -y -f rawvideo -pix_fmt rgb24 -s {size[0]}x{size[1]} "
        f"-r {rate:.6f} -i - -an -c:v libx264 -pix_fmt yuv420p -preset veryfast -crf 20 "
        "-threads 2 -fflags +bitexact -flags:v +bitexact -movflags +faststart -f mp4"
    )
    words = [program, *options.split(), os.fspath(path)]
    with tempfile.TemporaryFile() as errors:
        # In a session of its own, because Ctrl-C is ours: an ffmpeg that it ends would be an error.
        process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stderr=errors, start_new_session=True
        )
        assert process.stdin is not None  # PIPE was requested.
        with clean_up_by(lambda: _kill(process)):
            with contextlib.suppress(BrokenPipeError):  # The exit code is checked below.
                for picture in pictures:
                    process.stdin.write(picture.tobytes())
            process.communicate()
        if process.returncode:
            errors.seek(0)
            lines = errors.read().decode("utf-8", "replace").strip().splitlines()
            reason = lines[-1] if lines else f"exit code {process.returncode}"
            raise OSError(f"ffmpeg could not write the film: {reason}")


def _is_whole_mp4(program: str, path: Path) -> bool:
    """Return whether ffmpeg reads all packets of a film without an error."""
    words = [program, "-v", "error", "-nostdin", "-i", os.fspath(path)]
    words += ["-c", "copy", "-f", "null", "-"]
    found = subprocess.run(words, capture_output=True, check=False, start_new_session=True)
    return found.returncode == 0 and not found.stderr


def _kill(process: "subprocess.Popen[bytes]") -> None:
    """End a process that still runs."""
    if process.poll() is None:
        process.kill()
        process.communicate()
