"""The channels of glTF animations, and the keys of their tracks."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.io.gltf.accessors import read_accessor, read_accessors, to_floats
from mograft.io.gltf.container import Container

PATH_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
"""The animated properties of a node, and the number of components of a value."""

_INTERPOLATIONS = {"STEP": 0, "LINEAR": 1, "CUBICSPLINE": 2}
"""Interpolations, and their numbers in `Tracks.table`."""

_SPLINE = _INTERPOLATIONS["CUBICSPLINE"]

_MIN_KEY_LIMIT = 1 << 20
"""Limit of the keys of an animation: this number, or one per byte of the file if that is more.
Several accessors may refer to the same bytes, so that a small file may claim any number of keys."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """The tracks of one property of several nodes; the values of all keys are in one array.

    `table` has a row per track: the row of its first value in `values`, the index of its key times
    in `Animation.key_times`, and its interpolation, a value of `_INTERPOLATIONS`. With splines, a
    key has three values: in-tangent, value and out-tangent.
    """

    path: str  # the property, a key of `PATH_WIDTHS`
    nodes: IntArray  # the node of each track, shape (n_tracks,)
    table: IntArray  # shape (n_tracks, 3)
    values: FloatArray  # shape (n_rows, width)


@dataclass(frozen=True, eq=False)
class Channels:
    """The channels of one animation that move some nodes."""

    place: str  # of the animation in the document, for messages
    groups: dict[tuple[str, bool], list[tuple[int, int, int, object]]]
    """The channels by property and whether they are splines. A channel is a tuple of its node, the
    index of its key times, its interpolation (a value of `_INTERPOLATIONS`) and the index of the
    accessor of its values."""
    key_times: tuple[FloatArray, ...]  # seconds, shape (n_keys,)


def animated_properties(container: Container, animation: int) -> set[tuple[int | None, str]]:
    """Return the pairs of node and property that an animation changes, without reading its keys.

    The node is None if the property does not belong to a node, as extensions permit.
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
    inputs: dict[object, int] = {}  # index of the key times, by accessor
    key_times: list[FloatArray] = []
    groups: dict[tuple[str, bool], list[tuple[int, int, int, object]]] = {}
    seen: set[tuple[object, object]] = set()
    for position, channel in enumerate(channels):
        target = channel["target"]
        node, path = pair = target.get("node"), target.get("path")
        if node not in nodes or path not in PATH_WIDTHS:
            continue
        if pair in seen:
            place = f"{own}.channels[{position}]"
            container.fail(place, f"expected one track of the {path} of node {node}, got two")
        seen.add(pair)
        index = channel.get("sampler")
        if type(index) is not int or not 0 <= index < len(samplers):
            place = f"{own}.channels[{position}].sampler"
            container.fail(place, f"expected an index of {len(samplers)} samplers, got {index!r}")
        sampler = samplers[index]
        key = sampler.get("input")
        if type(key) is not int or key not in inputs:
            key_times.append(_read_times(container, key, f"{own}.samplers[{index}].input"))
            inputs[key] = len(inputs)
            _check_count(container, sum(map(len, key_times)), own)
        interpolation = sampler.get("interpolation", "LINEAR")
        if type(interpolation) is not str or interpolation not in _INTERPOLATIONS:
            place = f"{own}.samplers[{index}].interpolation"
            container.fail(place, f"expected an interpolation, got {interpolation!r}")
        number = _INTERPOLATIONS[interpolation]
        entry = (node, inputs[key], number, sampler.get("output"))
        groups.setdefault((path, number == _SPLINE), []).append(entry)
    return Channels(own, groups, tuple(key_times))


@dataclass(frozen=True, eq=False)
class Animation:
    """The tracks of one animation."""

    tracks: tuple[Tracks, ...]
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
    return read_tracks(container, read_channels(container, animation, nodes))


def read_tracks(container: Container, channels: Channels) -> Animation:
    """Read the values of channels; rotations are normalized, except those of splines."""
    tracks = []
    lengths = np.array([len(times) for times in channels.key_times], np.int64)
    used = [member[1] for members in channels.groups.values() for member in members]
    _check_count(container, int(lengths[used].sum()), channels.place)
    for (path, is_spline), members in channels.groups.items():
        nodes, inputs, interpolations, outputs = zip(*members, strict=True)
        counts = lengths[list(inputs)] * (3 if is_spline else 1)
        place = f"{channels.place}: the {path} tracks"
        values = read_accessors(container, outputs, place, counts.tolist(), PATH_WIDTHS[path])
        if not np.isfinite(values).all():
            container.fail(place, "expected finite numbers")
        if path == "rotation" and not is_spline:
            norms = np.sqrt(np.einsum("ki,ki->k", values, values))
            if (norms < 1e-6).any():
                container.fail(place, "expected unit quaternions, got zero")
            values /= norms[:, None]
        table = np.array([np.cumsum(counts) - counts, inputs, interpolations]).T
        tracks.append(Tracks(path, np.array(nodes), np.ascontiguousarray(table), values))
    return Animation(tuple(tracks), channels.key_times)


def _check_count(container: Container, n_keys: int, place: str) -> None:
    """Raise `FormatError` if an animation has more keys than the limit for its file.

    The limit is `_MIN_KEY_LIMIT` or one key per byte.
    """
    limit = max(_MIN_KEY_LIMIT, container.n_bytes)
    if n_keys > limit:
        container.fail(place, f"expected at most {limit} keys, got {n_keys} that share bytes")


def _objects(container: Container, item: dict[str, Any], name: str, place: str) -> list[Any]:
    """Return the entry `name` of an animation, which must be a list of objects."""
    found = item.get(name)
    if not isinstance(found, list) or not {*map(type, found)} <= {dict}:
        container.fail(place, "expected a list of objects")
    return found


def _read_times(container: Container, index: object, place: str) -> FloatArray:
    times = to_floats(read_accessor(container, index, place, 1)[:, 0])
    # Of increasing times, all are finite if the last one is.
    if not (times[0] >= 0 and times[-1] < np.inf and (times[1:] >= times[:-1]).all()):
        container.fail(f"accessors[{index}]", "expected increasing key times")
    return times
