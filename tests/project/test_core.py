"""The compiled module: calls with arrays of any form raise ordinary exceptions and never panic."""

import inspect

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import _core  # noqa: TID251 - the bindings by themselves
from tests.strategies import few_examples

# Huge numbers in an array may require more memory than there is.
WRONG_ARRAY = (ValueError, TypeError, MemoryError)
ORDINARY = (*WRONG_ARRAY, OverflowError, IndexError)
HUGE = 2**62


def floats(*shape):
    return np.linspace(0.1, 0.9, int(np.prod(shape))).reshape(shape)


def quats(*shape):
    rotations = floats(*shape, 4)
    return rotations / np.linalg.norm(rotations, axis=-1, keepdims=True)


def indices(*values):
    return np.array(values, np.int64)


# Arguments of a valid call of each function: four frames, two joints.
CALLS = {
    "add_offsets": (
        floats(4, 2, 3),
        (indices(0, 0, 1, 1), floats(4), floats(4), floats(2)),
        (floats(1, 2, 3), floats(1, 2, 3)),
        (floats(1, 2, 3), floats(1, 2, 3)),
    ),
    "added_imbalances": (
        floats(4, 3, 2),
        (indices(0, 1), floats(2, 3, 3), floats(2, 3, 8)),
        (indices(1, 2, 3), indices(1, 2)),
        floats(4, 2),
        0.01,
        2,
    ),
    "angle": (quats(4, 2), quats(4, 2)),
    "available_memory": (),
    "box_clearance": (floats(4, 2, 2, 3), floats(2), [0.0] * 3, [1.0] * 3, [0.0, 0.0, 0.0, 1.0]),
    "capsule_ends": (quats(4, 2), floats(4, 2, 3), indices(0, 1, 1), floats(3, 3)),
    "clearance": (
        floats(4, 3, 2, 3),
        floats(3),
        floats(5, 2, 2, 3),
        floats(2),
        indices(0, 4, 1, 1),
        (indices(0, 2), indices(1, 0)),
    ),
    "clip_states": ([quats(4, 2), quats(3, 2)], indices(0, 1, 1), indices(3, 0, 2)),
    "continuous_signs": (quats(4, 2),),
    "cubic": (np.arange(4.0), quats(4, 2), floats(5)),
    "cubic_positions": (np.arange(4.0), floats(4, 2, 3), floats(5)),
    "cut": (floats(6, 2), 0.5, 1, 1_000, None, None),
    "distances": (floats(4, 9), indices(0, 1, 3), indices(1, 1, 2)),
    "exp": (floats(4, 2, 3),),
    "features": (floats(3, 2 * 2 * 4 + 3), (2, 2), indices(1, 0), quats(2), 1, 2),
    "format_rows": (floats(4, 3),),
    "from_channels": (floats(4, 5), [0, 3, 5], [(0, 0), (1, 1), (2, 2), (0, 3), (1, 4)], 0.01),
    "from_euler": (floats(4, 2, 3), [2, 0, 1]),
    "greatest_derivatives": (quats(4, 2), indices(0, 1)),
    "hermite": (quats(4, 2), quats(4, 2), floats(4, 2, 3), floats(4, 2, 3), floats(8)),
    "keep_cheapest": (indices(1, 3), floats(4), np.array([False, True, False, False]), 2),
    "kinetic_energy": (indices(-1, 0), quats(4, 2), floats(2), 0.1, "world"),
    "linkage": (floats(6, 2), 1, 1_000, None, None),
    "linkage_condensed": (floats(10), 1, 1_000, None, None),
    "local": (indices(-1, 0), quats(4, 2), floats(4, 2, 3)),
    "log": (quats(4, 2),),
    "moments": (floats(3, 2 * 2 * 4 + 3), (2, 2)),
    "multiply": (quats(4, 2), quats(4, 2)),
    "pose_gaps": (quats(4, 2), quats(3, 2)),
    "pose_gaps_along": (quats(4, 2), quats(4, 2), indices(0, 1, 3), indices(1, 2)),
    "replace_joints": (quats(4, 2), quats(4, 1), indices(1)),
    "rotate": (quats(4, 2), floats(4, 2, 3)),
    "sample": (indices(1, 2), floats(3), floats(2), 0.5, floats(2)),
    "sample_clips": ([quats(4, 2), quats(3, 2)], indices(0, 1, 1), floats(3)),
    "sample_keys": (
        floats(3),
        np.arange(5.0),
        indices(0, 2, 5),
        quats(11),
        indices(0, 0, 0, 2, 1, 2).reshape(2, 3),
    ),
    "scan_numbers": (b"1 2.5\n3e1 x", 0, 6),
    "segments": (quats(4, 2), indices(0, 1), indices(2, 3), indices(4, 2)),
    "segments_positions": (floats(4, 2, 3), indices(0, 1), indices(2, 3), indices(4, 2)),
    "slerp": (np.arange(4.0), quats(4, 2), floats(5)),
    "smooth_gradient": (
        quats(5, 2),
        (indices(0, 2), indices(2, 4), quats(6, 2), indices(0), floats(2, 1, 2, 3)),
        [1.0, 4.0, 16.0],
        (3.0, 1, 2.0),
    ),
    "to_euler": (quats(4, 2), (2, 0, 1), (0.0, 0.0, 0.0)),
    "velocity_gaps": (floats(4, 2, 3), floats(3, 2, 3)),
    "velocity_gaps_along": (floats(4, 2, 3), floats(4, 2, 3), indices(0, 1, 3), indices(1, 2)),
    "world": (indices(-1, 0), quats(4, 2), floats(4, 2, 3)),
    "world_jerk": (indices(-1, 0), quats(4, 2), floats(4, 2, 3), indices(1)),
}


