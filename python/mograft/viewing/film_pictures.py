"""The pictures of a film: moving figures, drawn with Pillow."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.gaussian import gaussian_filter
from mograft.body.anatomy import anatomy
from mograft.body.groups import JointGroups
from mograft.io.palette import PALETTE
from mograft.motion.motion import Motion
from mograft.viewing.geometry import DrawnSkeleton
from mograft.viewing.scene import Scene

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont, ImageFont

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
_BONE_RADIUS = 0.011
_FLOOR_SPACING = 0.5
_FLOOR_EXTENT = 2.0

_MAX_NAME_LENGTH = 60


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
    width, height = (_SUPERSAMPLING * side for side in size)
    edges = np.linspace(0, width, len(motions) + 1).round().astype(int).tolist()
    panels = [
        _Panel(motion, (right - left, height), groups, colours)
        for motion, left, right in zip(motions, edges, edges[1:], strict=False)
    ]
    font = ImageFont.load_default(max(height // 30, 20))
    margin = height // 40
    for frame in range(max(motion.n_frames for motion in motions)):
        picture = Image.new("RGB", (width, height), colours["paper"])
        for panel, left in zip(panels, edges, strict=False):
            picture.paste(panel.draw(frame, font), (left, 0))
        pencil = ImageDraw.Draw(picture)
        for left in edges[1:-1]:
            pencil.line([(left, 0), (left, height)], fill=colours["line"], width=_SUPERSAMPLING)
        corner = (width - margin, height - margin)
        pencil.text(corner, f"{frame / rate:.1f} s", colours["clock"], font, anchor="rs")
        yield picture.reduce(_SUPERSAMPLING)


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
        self.size, self.colours = size, colours
        self.name = "".join(c for c in figure.name if c.isprintable())[:_MAX_NAME_LENGTH]
        self.parents, self.widths = drawn.parents, drawn.widths
        self.positions = (drawn.positions - [0, drawn.floor, 0]) / drawn.height
        group = figure.group_of_nodes(drawn.parents)
        # A bone has the colour of the joint that moves it.
        self.bone_colours = [PALETTE[group[max(p, 0)] % len(PALETTE)] for p in drawn.parents]
        path = self.positions[:, drawn.root][:, [0, 2]]
        frames = _CAMERA_SMOOTHING_SECONDS * motion.rate
        self.focus = np.stack(
            [gaussian_filter(np.ascontiguousarray(c), frames) for c in path.T], axis=1
        )
        self.yaw = _camera_yaw(motion, self.positions[0])
        # The figure is smaller in a narrow panel, so that its sides are visible.
        self.zoom = min(size[1] * 0.7, size[0] * 0.85)

    def draw(self, frame: int, font: "FreeTypeFont | ImageFont") -> "Image":
        """Return the picture of a frame; after the end of the motion, that of the last frame."""
        from PIL import Image, ImageDraw

        frame = min(frame, len(self.positions) - 1)
        picture = Image.new("RGB", self.size, self.colours["paper"])
        pencil = ImageDraw.Draw(picture)
        focus = self.focus[frame]
        self._draw_floor(pencil, focus)
        nodes = self.positions[frame]
        shadow = self._project(nodes * [1, 0, 1], focus)
        projected = self._project(nodes, focus)
        bones = [(parent, node) for node, parent in enumerate(self.parents) if parent >= 0]
        for parent, node in bones:
            self._draw_bone(pencil, shadow, parent, node, self.colours["shadow"])
        for parent, node in sorted(bones, key=lambda bone: -projected[list(bone), 2].sum()):
            self._draw_bone(pencil, projected, parent, node, self.bone_colours[node])
        margin = self.size[1] // 40
        pencil.text((margin, margin), self.name, self.colours["text"], font, anchor="la")
        return picture

    def _draw_bone(
        self, pencil: "ImageDraw", projected: FloatArray, parent: int, node: int, colour: str
    ) -> None:
        scale = self.zoom / projected[[parent, node], 2].mean()
        radius = max(
            _BONE_RADIUS * self.widths[node] * scale * _CAMERA_DISTANCE, 0.7 * _SUPERSAMPLING
        )
        ends = [tuple(projected[end, :2].tolist()) for end in (parent, node)]
        pencil.line(ends, fill=colour, width=max(round(2 * radius), 1))
        for x, y in ends:
            pencil.ellipse([x - radius, y - radius, x + radius, y + radius], fill=colour)

    def _draw_floor(self, pencil: "ImageDraw", focus: FloatArray) -> None:
        """Draw the part of a grid on the floor that is near the point `focus`, given as (x, z)."""
        spacing, extent = _FLOOR_SPACING, _FLOOR_EXTENT
        for axis in (0, 1):
            middle = np.round(focus[axis] / spacing) * spacing
            for offset in np.arange(middle - extent, middle + extent + 1e-6, spacing):
                ends = np.zeros((2, 3))
                ends[:, 2 * axis] = offset
                ends[:, 2 - 2 * axis] = focus[1 - axis] + np.array([-extent, extent])
                line = self._project(ends, focus)[:, :2]
                pencil.line([tuple(p) for p in line.tolist()], self.colours["line"], _SUPERSAMPLING)

    def _project(self, positions: FloatArray, focus: FloatArray) -> FloatArray:
        """Return the perspective projections of n positions, shape (n, 3).

        The columns hold x and y in pixels and the distance from the camera in body heights. The
        camera is directed at the point `focus` of the floor, given as (x, z).
        """
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        x, z = (positions[:, axis] - at for axis, at in zip((0, 2), focus, strict=True))
        across, deep = cos * x - sin * z, sin * x + cos * z
        tilt = np.radians(_CAMERA_TILT_DEGREES)
        up = positions[:, 1] - 0.5
        distance = _CAMERA_DISTANCE - (np.cos(tilt) * deep + np.sin(tilt) * up)
        high = np.cos(tilt) * up - np.sin(tilt) * deep
        scale = self.zoom * _CAMERA_DISTANCE / distance
        picture_x = 0.5 * self.size[0] + scale * across
        picture_y = 0.52 * self.size[1] - scale * high
        return np.stack([picture_x, picture_y, distance], axis=1)


def _camera_yaw(motion: Motion, positions: FloatArray) -> float:
    """Return the yaw in radians of a camera that is 30 degrees to the side of the figure's front.

    `positions` are those of the nodes in the first frame, shape (n_nodes, 3).
    """
    thighs = [anatomy(motion.skeleton).joints("thigh", side=side) for side in ("left", "right")]
    if not all(thighs):
        return 0.0
    # With y up and the figure facing +z, its left side is at +x.
    x, _, z = positions[thighs[0][0]] - positions[thighs[1][0]]
    return float(np.arctan2(z, x) + np.radians(_CAMERA_YAW_DEGREES))
