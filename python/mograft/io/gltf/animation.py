"""glTF animations: channels, key times, the times of frames, and the values of tracks at these."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.io.gltf.container import Container, read_accessor, read_accessors, to_floats
from mograft.io.gltf.nodes import Transforms
from mograft.motion.limits import check_frames

PATH_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
"""The animated properties of a node, in the order of the fields of `Transforms`, and the number of
components of a value."""

_INTERPOLATIONS = {"STEP": 0, "LINEAR": 1, "CUBICSPLINE": 2}
"""Interpolations, and their numbers in the kernel."""

_SPLINE = _INTERPOLATIONS["CUBICSPLINE"]

_MIN_KEY_LIMIT = 1 << 20
"""Limit of the keys of an animation: this number, or one per byte of the file if that is more.
Several accessors may refer to the same bytes, so that a small file may claim any number of keys."""

DEFAULT_RATE = 30.0
"""Frames per second of animations whose keys give no rate."""

_RATE_BOUNDS = (12.0, 500.0)
"""Rates that keys may give; slower keys are poses between which a motion is interpolated."""

_GRID_TOLERANCE = 1e-3
"""Deviation of key times from a uniform grid that is tolerated, as a fraction of its step."""

_MIN_POSE_LIMIT = 1 << 21
_POSES_PER_BYTE = 8
_FRAMES_PER_KEY = 8
"""Limits of the poses of nodes in a motion. A motion of at most the first constant is accepted;
otherwise its poses must not exceed these multiples of the bytes of the file and of the keys of the
longest track. A file of few keys may claim a duration whose frames exceed any memory."""


@dataclass(frozen=True, eq=False)
class Animation:
    """The channels of one animation that move some nodes."""

    place: str  # of the animation in the document, for messages
    groups: dict[tuple[str, bool], list[tuple[int, int, int, object]]]
    """The channels by property and whether they are splines. A channel is a tuple of its node, the
    index of its key times, its interpolation (a value of `_INTERPOLATIONS`) and the index of the
    accessor of its values. With splines, a key has three values: in-tangent, value, out-tangent."""
    key_times: tuple[FloatArray, ...]  # seconds, shape (n_keys,); each is used by some channels

    @property
    def start(self) -> float:
        """Time of the first key in seconds."""
        return min(float(times[0]) for times in self.key_times)

    @property
    def duration(self) -> float:
        """Seconds from the first key to the last."""
        return max(float(times[-1]) for times in self.key_times) - self.start


def animation_names(animations: Sequence[dict[str, Any]]) -> list[str]:
    """Return the names of animations; empty if an animation has none."""
    names = [own.get("name") for own in animations]
    return [name if isinstance(name, str) else "" for name in names]


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
    for node in {node for node, _ in found} - {None}:
        container.item("nodes", node, place)
    return found


def read_animation(container: Container, animation: int, nodes: frozenset[int]) -> Animation:
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
    place = f"{own}.samplers"
    for position, channel in enumerate(channels):
        target = channel["target"]
        node, path = pair = target.get("node"), target.get("path")
        if node not in nodes or path not in PATH_WIDTHS:
            continue
        if pair in seen:
            message = f"expected one track of the {path} of node {node}, got two"
            container.fail(f"{own}.channels[{position}]", message)
        seen.add(pair)
        index = channel.get("sampler")
        sampler = container.choose(samplers, index, own, "samplers")
        key = sampler.get("input")
        if type(key) is not int or key not in inputs:
            key_times.append(_read_times(container, key, f"{place}[{index}].input"))
            inputs[key] = len(inputs)
            _check_count(container, sum(map(len, key_times)), own)
        interpolation = sampler.get("interpolation", "LINEAR")
        if type(interpolation) is not str or interpolation not in _INTERPOLATIONS:
            message = f"expected an interpolation, got {interpolation!r}"
            container.fail(f"{place}[{index}].interpolation", message)
        number = _INTERPOLATIONS[interpolation]
        entry = (node, inputs[key], number, sampler.get("output"))
        groups.setdefault((path, number == _SPLINE), []).append(entry)
    return Animation(own, groups, tuple(key_times))


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


def choose_times(
    key_times: Sequence[FloatArray], rate: float | None, n_nodes: int, n_bytes: int
) -> FloatArray:
    """Return equally spaced times of frames, from the first to the last key.

    The duration is divided into a whole number of intervals, so that the rate is as near as
    possible to `rate`, by default the rate of the keys. An animation of one key has one frame.
    Raises ValueError if the poses of `n_nodes` nodes in all frames exceed the limit for the keys
    and for a file of `n_bytes`.
    """
    keys = np.unique(np.concatenate(key_times))
    start, stop = float(keys[0]), float(keys[-1])
    if rate is None:
        rate = _key_rate(keys)
    n_intervals = (stop - start) * rate
    most_keys = max(map(len, key_times))
    limit = min(_FRAMES_PER_KEY * most_keys * n_nodes, _POSES_PER_BYTE * n_bytes)
    if (n_intervals + 1) * n_nodes > max(_MIN_POSE_LIMIT, limit):
        duration = f"a duration of {stop - start:.6g} s at {rate:.6g} frames per second"
        given = f"{most_keys} keys of {n_nodes} nodes"
        raise ValueError(f"{duration} is too long for {given}; choose a lower rate")
    count = 1 if stop == start else max(round(n_intervals), 1) + 1
    check_frames(count)
    return np.linspace(start, stop, count)


def _key_rate(times: FloatArray) -> float:
    """Return the rate of the uniform grid on which all key times lie.

    The step is the smallest interval between keys; not every time of the grid needs a key. Return
    `DEFAULT_RATE` if there is no such grid, or its rate is not within `_RATE_BOUNDS`.
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
    container: Container, animation: Animation, times: FloatArray, rest: Transforms, rows: IntArray
) -> Transforms:
    """Return the local transforms of nodes at the times of the frames.

    `rest` holds the default transforms of these nodes, one frame. `rows` holds for each node of the
    file its index in the result. Rotations of keys are normalized, except those of splines.
    """
    found = rest.of(np.arange(rest.scales.shape[1]), len(times))
    arrays = dict(zip(PATH_WIDTHS, found, strict=True))
    key_times = np.concatenate(animation.key_times)
    lengths = np.array([len(own) for own in animation.key_times], np.int64)
    used = [member[1] for members in animation.groups.values() for member in members]
    _check_count(container, int(lengths[used].sum()), animation.place)
    for (path, is_spline), members in animation.groups.items():
        nodes, inputs, interpolations, outputs = zip(*members, strict=True)
        counts = lengths[list(inputs)] * (3 if is_spline else 1)
        place = f"{animation.place}: the {path} tracks"
        values = read_accessors(container, outputs, place, counts.tolist(), PATH_WIDTHS[path])
        if not np.isfinite(values).all():
            container.fail(place, "expected finite numbers")
        if path == "rotation" and not is_spline:
            norms = np.sqrt(np.einsum("ki,ki->k", values, values))
            if (norms < 1e-6).any():
                container.fail(place, "expected unit quaternions, got zero")
            values /= norms[:, None]
        # For each track the row of its first value, its key times and its interpolation.
        table = np.array([np.cumsum(counts) - counts, inputs, interpolations]).T
        starts = np.cumsum([0, *lengths])
        sampled = _core.sample_keys(times, key_times, starts, values, np.ascontiguousarray(table))
        arrays[path][:, rows[list(nodes)]] = sampled
    return found