def misalign(array):
    """Return a copy of an array whose elements are not aligned in memory."""
    data = np.zeros(array.nbytes + 1, np.uint8)
    copy = data[1:].view(array.dtype) if array.nbytes else array
    copy = copy.reshape(array.shape)
    copy[...] = array
    return copy


def spread(array):
    """Return a copy of an array with gaps between the elements of its last axis."""
    wide = np.zeros((*array.shape, 2), array.dtype)
    wide[..., 0] = array
    return wide[..., 0]


def lock(array):
    copy = array.copy()
    copy.flags.writeable = False
    return copy


LAYOUTS = {
    "Fortran order": np.asfortranarray,
    "gaps": spread,
    "misaligned": misalign,
    "reversed": lambda array: array[::-1].copy()[::-1],
    "byte order": lambda array: array.astype(array.dtype.newbyteorder()),
    "read-only": lock,
}
"""Other forms of an array with the same elements."""

ARRAYS = LAYOUTS | {
    "one axis more": lambda array: array[None],
    "a last axis more": lambda array: array[..., None],
    "one axis less": lambda array: array[0],
    "flat": np.ravel,
    "no axis": lambda array: array.ravel()[0].reshape(()),
    "shorter": lambda array: array[:-1],
    "longer": lambda array: np.concatenate([array, array[:1]]),
    "empty": lambda array: array[:0],
    "one": lambda array: array[:1],
    "narrower": lambda array: np.ascontiguousarray(array[..., :-1]),
    "wider": lambda array: np.concatenate([array, array[..., :1]], axis=-1),
    "last axis of 0": lambda array: np.ascontiguousarray(array[..., :0]),
    "last axis of 3": lambda array: np.resize(array, (*array.shape[:-1], 3)),
    "last axis of 4": lambda array: np.resize(array, (*array.shape[:-1], 4)),
    "no joints": lambda array: np.zeros((len(array), 0, *array.shape[2:]), array.dtype),
    "one joint": lambda array: np.ascontiguousarray(array[:, :1]),
    "single precision": lambda array: array.astype(np.float32),
    "integers": lambda array: array.astype(np.int64),
    "short integers": lambda array: array.astype(np.int16),
    "doubles": lambda array: array.astype(np.float64),
    "flags": lambda array: array.astype(bool),
    "complex": lambda array: array.astype(complex),
    "objects": lambda array: array.astype(object),
    "text": lambda array: array.astype(str),
    "a list": lambda array: array.tolist(),
    "none": lambda _: None,
    "minus one": lambda array: np.full_like(array, -1),
    "zero": np.zeros_like,
    "nan or huge": lambda array: np.full_like(array, np.nan if array.dtype == float else HUGE),
    "descending": lambda array: array[::-1].copy(),
}
OTHERS = [None, -1, 0, 1, 3, HUGE, -HUGE, 2**70, 0.5, np.nan, "x", b"", [], (), object()]


