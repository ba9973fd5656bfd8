"""The pictures of a film: moving figures, drawn with Pillow."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.gaussian import gaussian_filter_columns
from mograft.body.groups import JointGroups
from mograft.io.export_figure import PALETTE
from mograft.motion.motion import Motion
from mograft.viewing.geometry import DrawnSkeleton, front_yaw, project
from mograft.viewing.scene import Scene

if TYPE_CHECKING:
    from PIL.Image import Image

_SUPERSAMPLING = 2
"""Pictures are drawn larger by this factor and reduced, which makes lines smooth."""

_COLOURS = {
    "paper": ("#fbfbfa", "#16181b"),
    "line": ("#dfe0dc", "#2c3036"),
    "shadow": ("#d3d4d0", "#0c0d0f"),
    "text": ("#1d1f23", "#e9eaec"),
    "clock": ("#65696f", "#a0a5ad"),
}
"""Colours on a light and on a dark background."""

# Lengths in body heights, angles in degrees.
_CAMERA_DISTANCE = 5.0
_CAMERA_TILT_DEGREES = 12.0
_CAMERA_YAW_DEGREES = 30.0
_CAMERA_SMOOTHING_SECONDS = 0.5
_FLOOR_SPACING = 0.5
_FLOOR_EXTENT = 2.0

_MAX_NAME_LENGTH = 60
_FRAMES_PER_BLOCK = 256  # frames whose shapes are computed together
_CORNERS_PER_END = 9  # of the polygon of a bone, whose ends are round


def draw_pictures(
    motions: Sequence[Motion],
    rate: float,
    size: tuple[int, int],
    groups: JointGroups | str | None,
    *,
    dark: bool,
) -> "Iterator[Image]":
    """Yield one picture per frame, which shows all motions side by side.

    A motion that has ended keeps its last frame. All motions have `rate` frames per second. `size`
    is width and height in pixels. `groups` set the colours of the bones. `dark` selects light
    colours on a dark background.
    """
    from PIL import Image, ImageDraw, ImageFont

    colours = {name: pair[int(dark)] for name, pair in _COLOURS.items()}
    width, height = size
    edges = np.linspace(0, width, len(motions) + 1).round().astype(int).tolist()
    panels = [
        _Panel(motion, (max(right - left, 1), height), groups, colours)
        for motion, (left, right) in zip(motions, pairwise(edges), strict=True)
    ]
    font = ImageFont.load_default(max(height // 30, 10))
    corner = (width - height // 40, height - height // 40)
    n_frames = max(motion.n_frames for motion in motions)
    for start in range(0, n_frames, _FRAMES_PER_BLOCK):
        frames = np.arange(start, min(start + _FRAMES_PER_BLOCK, n_frames))
        for frame, *pictures in zip(frames, *(own.draw(frames) for own in panels), strict=True):
            joined = Image.new("RGB", size, None)  # the panels cover it
            pencil = ImageDraw.Draw(joined)
            for picture, left in zip(pictures, edges, strict=False):
                joined.paste(picture, (left, 0))
            for left in edges[1:-1]:
                pencil.line([(left, 0), (left, height)], colours["line"])
            pencil.text(corner, f"{frame / rate:.1f} s", colours["clock"], font, anchor="rs")
            yield joined


class _Panel:
    """The area of each picture that shows one motion, seen by a camera that follows the figure."""

    def __init__(
        self,
        motion: Motion,
        size: tuple[int, int],
        groups: JointGroups | str | None,
        colours: dict[str, str],
    ) -> None:
        drawn = DrawnSkeleton.of(motion)
        figure = Scene.of([motion], groups).figures[0]
        self.size = (_SUPERSAMPLING * size[0], _SUPERSAMPLING * size[1])
        self.colours = colours
        self.name = "".join(c for c in figure.name if c.isprintable())[:_MAX_NAME_LENGTH]
        bones = [(parent, node) for node, parent in enumerate(drawn.parents) if parent >= 0]
        self.bones = np.array(bones, np.int64).reshape(-1, 2)
        self.radii = np.array([own.radius / drawn.height for own in drawn.bones[: len(bones)]])
        self.positions = (drawn.positions - [0, drawn.floor, 0]) / drawn.height
        group = figure.group_of_nodes(drawn.parents)
        # A bone has the colour of the joint that moves it.
        self.bone_colours = [PALETTE[group[p] % len(PALETTE)] for p in self.bones[:, 0]]
        path = self.positions[:, drawn.root][:, [0, 2]]
        self.focus = gaussian_filter_columns(path, _CAMERA_SMOOTHING_SECONDS * motion.rate)
        front = front_yaw(motion.skeleton, self.positions[0])
        self.yaw = front + np.radians(_CAMERA_YAW_DEGREES)
        # The figure is smaller in a narrow panel, so that its sides are visible.
        self.zoom = min(self.size[1] * 0.7, self.size[0] * 0.85)

    def draw(self, frames: IntArray) -> "Iterator[Image]":
        """Yield the picture of each frame; after the end of the motion, that of the last frame."""
        from PIL import Image, ImageDraw, ImageFont

        background = Image.new("RGB", self.size, self.colours["paper"])
        font = ImageFont.load_default(max(self.size[1] // 30, 20))
        margin = self.size[1] // 40
        text = ImageDraw.Draw(background)
        text.text((margin, margin), self.name, self.colours["text"], font, anchor="la")
        shown = np.minimum(frames, len(self.positions) - 1)
        lines, shadows, bones, order = self._shapes(np.unique(shown))
        picture = background.copy()
        pencil = ImageDraw.Draw(picture)
        outlines = len(self.bones), 4 * _CORNERS_PER_END
        for index in (shown - shown[0]).tolist():
            picture.paste(background)
            for line in lines[index].reshape(-1, 4).tolist():
                pencil.line(line, self.colours["line"], _SUPERSAMPLING)
            for polygon in shadows[index].reshape(outlines).tolist():
                pencil.polygon(polygon, self.colours["shadow"])
            polygons = bones[index].reshape(outlines).tolist()
            for bone in order[index].tolist():
                pencil.polygon(polygons[bone], self.bone_colours[bone])
            yield picture.reduce(_SUPERSAMPLING)

    def _shapes(self, frames: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Return the shapes of each frame, whose points are (x, y) in supersampled pixels.

        These are the lines of the floor, (n_frames, n_lines, 2, 2), the polygons of the shadows and
        of the bones, both (n_frames, n_bones, n_corners, 2), and the order of the bones from far to
        near, (n_frames, n_bones).
        """
        nodes, focus = self.positions[frames], self.focus[frames]
        projected = self._project(nodes, focus)
        shadow = self._project(nodes * [1, 0, 1], focus)
        return (
            self._floor_lines(focus),
            self._bone_polygons(shadow),
            self._bone_polygons(projected),
            np.argsort(projected[:, self.bones, 2].sum(axis=2), axis=1, kind="stable"),
        )

    def _bone_polygons(self, projected: FloatArray) -> FloatArray:
        """Return the outlines of the bones, shape (n_frames, n_bones, n_corners, 2).

        An outline is a half circle about each end. `projected` is a result of `_project`.
        """
        ends = projected[:, self.bones]
        scales = self.zoom * ends[..., 2].mean(axis=2)
        radii = np.maximum(self.radii * scales, 0.7 * _SUPERSAMPLING)
        across, down = np.moveaxis(ends[:, :, 1, :2] - ends[:, :, 0, :2], -1, 0)
        around = np.linspace(0.5, 1.5, _CORNERS_PER_END) * np.pi
        angles = np.arctan2(down, across)[..., None] + np.append(around, around + np.pi)
        corners = radii[..., None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return np.repeat(ends[..., :2], _CORNERS_PER_END, axis=2) + corners

    def _floor_lines(self, focus: FloatArray) -> FloatArray:
        """Return the ends of the lines of a floor grid, shape (n_frames, n_lines, 2, 2).

        The ends are projected, as (x, y) in pixels. The grid covers the floor near the points
        `focus`, shape (n_frames, 2), given as (x, z).
        """
        offsets = np.arange(-_FLOOR_EXTENT, _FLOOR_EXTENT + 1e-6, _FLOOR_SPACING)
        ends = np.zeros((len(focus), 2, len(offsets), 2, 3))
        for axis in (0, 1):
            middle = np.round(focus[:, axis] / _FLOOR_SPACING) * _FLOOR_SPACING
            ends[:, axis, ..., 2 * axis] = (middle[:, None] + offsets)[..., None]
            reach = focus[:, 1 - axis, None] + [-_FLOOR_EXTENT, _FLOOR_EXTENT]
            ends[:, axis, ..., 2 - 2 * axis] = reach[:, None]
        lines = self._project(ends.reshape(len(focus), -1, 3), focus)[..., :2]
        return lines.reshape(len(focus), -1, 2, 2)

    def _project(self, positions: FloatArray, focus: FloatArray) -> FloatArray:
        """Return the perspective projections of positions, shape (n_frames, n, 3).

        The columns hold x and y in pixels and the share of full size. In each frame the camera is
        directed at a point above the floor: `focus`, shape (n_frames, 2), given as (x, z).
        """
        offsets = positions - np.insert(focus, 1, 0.5, axis=1)[:, None]
        tilt = np.radians(_CAMERA_TILT_DEGREES)
        across, high, size = project(offsets, self.yaw, tilt, _CAMERA_DISTANCE)
        picture_x = 0.5 * self.size[0] + self.zoom * across
        picture_y = 0.52 * self.size[1] - self.zoom * high
        return np.stack([picture_x, picture_y, size], axis=-1)
