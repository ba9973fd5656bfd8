"""The pictures of a film: moving figures, drawn with Pillow."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mograft._util.arrays import FloatArray
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
    for frame in range(max(motion.n_frames for motion in motions)):
        joined = Image.new("RGB", size, None)  # the panels cover it
        pencil = ImageDraw.Draw(joined)
        for panel, left in zip(panels, edges, strict=False):
            joined.paste(panel.draw(frame), (left, 0))
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
        from PIL import Image, ImageDraw, ImageFont

        drawn = DrawnSkeleton.of(motion)
        figure = Scene.of([motion], groups).figures[0]
        self.size = (_SUPERSAMPLING * size[0], _SUPERSAMPLING * size[1])
        self.colours = colours
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
        name = "".join(c for c in figure.name if c.isprintable())[:_MAX_NAME_LENGTH]
        margin, font = self.size[1] // 40, ImageFont.load_default(max(self.size[1] // 30, 20))
        self.background = Image.new("RGB", self.size, colours["paper"])
        text = ImageDraw.Draw(self.background)
        text.text((margin, margin), name, colours["text"], font, anchor="la")

    def draw(self, frame: int) -> "Image":
        """Return the picture of a frame; after the end of the motion, that of the last frame."""
        from PIL import ImageDraw

        frame = min(frame, len(self.positions) - 1)
        nodes, focus = self.positions[frame], self.focus[frame]
        projected = self._project(nodes, focus)
        picture = self.background.copy()
        pencil = ImageDraw.Draw(picture)
        for line in self._floor_lines(focus).tolist():
            pencil.line(line, self.colours["line"], _SUPERSAMPLING)
        for polygon in self._bone_polygons(self._project(nodes * [1, 0, 1], focus)):
            pencil.polygon(polygon, self.colours["shadow"])
        polygons = self._bone_polygons(projected)
        # From far to near.
        for bone in projected[self.bones, 2].sum(axis=1).argsort(kind="stable").tolist():
            pencil.polygon(polygons[bone], self.bone_colours[bone])
        return picture.reduce(_SUPERSAMPLING)

    def _bone_polygons(self, projected: FloatArray) -> list[list[float]]:
        """Return the outlines of the bones, each as x, y, x, y... in pixels.

        An outline is a half circle about each end. `projected` is a result of `_project`.
        """
        ends = projected[self.bones]
        scales = self.zoom * ends[..., 2].mean(axis=1)
        radii = np.maximum(self.radii * scales, 0.7 * _SUPERSAMPLING)
        across, down = (ends[:, 1, :2] - ends[:, 0, :2]).T
        around = np.linspace(0.5, 1.5, _CORNERS_PER_END) * np.pi
        angles = np.arctan2(down, across)[:, None] + np.append(around, around + np.pi)
        corners = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        outlines = np.repeat(ends[..., :2], _CORNERS_PER_END, axis=1) + corners
        return outlines.reshape(len(ends), 4 * _CORNERS_PER_END).tolist()

    def _floor_lines(self, focus: FloatArray) -> FloatArray:
        """Return the ends of the lines of a floor grid, x, y, x, y in pixels, shape (n_lines, 4).

        The grid covers the floor near the point `focus`, given as (x, z).
        """
        offsets = np.arange(-_FLOOR_EXTENT, _FLOOR_EXTENT + 1e-6, _FLOOR_SPACING)
        ends = np.zeros((2, len(offsets), 2, 3))
        for axis in (0, 1):
            middle = np.round(focus[axis] / _FLOOR_SPACING) * _FLOOR_SPACING
            ends[axis, ..., 2 * axis] = (middle + offsets)[:, None]
            ends[axis, ..., 2 - 2 * axis] = focus[1 - axis] + [-_FLOOR_EXTENT, _FLOOR_EXTENT]
        return self._project(ends.reshape(-1, 3), focus)[:, :2].reshape(-1, 4)

    def _project(self, positions: FloatArray, focus: FloatArray) -> FloatArray:
        """Return the perspective projections of positions, shape (n, 3).

        The columns hold x and y in pixels and the share of full size. The camera is directed at a
        point above the floor: `focus`, given as (x, z).
        """
        offsets, tilt = positions - np.insert(focus, 1, 0.5), np.radians(_CAMERA_TILT_DEGREES)
        across, high, size = project(offsets, self.yaw, tilt, _CAMERA_DISTANCE)
        picture_x = 0.5 * self.size[0] + self.zoom * across
        picture_y = 0.52 * self.size[1] - self.zoom * high
        return np.stack([picture_x, picture_y, size], axis=-1)