def leaves(item, path=()):
    """Yield the paths of the arguments, those in tuples and lists included."""
    if isinstance(item, tuple | list):
        if path:
            yield path
        for key, child in enumerate(item):
            yield from leaves(child, (*path, key))
    else:
        yield path


def get(item, path):
    return get(item[path[0]], path[1:]) if path else item


def replace_item(item, path, value):
    """Return a copy of nested arguments with another value at a path."""
    if not path:
        return value
    children = list(item)
    children[path[0]] = replace_item(children[path[0]], path[1:], value)
    return type(item)(children)


def call(name, arguments):
    """Call a function on copies of its arguments; return the result and the changed arguments."""
    own = copy(arguments)
    return getattr(_core, name)(*own), own


def copy(item):
    """Copy arrays that may be changed, and keep their layout in memory."""
    if isinstance(item, tuple | list):
        return type(item)(map(copy, item))
    is_plain = isinstance(item, np.ndarray) and item.flags.c_contiguous and item.flags.aligned
    return item.copy() if is_plain and item.flags.writeable else item


def change(arguments, path, form):
    """Return arguments with one changed; None if an array has no such form."""
    value = get(arguments, path)
    if not isinstance(value, np.ndarray):
        return replace_item(arguments, path, OTHERS[form % len(OTHERS)])
    try:
        changed = list(ARRAYS.values())[form % len(ARRAYS)](value)
    except (AttributeError, IndexError, TypeError, ValueError, np.exceptions.AxisError):
        return None
    return replace_item(arguments, path, changed)


def try_call(name, arguments, expected=ORDINARY):
    """Call a function; exceptions that are not expected end the test."""
    try:
        with np.errstate(all="ignore"):
            call(name, arguments)
    except expected:
        pass


def test_calls_cover_all_functions_and_are_valid():
    functions = {name for name in _core.__all__ if inspect.isroutine(getattr(_core, name))}
    assert set(CALLS) == functions
    for name, arguments in CALLS.items():
        call(name, arguments)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", CALLS)
def test_core_with_one_wrong_argument_raises_ordinary_exception(name):
    arguments = CALLS[name]
    for path in leaves(arguments):
        for form in range(max(len(ARRAYS), len(OTHERS))):
            changed = change(arguments, path, form)
            if changed is not None:
                is_array = isinstance(get(arguments, path), np.ndarray)
                try_call(name, changed, WRONG_ARRAY if is_array else ORDINARY)
    for n in range(len(arguments)):
        with pytest.raises(TypeError):
            getattr(_core, name)(*arguments[:n])


@pytest.mark.filterwarnings("ignore")
@few_examples(400)
@given(st.sampled_from(sorted(CALLS)), st.data())
def test_core_with_several_wrong_arguments_raises_ordinary_exception(name, data):
    arguments = CALLS[name]
    for _ in range(data.draw(st.integers(2, 4))):
        paths = list(leaves(arguments))
        if not paths:
            return
        path = data.draw(st.sampled_from(paths))
        changed = change(arguments, path, data.draw(st.integers(0, len(ARRAYS) - 1)))
        arguments = arguments if changed is None else changed
    try_call(name, arguments)


@pytest.mark.parametrize("name", sorted(CALLS.keys() - {"available_memory"}))
def test_core_with_array_of_other_layout_raises_or_gives_same_result(name):
    arguments = CALLS[name]
    expected = call(name, arguments)
    for path in leaves(arguments):
        value = get(arguments, path)
        if not isinstance(value, np.ndarray):
            continue
        for layout, form in LAYOUTS.items():
            try:
                found = call(name, replace_item(arguments, path, form(value)))
            except (TypeError, ValueError):
                continue
            assert_same(found, expected, layout)


def assert_same(found, expected, message):
    """Assert that nested results are equal."""
    if isinstance(expected, tuple | list):
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            assert_same(one, other, message)
    else:
        np.testing.assert_array_equal(found, expected, message)


def test_core_with_array_that_is_also_changed_raises_type_error():
    values, (starts, stops, _, seams, accelerations), weights, limits = CALLS["smooth_gradient"]
    values = values.copy()
    with pytest.raises(TypeError, match="already borrowed"):
        _core.smooth_gradient(
            values, (starts, stops, values, seams, accelerations), weights, limits
        )
    with pytest.raises(TypeError, match="not writeable"):
        _core.smooth_gradient(
            lock(values), (starts, stops, values.copy(), seams, accelerations), weights, limits
        )
