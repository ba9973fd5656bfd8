"""The tracks of glTF animations, and their values at the times of frames."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.io.gltf.accessors import read_accessor, read_accessors, to_floats
from mograft.io.gltf.container import Container
from mograft.io.gltf.nodes import Transforms
from mograft.motion import rotations

PATH_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
"""The animated properties of a node, and the number of components of a value."""

_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")

DEFAULT_RATE = 30.0
"""Frames per second of animations whose keys give no rate."""

_RATE_BOUNDS = (12.0, 500.0)
"""Rates that keys may give; slower keys are poses between which a motion is interpolated."""

_GRID_TOLERANCE = 1e-3
"""Deviation of key times from a uniform grid, as a fraction of its step, that counts as none."""

_MAX_JOINT_FRAMES = 1 << 21
"""Frames times nodes of a motion, unless a track has as many keys. A file of few keys may claim a
duration whose frames exceed any memory."""


@dataclass(frozen=True, eq=False)
class Track:
    """Tracks of one property with the same key times and the same interpolation."""

    path: str  # key of `PATH_WIDTHS`
    nodes: IntArray  # shape (n_tracks,)
    interpolation: str
    times: FloatArray  # seconds, shape (n_keys,)
    values: FloatArray  # shape (n_tracks, n_keys or 3 * n_keys, width)


@dataclass(frozen=True, eq=False)
class Channels:
    """The channels of one animation that move some nodes, in groups with equal key times."""

    place: str  # of the animation in the document
    groups: dict[tuple[str, str, int], list[tuple[int, object]]]
    """Node and output accessor of each channel, by path, interpolation and input accessor."""
    times: dict[int, FloatArray]  # key times in seconds, shape (n_keys,), by input accessor


def animated_properties(container: Container, animation: int) -> set[tuple[int | None, str]]:
    """Return the pairs of node and property that an animation changes, without reading its keys.

    The node of a property that belongs to no node is None.
    """
    place = f"animations[{animation}].channels"
    found: set[tuple[int | None, str]] = set()
    for channel in _objects(container, container.items("animations")[animation], "channels", place):
        target = channel.get("target")
        if not isinstance(target, dict):
            container.fail(place, "expected a target in each channel")
        node, path = target.get("node"), target.get("path")
        if (type(node) is not int and node is not None) or type(path) is not str:
            container.fail(place, "expected a node and a path in each target")
        found.add((node, path))
    for node, _ in found:
        if node is not None:
            container.item("nodes", node, place)
    return found


def read_channels(container: Container, animation: int, nodes: frozenset[int]) -> Channels:
    """Read the channels of an animation that move some of `nodes`, and their key times.

    Raises `FormatError` if two channels change the same property of a node, or one is invalid.
    """
    item, own = container.items("animations")[animation], f"animations[{animation}]"
    channels = _objects(container, item, "channels", f"{own}.channels")
    samplers = _objects(container, item, "samplers", f"{own}.samplers")
    times: dict[int, FloatArray] = {}
    groups: dict[tuple[str, str, int], list[tuple[int, object]]] = {}
    seen: set[tuple[object, object]] = set()
    for number, channel in enumerate(channels):
        target = channel["target"]
        node, path = target.get("node"), target.get("path")
        if node not in nodes or path not in PATH_WIDTHS:
            continue
        if (node, path) in seen:
            place = f"{own}.channels[{number}]"
            container.fail(place, f"expected one track of the {path} of node {node}, got two")
        seen.add((node, path))
        index = channel.get("sampler")
        if type(index) is not int or not 0 <= index < len(samplers):
            place = f"{own}.channels[{number}].sampler"
            container.fail(place, f"expected an index of {len(samplers)} samplers, got {index!r}")
        sampler = samplers[index]
        key = sampler.get("input")
        if type(key) is not int or key not in times:
            times[key] = _read_times(container, key, f"{own}.samplers[{index}].input")
        interpolation = sampler.get("interpolation", "LINEAR")
        if interpolation not in _INTERPOLATIONS:
            place = f"{own}.samplers[{index}].interpolation"
            container.fail(place, f"expected an interpolation, got {interpolation!r}")
        groups.setdefault((path, interpolation, key), []).append((node, sampler.get("output")))
    return Channels(own, groups, times)


@dataclass(frozen=True, eq=False)
class Animation:
    """The tracks of one animation."""

    tracks: tuple[Track, ...]
    key_times: tuple[FloatArray, ...]  # seconds, shape (n_keys,); each is used by some tracks

    @property
    def start(self) -> float:
        """Time of the first key in seconds."""
        return min(float(times[0]) for times in self.key_times)

    @property
    def stop(self) -> float:
        """Time of the last key in seconds."""
        return max(float(times[-1]) for times in self.key_times)


def read_animation(container: Container, animation: int, nodes: frozenset[int]) -> Animation:
    """Read the tracks of an animation that move some of `nodes`; see `read_channels`."""
    channels = read_channels(container, animation, nodes)
    tracks = tuple(read_tracks(container, channels))
    return Animation(tracks, tuple(channels.times.values()))


def read_tracks(container: Container, channels: Channels) -> list[Track]:
    """Read the values of channels; rotations become unit quaternions, except those of splines."""
    tracks = []
    for (path, interpolation, key), members in channels.groups.items():
        times = channels.times[key]
        count = len(times) * (3 if interpolation == "CUBICSPLINE" else 1)
        nodes, outputs = zip(*members, strict=True)
        place = f"{channels.place}: the {path} tracks"
        values = read_accessors(container, outputs, place, (count, PATH_WIDTHS[path]))
        if not np.isfinite(values).all():
            container.fail(place, "expected finite numbers")
        if path == "rotation" and interpolation != "CUBICSPLINE":
            norms = np.sqrt(np.einsum("nki,nki->nk", values, values))
            if (norms < 1e-6).any():
                container.fail(place, "expected unit quaternions, got zero")
            values /= norms[..., None]
        tracks.append(Track(path, np.array(nodes), interpolation, times, values))
    return tracks


def _objects(container: Container, item: dict[str, Any], name: str, place: str) -> list[Any]:
    """Return a list of objects of an animation."""
    found = item.get(name)
    if not isinstance(found, list) or not all(type(entry) is dict for entry in found):
        container.fail(place, "expected a list of objects")
    return found


def _read_times(container: Container, index: object, place: str) -> FloatArray:
    times = to_floats(read_accessor(container, index, place, 1)[:, 0])
    if not np.isfinite(times).all() or times[0] < 0 or (np.diff(times) < 0).any():
        container.fail(f"accessors[{index}]", "expected increasing key times")
    return times


def choose_times(key_times: Sequence[FloatArray], rate: float | None, n_nodes: int) -> FloatArray:
    """Return the times of the frames, from the first to the last key.

    Their number is that of the whole intervals nearest to `rate`, by default the rate of the keys,
    so that the duration is exact. An animation of one key has one frame. Raises ValueError if there
    are too many frames.
    """
    keys = np.unique(np.concatenate(key_times))
    start, stop = float(keys[0]), float(keys[-1])
    if rate is None:
        rate = _key_rate(keys)
    n_intervals = (stop - start) * rate
    most_keys = max(map(len, key_times))
    if (n_intervals + 1) * n_nodes > max(_MAX_JOINT_FRAMES, 8 * most_keys * n_nodes):
        raise ValueError(
            f"a duration of {stop - start:.6g} s at {rate:.6g} frames per second is too long for "
            f"{most_keys} keys of {n_nodes} nodes; choose a lower rate"
        )
    count = 1 if stop == start else max(round(n_intervals), 1) + 1
    return np.linspace(start, stop, count)


def _key_rate(times: FloatArray) -> float:
    """Return the rate of the finest uniform grid of key times, or `DEFAULT_RATE`.

    Keys may be absent at any time of the grid.
    """
    if len(times) < 3:
        return DEFAULT_RATE
    gaps = np.diff(times)
    step = float(gaps.min())
    counts = np.round((times - times[0]) / step)
    span = times[-1] - times[0]
    # Single precision rounds long key times; their step is more precise over the whole span.
    step = span / counts[-1]
    rounding = 4 * np.finfo(np.float32).eps * times[-1]
    deviation = np.abs(times - times[0] - counts * step).max()
    low, high = _RATE_BOUNDS
    is_grid = deviation <= _GRID_TOLERANCE * step + rounding
    return 1.0 / step if is_grid and low <= 1.0 / step <= high else DEFAULT_RATE


def sample(
    tracks: Iterable[Track], times: FloatArray, rest: Transforms, rows: IntArray
) -> Transforms:
    """Return the local transforms of nodes at the times of the frames.

    `rest` holds the default transforms of these nodes, one frame. `rows` maps an index of a node in
    the file to its row in the result.
    """
    n_frames = len(times)
    arrays = {
        path: np.repeat(array, n_frames, axis=0)
        for path, array in zip(
            ("translation", "rotation", "scale"),
            (rest.translations, rest.rotations, rest.scales),
            strict=True,
        )
    }
    for track in tracks:
        columns = rows[track.nodes]
        varies = _varies(track)
        if not varies.all():
            first = track.values[~varies, 1 if track.interpolation == "CUBICSPLINE" else 0]
            arrays[track.path][:, columns[~varies]] = first
        if varies.any():
            arrays[track.path][:, columns[varies]] = _interpolate(track, varies, times)
    return Transforms(arrays["translation"], arrays["rotation"], arrays["scale"])


def _varies(track: Track) -> BoolArray:
    """Return whether each track has different values, shape (n_tracks,)."""
    if track.interpolation == "CUBICSPLINE":
        varies: BoolArray = np.ones(len(track.values), bool)
        return varies
    differences = track.values != track.values[:, :1]
    different: BoolArray = differences.reshape(len(differences), -1).any(axis=1)
    return different


def _interpolate(track: Track, chosen: BoolArray, times: FloatArray) -> FloatArray:
    """Return the values of the chosen tracks, shape (n_frames, n_chosen, width)."""
    keys, values = track.times, track.values[chosen]
    n_keys = len(keys)
    step = (times[-1] - times[0]) / max(len(times) - 1, 1)
    # A frame at a key, up to rounding, has the value of the key.
    tolerance = 1e-4 * step + 2 * np.finfo(np.float32).eps * keys[-1]
    is_spline = track.interpolation == "CUBICSPLINE"
    if n_keys == len(times) and not is_spline and np.abs(keys - times).max() <= tolerance:
        return values.transpose(1, 0, 2)
    before = np.clip(np.searchsorted(keys, times + tolerance, side="right") - 1, 0, n_keys - 1)
    after = np.minimum(before + 1, n_keys - 1)
    gaps = keys[after] - keys[before]
    u = np.clip((times - keys[before]) / np.where(gaps > 0, gaps, 1.0), 0.0, 1.0)
    u = np.where(times - keys[before] <= tolerance, 0.0, u)
    if track.interpolation == "STEP":
        return values[:, before].transpose(1, 0, 2)
    if is_spline:
        result = _hermite(values, before, after, u, gaps)
    elif track.path == "rotation":
        return _slerp(values[:, before], values[:, after], u[:, None]).transpose(1, 0, 2)
    else:
        start, end = values[:, before], values[:, after]
        result = start + u[:, None] * (end - start)
    if track.path == "rotation":
        norms = np.linalg.norm(result, axis=-1, keepdims=True)
        result = np.where(norms < 1e-6, rotations.IDENTITY, result / np.maximum(norms, 1e-6))
    return result.transpose(1, 0, 2)


def _hermite(
    values: FloatArray, before: IntArray, after: IntArray, u: FloatArray, gaps: FloatArray
) -> FloatArray:
    """Evaluate cubic splines; keys are triples of in-tangent, value and out-tangent."""
    u, gaps = u[:, None], gaps[:, None]
    start, leaving = values[:, 3 * before + 1], gaps * values[:, 3 * before + 2]
    end, reaching = values[:, 3 * after + 1], gaps * values[:, 3 * after]
    square, cube = u**2, u**3
    curve: FloatArray = (
        (2 * cube - 3 * square + 1) * start
        + (cube - 2 * square + u) * leaving
        + (3 * square - 2 * cube) * end
        + (cube - square) * reaching
    )
    return curve


def _slerp(start: FloatArray, end: FloatArray, u: FloatArray) -> FloatArray:
    """Return the rotations at the fractions `u` of the shortest arcs between unit quaternions."""
    cosines = np.einsum("...i,...i->...", start, end)
    signs = np.where(cosines < 0, -1.0, 1.0)[..., None]
    angles = np.arccos(np.minimum(np.abs(cosines), 1.0))[..., None]
    sines = np.sin(angles)
    is_small = sines < 1e-6
    sines = np.where(is_small, 1.0, sines)
    first = np.where(is_small, 1.0 - u, np.sin((1.0 - u) * angles) / sines)
    second = np.where(is_small, u, np.sin(u * angles) / sines)
    mixed = first * start + second * (signs * end)
    unit: FloatArray = mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
    return unit
