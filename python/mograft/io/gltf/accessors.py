"""Arrays of a glTF file: accessors, with strides, sparse values and normalized integers."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft.io.gltf.container import COMPRESSION, Container

_DTYPES: dict[object, np.dtype[Any]] = {
    5120: np.dtype("i1"),
    5121: np.dtype("u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
_WIDTHS: dict[object, int] = {
    "SCALAR": 1,
    "VEC2": 2,
    "VEC3": 3,
    "VEC4": 4,
    "MAT2": 4,
    "MAT3": 9,
    "MAT4": 16,
}
_INDEX_TYPES = (5121, 5123, 5125)

Array = npt.NDArray[Any]


def read_accessors(
    container: Container, indices: Sequence[object], place: str, counts: Sequence[int], width: int
) -> FloatArray:
    """Return the elements of several accessors one after another, shape (sum of counts, width).

    Accessor i must have `counts[i]` elements. `place` names, in messages, the part of the document
    that refers to the accessors.
    """
    arrays = []
    for index, count in zip(indices, counts, strict=True):
        array = read_accessor(container, index, place, width)
        if len(array) != count:
            container.fail(
                place, f"expected {count} elements in accessors[{index}], got {len(array)}"
            )
        arrays.append(to_floats(array))
    return np.concatenate(arrays)


def to_floats(array: Array) -> FloatArray:
    """Return an array as float64, without a warning if it holds a signalling NaN."""
    with np.errstate(invalid="ignore"):
        return array.astype(np.float64)


def read_accessor(container: Container, index: object, place: str, width: int) -> Array:
    """Return the elements of an accessor, shape (count, width).

    The type is that of the file, except that normalized integers become float64. The array is a
    view of the file's bytes if possible. `place` names, in messages, the part of the document that
    refers to the accessor.
    """
    accessor = container.item("accessors", index, place)
    own = f"accessors[{index}]"
    count = container.integer(accessor.get("count"), f"{own}.count", 1)
    kind, component = accessor.get("type"), accessor.get("componentType")
    if not isinstance(kind, str) or _WIDTHS.get(kind) != width:
        container.fail(f"{own}.type", f"expected {width} components, got {kind!r}")
    dtype = _DTYPES.get(component) if type(component) is int else None
    if dtype is None:
        container.fail(f"{own}.componentType", f"expected a component type, got {component!r}")
    view = accessor.get("bufferView")
    if view is None:
        # Zeros, of which the file stores none; their number is limited by the size of the file.
        if count > container.file_bytes:
            container.fail(f"{own}.count", f"expected elements in the file, got {count} zeros")
        values = np.zeros((count, width), dtype)
    else:
        start = container.integer(accessor.get("byteOffset", 0), f"{own}.byteOffset")
        values = _read_view(container, view, start, (count, width), dtype, own)
    if "sparse" in accessor:
        values = _with_sparse_values(container, accessor["sparse"], values, f"{own}.sparse")
    if accessor.get("normalized") is True and dtype.kind != "f":
        largest = np.iinfo(dtype.str).max
        values = np.maximum(values / largest, -1.0)
    return values


def _read_view(
    container: Container,
    index: object,
    start: int,
    shape: tuple[int, int],
    dtype: np.dtype[Any],
    place: str,
) -> Array:
    """Return an array of the given shape that starts at byte `start` of a buffer view."""
    view = container.item("bufferViews", index, f"{place}.bufferView")
    own = f"bufferViews[{index}]"
    extensions = view.get("extensions")
    if isinstance(extensions, dict) and not extensions.keys().isdisjoint(COMPRESSION):
        container.fail(own, "expected uncompressed data, got meshopt compression")
    buffer = container.buffer(view.get("buffer", -1), f"{own}.buffer")
    offset = container.integer(view.get("byteOffset", 0), f"{own}.byteOffset")
    length = container.integer(view.get("byteLength"), f"{own}.byteLength", 1)
    if offset + length > len(buffer):
        container.fail(own, f"expected an end within {len(buffer)} bytes, got {offset + length}")
    count, width = shape
    element = dtype.itemsize * width
    stride = view.get("byteStride")
    step = element if stride is None else container.integer(stride, f"{own}.byteStride", 1)
    if step < element:
        container.fail(f"{own}.byteStride", f"expected at least {element} bytes, got {step}")
    end = start + step * (count - 1) + element
    if end > length:
        container.fail(place, f"expected elements within {length} bytes, got an end of {end}")
    if step == element or count == 1:
        flat = np.frombuffer(buffer, dtype, count * width, offset + start)
        return flat.reshape(shape)
    strides = (step, dtype.itemsize)
    return np.ndarray(shape, dtype, buffer, offset + start, strides)


def _with_sparse_values(container: Container, sparse: object, values: Array, place: str) -> Array:
    """Return a copy of `values` in which the elements of a sparse accessor are replaced."""
    if not isinstance(sparse, dict):
        container.fail(place, "expected an object")
    count = container.integer(sparse.get("count"), f"{place}.count", 1)
    if count > len(values):
        container.fail(f"{place}.count", f"expected at most {len(values)}, got {count}")
    indices, replaced = sparse.get("indices"), sparse.get("values")
    if not isinstance(indices, dict) or not isinstance(replaced, dict):
        container.fail(place, "expected `indices` and `values`")
    component = indices.get("componentType")
    if component not in _INDEX_TYPES:
        container.fail(f"{place}.indices.componentType", f"expected unsigned, got {component!r}")
    start = container.integer(indices.get("byteOffset", 0), f"{place}.indices.byteOffset")
    rows = _read_view(
        container,
        indices.get("bufferView"),
        start,
        (count, 1),
        _DTYPES[component],
        f"{place}.indices",
    )[:, 0].astype(np.int64)
    if rows[-1] >= len(values) or (np.diff(rows) <= 0).any():
        container.fail(f"{place}.indices", f"expected increasing indices below {len(values)}")
    start = container.integer(replaced.get("byteOffset", 0), f"{place}.values.byteOffset")
    changed = values.copy()
    changed[rows] = _read_view(
        container,
        replaced.get("bufferView"),
        start,
        (count, values.shape[1]),
        values.dtype,
        f"{place}.values",
    )
    return changed
