"""Films of motions: MP4 and GIF."""

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.atomic import atomic_path
from mograft.analysis.segmentation import gaussian
from mograft.body.anatomy import anatomy
from mograft.body.groups import JointGroups
from mograft.io.figure import PALETTE
from mograft.motion.motion import Motion
from mograft.viewing.scene import Drawn, Scene

if TYPE_CHECKING:
    from PIL.Image import Image as Picture
    from PIL.ImageDraw import ImageDraw as Pencil
    from PIL.ImageFont import FreeTypeFont, ImageFont

__all__ = ["ENDINGS", "write_video"]

ENDINGS = (".mp4", ".gif")
_FASTEST = {".mp4": 60.0, ".gif": 20.0}
_FINE = 2
"""Pictures are drawn so many times larger and made smaller: lines get smooth."""
_PALE = {
    "paper": "#fbfbfa",
    "line": "#dfe0dc",
    "shade": "#d3d4d0",
    "text": "#1d1f23",
    "faint": "#65696f",
}
_DARK = {
    "paper": "#16181b",
    "line": "#2c3036",
    "shade": "#0c0d0f",
    "text": "#e9eaec",
    "faint": "#a0a5ad",
}


def write_video(
    motions: Motion | Sequence[Motion],
    path: str | os.PathLike[str],
    *,
    rate: float | None = None,
    size: tuple[int, int] = (720, 480),
    groups: JointGroups | str | None = None,
    dark: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> float:
    """Write motions as a film, side by side, in real time; needs the extra ``video``.

    Parameters
    ----------
    motions : Motion or sequence of Motion
        What to show. Shorter ones stand still at their end.
    path : str or path
        The file to write: ``.mp4`` (H.264) or ``.gif``, which plays again and again.
    rate : float, optional
        Pictures per second. Default: the first motion's rate, divided by the whole number
        that makes it at most 60, of a GIF 20.
    size : tuple of int
        Width and height in pixels, even numbers from 64 to 4096.
    groups : JointGroups or str, optional
        Joint groups to colour by, or the name of a preset. Default: trunk, arms and legs.
    dark : bool
        Whether to draw light on dark.
    progress : callable, optional
        Called with ``"film"``, how many pictures are drawn, and how many there will be.

    Returns
    -------
    float
        The pictures per second.

    Raises
    ------
    ModuleNotFoundError
        If Pillow, or for MP4 both imageio-ffmpeg and the program ffmpeg, are not installed.
    ValueError
        If there is no motion, the path ends otherwise, or a number is out of range.

    Notes
    -----
    Each figure is seen from a little beside of where it looks, by a camera that goes with it.
    GIF counts time in hundredths of a second: pictures are shown for times that differ by one
    of them, so that the whole keeps time.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> write_video(dance(strides=1).motion, "dance.mp4", rate=30)  # doctest: +SKIP
    30.0
    """
    several = [motions] if isinstance(motions, Motion) else list(motions)
    target = Path(path)
    ending = target.suffix.lower()
    if not several:
        raise ValueError("motions must hold at least one, got none")
    if ending not in ENDINGS:
        raise ValueError(f"path must end in {' or '.join(ENDINGS)}, got {target.name}")
    if any(not 64 <= side <= 4096 or side % 2 for side in size):
        raise ValueError(f"size must be even numbers from 64 to 4096, got {size[0]}x{size[1]}")
    if rate is None:
        rate = several[0].rate / np.ceil(several[0].rate / _FASTEST[ending] - 1e-6)
    if not 0 < rate <= (50 if ending == ".gif" else 240):
        most = 50 if ending == ".gif" else 240
        raise ValueError(f"rate must be above 0 and at most {most} for {ending}, got {rate:g}")
    try:
        import PIL  # noqa: F401 - whether it is there
    except ImportError as error:
        raise _absent("Pillow") from error
    program = _ffmpeg() if ending == ".mp4" else ""
    shown = [_resampled(motion, rate) for motion in several]
    pictures = _pictures(shown, rate, size, groups, _DARK if dark else _PALE)
    count = max(motion.n_frames for motion in shown)
    if progress is not None:
        pictures = _told(pictures, count, progress)
    with atomic_path(target) as draft:
        if ending == ".gif":
            _save_gif(pictures, draft, rate, count)
        else:
            _save_mp4(pictures, draft, rate, size, program)
    return float(rate)


def _told(
    pictures: Iterator["Picture"], count: int, progress: Callable[[str, int, int], None]
) -> Iterator["Picture"]:
    for done, picture in enumerate(pictures):
        progress("film", done, count)
        yield picture


def _absent(name: str) -> ModuleNotFoundError:
    return ModuleNotFoundError(f"films need {name}: pip install 'mograft[video]'", name=name)


def _ffmpeg() -> str:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        found = shutil.which("ffmpeg")
        if found is None:
            raise _absent("imageio-ffmpeg") from error
        return found
    program: str = imageio_ffmpeg.get_ffmpeg_exe()
    return program


def _resampled(motion: Motion, rate: float) -> Motion:
    return motion if abs(motion.rate - rate) < 1e-6 * rate else motion.resample(rate)


def _pictures(
    motions: Sequence[Motion],
    rate: float,
    size: tuple[int, int],
    groups: JointGroups | str | None,
    colours: dict[str, str],
) -> Iterator["Picture"]:
    """Draw frame after frame."""
    from PIL import Image, ImageDraw, ImageFont

    wide, high = (_FINE * side for side in size)
    bounds = np.linspace(0, wide, len(motions) + 1).round().astype(int)
    panels = [
        _Panel(motion, (int(right - left), high), groups, colours)
        for motion, left, right in zip(motions, bounds, bounds[1:], strict=False)
    ]
    font = ImageFont.load_default(max(high // 30, 20))
    for frame in range(max(motion.n_frames for motion in motions)):
        whole = Image.new("RGB", (wide, high), colours["paper"])
        for panel, left in zip(panels, bounds[:-1].tolist(), strict=True):
            whole.paste(panel.drawn(frame, font), (left, 0))
        pencil = ImageDraw.Draw(whole)
        for left in bounds[1:-1].tolist():
            pencil.line([(left, 0), (left, high)], fill=colours["line"], width=_FINE)
        now = f"{frame / rate:.1f} s"
        pencil.text(
            (wide - high // 40, high - high // 40), now, colours["faint"], font, anchor="rs"
        )
        yield whole.reduce(_FINE)


class _Panel:
    """One figure as a camera sees it that goes with it."""

    def __init__(
        self,
        motion: Motion,
        size: tuple[int, int],
        groups: JointGroups | str | None,
        colours: dict[str, str],
    ) -> None:
        drawn = Drawn.of(motion)
        figure = Scene.of([motion], groups).figures[0]
        self.size, self.colours = size, colours
        self.name = "".join(letter for letter in figure.name if letter.isprintable())[:60]
        self.parents, self.widths = drawn.parents, drawn.widths
        self.places = (drawn.places - [0, drawn.floor, 0]) / drawn.height
        self.group = _group_of(figure.members, drawn.parents, motion.n_joints)
        level = self.places[:, drawn.root][:, [0, 2]]
        steps = 0.5 * motion.rate
        self.focus = np.stack([gaussian(np.ascontiguousarray(c), steps) for c in level.T], axis=1)
        self.turn = _turn(motion, self.places[0])
        # A narrow panel shows what a wide one does, smaller.
        self.zoom = min(size[1] * 0.7, size[0] * 0.85)

    def drawn(self, frame: int, font: "FreeTypeFont | ImageFont") -> "Picture":
        """Return the picture of a frame, of the last one after it."""
        from PIL import Image, ImageDraw

        frame = min(frame, len(self.places) - 1)
        picture = Image.new("RGB", self.size, self.colours["paper"])
        pencil = ImageDraw.Draw(picture)
        focus = self.focus[frame]
        self._draw_floor(pencil, focus)
        nodes = self.places[frame]
        below = self._seen(nodes * [1, 0, 1], focus)
        seen = self._seen(nodes, focus)
        ends = [(parent, node) for node, parent in enumerate(self.parents) if parent >= 0]
        for parent, node in ends:
            self._bone(pencil, below, parent, node, self.colours["shade"])
        for parent, node in sorted(ends, key=lambda own: -(seen[own[0], 2] + seen[own[1], 2])):
            self._bone(pencil, seen, parent, node, PALETTE[self.group[node] % len(PALETTE)])
        edge = self.size[1] // 40
        pencil.text((edge, edge), self.name, self.colours["text"], font, anchor="la")
        return picture

    def _bone(
        self,
        pencil: "Pencil",
        seen: FloatArray,
        parent: int,
        node: int,
        colour: str,
    ) -> None:
        near = self.zoom / seen[[parent, node], 2].mean()
        half = max(0.011 * self.widths[node] * near * _CAMERA, 0.7 * _FINE)
        ends = [tuple(seen[end, :2].tolist()) for end in (parent, node)]
        pencil.line(ends, fill=colour, width=max(round(2 * half), 1))
        for x, y in ends:
            pencil.ellipse([x - half, y - half, x + half, y + half], fill=colour)

    def _draw_floor(self, pencil: "Pencil", focus: FloatArray) -> None:
        """Draw lines that stay in their places while the figure passes over them."""
        apart, reach = 0.5, 2.0
        for axis in (0, 1):
            middle = np.round(focus[axis] / apart) * apart
            for at in np.arange(middle - reach, middle + reach + 1e-6, apart):
                ends = np.zeros((2, 3))
                ends[:, 2 * axis] = at
                ends[:, 2 - 2 * axis] = focus[1 - axis] + np.array([-reach, reach])
                x = self._seen(ends, focus)[:, :2]
                pencil.line([tuple(p) for p in x.tolist()], self.colours["line"], _FINE)

    def _seen(self, places: FloatArray, focus: FloatArray) -> FloatArray:
        """Return where places are in the picture, and how far from the camera."""
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        x, z = (places[:, axis] - at for axis, at in zip((0, 2), focus, strict=True))
        across, deep = cos * x - sin * z, sin * x + cos * z
        tilt = np.radians(12.0)
        up = places[:, 1] - 0.5
        far = _CAMERA - (np.cos(tilt) * deep + np.sin(tilt) * up)
        high = np.cos(tilt) * up - np.sin(tilt) * deep
        size = self.zoom * _CAMERA / far
        return np.stack(
            [0.5 * self.size[0] + size * across, 0.52 * self.size[1] - size * high, far], axis=1
        )


_CAMERA = 5.0
"""How far the camera stands, in heights."""


def _turn(motion: Motion, places: FloatArray) -> float:
    """Return the angle about up from which a figure is seen a little from its side."""
    thighs = [anatomy(motion.skeleton).joints("thigh", side=side) for side in ("left", "right")]
    if not all(thighs):
        return 0.0
    x, _, z = places[thighs[0][0]] - places[thighs[1][0]]
    # With y up and looking along z the left is at x: then the camera sees the front.
    return float(np.arctan2(z, x) + np.radians(30.0))


def _group_of(members: Mapping[str, IntArray], parents: list[int], n_joints: int) -> list[int]:
    """Return the group of each node's bone, which is that of the joint that moves it."""
    own = np.zeros(n_joints, int)
    for index, joints in enumerate(members.values()):
        own[joints] = index
    return [int(own[parent]) if parent >= 0 else 0 for parent in parents]


def _save_gif(pictures: Iterator["Picture"], path: Path, rate: float, count: int) -> None:
    from PIL import Image

    ticks = np.round(100 * np.arange(count + 1) / rate).astype(int)
    first = next(pictures)
    palette = first.quantize(64, Image.Quantize.MEDIANCUT)

    def plain(picture: "Picture") -> "Picture":
        return picture.quantize(palette=palette, dither=Image.Dither.NONE)

    with path.open("wb") as stream:
        plain(first).save(
            stream,
            format="GIF",
            save_all=True,
            append_images=(plain(picture) for picture in pictures),
            duration=(10 * np.diff(ticks)).tolist(),
            loop=0,
            optimize=False,
        )


def _save_mp4(
    pictures: Iterator["Picture"], path: Path, rate: float, size: tuple[int, int], program: str
) -> None:
    words = [program, "-loglevel", "error", "-nostdin", "-y"]
    words += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}"]
    words += ["-r", f"{rate:.6f}", "-i", "-", "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p"]
    # A number of threads of its own, and no date: the same motion gives the same bytes.
    words += ["-crf", "20", "-threads", "2", "-fflags", "+bitexact", "-flags:v", "+bitexact"]
    words += ["-movflags", "+faststart", "-f", "mp4", os.fspath(path)]
    with tempfile.TemporaryFile() as told:
        process = subprocess.Popen(words, stdin=subprocess.PIPE, stderr=told)
        assert process.stdin is not None  # It was asked for.
        try:
            with contextlib.suppress(BrokenPipeError):  # It tells below what went wrong.
                for picture in pictures:
                    process.stdin.write(picture.tobytes())
            process.communicate()
        finally:
            if process.poll() is None:
                process.kill()
                process.communicate()
        if process.returncode:
            told.seek(0)
            said = told.read().decode("utf-8", "replace").strip().splitlines()
            why = said[-1] if said else f"exit code {process.returncode}"
            raise OSError(f"ffmpeg could not write the film: {why}")
