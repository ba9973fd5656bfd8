"""Public values: copies, NumPy scalars as arguments, and errors for wrong types."""

import copy
import json
import pickle
import re
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.body.mass import mass_model
from mograft.dancer import dance

MOTION = dance(seed=0, strides=1).motion
GROUPS = mg.JointGroups.preset("lower_upper", MOTION.skeleton)


@pytest.fixture(scope="module")
def library():
    return mg.Library.build(dance(seed=0, strides=1).motion)


def arrays(value):
    """Yield the arrays in a value, with their attribute paths."""
    if isinstance(value, np.ndarray):
        yield "", value
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from ((f"[{index}]{path}", array) for path, array in arrays(item))
    elif is_dataclass(value):
        for field in fields(value):
            item = getattr(value, field.name)
            yield from ((f".{field.name}{path}", array) for path, array in arrays(item))


COPIES = [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))]


@pytest.fixture(scope="module")
def values(library):
    motion = library.clips[0]
    others = {"Dance": dance(seed=0, strides=1), "Body": mass_model(library.skeleton)}
    return others | {"Motion": motion, "Skeleton": motion.skeleton, "Segments": library.segments}


@pytest.mark.parametrize("copy_value", COPIES, ids=["copy", "deepcopy", "pickle"])
@pytest.mark.parametrize("kind", ["Motion", "Skeleton", "Segments", "Body", "Dance"])
def test_value_copies_have_read_only_arrays(values, kind, copy_value):
    value = values[kind]
    before, after = dict(arrays(value)), dict(arrays(copy_value(value)))
    assert before
    assert before.keys() == after.keys()
    for path, array in after.items():
        np.testing.assert_array_equal(array, before[path])
        assert not array.flags.writeable, path


NUMBERS = st.sampled_from([np.float64, np.float32, np.float16, np.int64, np.uint8])


@given(NUMBERS, st.integers(1, 200))
def test_config_numpy_scalars_equal_python_numbers(kind, number):
    value = kind(number)
    given, expected = mg.Config(sigma_scale=value), mg.Config(sigma_scale=value.item())
    assert given == expected
    assert json.dumps(given.as_dict()) == json.dumps(expected.as_dict())
    given, expected = (mc.Sphere((0, 0, 0), radius) for radius in (value, value.item()))
    assert repr(given) == repr(expected)


def test_graft_many_accepts_numpy_integers(library):
    expected = mg.graft(library, constraints=[mc.KeepOriginal(frames=(5, 9))], seed=7)
    keep = mc.KeepOriginal(frames=(np.int64(5), np.uint8(9)))
    given = mg.graft(library, constraints=[keep], seed=np.uint16(7))
    assert json.dumps(mg.graft_record(given)) == json.dumps(mg.graft_record(expected))
    assert len(mg.graft_many(library, count=np.int32(2))) == 2
    assert mg.Config(samples=np.int64(8)) == mg.Config(samples=8)
    reach = mc.Reach("LeftHand", np.zeros(3, np.float32), np.int64(3), weight=np.float32(1))
    assert reach == mc.Reach("LeftHand", (0.0, 0.0, 0.0), 3, weight=1.0)


@pytest.mark.parametrize(
    ("call", "arguments", "message"),
    [
        (mg.segment, ["a.bvh"], "`motion` must be a Motion, got str"),
        (lambda config: mg.segment(MOTION, config), [3], "`config` must be a Config, got int"),
        (mg.JointGroups.preset, ["lower_upper", MOTION], "`skeleton` must be a Skeleton, got Mot"),
        (GROUPS.resolve, [MOTION], "`skeleton` must be a Skeleton, got Motion"),
        (GROUPS.divided_channels, [MOTION], "`skeleton` must be a Skeleton, got Motion"),
        (list, [mg.Segments([0, 8], [8, 9])], "`indices` must be a slice or an array, got 0"),
        (mg.kinetic_energy, [None], "`motion` must be a Motion, got NoneType"),
        (mg.mirror, ["a.bvh"], "`motion` must be a Motion, got str"),
        (mg.find_faults, ["a.bvh"], "`motion` must be a Motion, got str"),
        (mg.write_bvh, [3, "a.bvh"], "`motion` must be a Motion, got int"),
        (mc.Avoid, [3], "`obstacle` must be an obstacle such as Sphere, Capsule or Box, got 3"),
        (mc.KeepOut, ["Hips", None], "`region` must be an obstacle such as Sphere, Capsule or Box"),
        (mc.Character, ["a.bvh"], "`motion` must be a Motion, got str"),
        (mc.OnlyFrom, [3], "`clips` must be a name or several names, got 3"),
        (mc.NotFrom, [["a", 3]], "`clips` must be a name or several names, got"),
        (mc.MaxStretch, ["a"], "`limit` must be a number, got 'a'"),
        (mc.Sphere, [(0, 0, 0), "a"], "`radius` must be a number, got 'a'"),
    ],
    ids=lambda argument: getattr(argument, "__name__", ""),
)
def test_public_functions_wrong_type_raises_type_error(call, arguments, message):
    with pytest.raises(TypeError, match=message):
        call(*arguments)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda own: mg.graft(own.clips[0]), TypeError, "`library` must be a Library, got Motion"),
        (lambda own: mg.graft(own, 3), TypeError, "`base` must be a Motion, got int"),
        (lambda own: mg.graft(own, [own.clips[0]]), TypeError, "`base` must be a Motion, got list"),
        (lambda own: mg.graft(own, swap="upper"), TypeError, "`swap` must be a list of groups"),
        (lambda _: mg.plant_feet(3), TypeError, "`motion` must be a Motion, got int"),
        (lambda _: mg.foot_skate(3), TypeError, "`motion` must be a Motion, got int"),
        (lambda own: mg.Stream(own.clips[0]), TypeError, "`library` must be a Library, got Motion"),
        (lambda own: mg.write_bvh(own.clips[0], 3), TypeError, "`target` must be a path or a file"),
    ],
    ids=range(8),
)
def test_public_functions_invalid_collections_raise(library, call, error, message):
    with pytest.raises(error, match=message):
        call(library)


@pytest.mark.parametrize("segment", [1.5, True, None, -1, np.int64(10**6)])
def test_candidates_invalid_segment_raises_value_error(library, segment):
    message = f"`segment` must be 0 to .*, got {re.escape(repr(segment))}"
    with pytest.raises(ValueError, match=message):
        mg.candidates(library, segment, "upper")


@pytest.mark.parametrize("frames", [3, (1,), (5, 2), (0.5, 2), (-1, 2), "ab"])
def test_constraint_frames_must_be_ascending_pair(frames):
    message = "must be a first and a last frame, ascending"
    with pytest.raises(ValueError, match=f"`frames` {message}"):
        mc.AvoidSelf(frames=frames)
    with pytest.raises(ValueError, match=f"`clip_frames` {message}"):
        mc.OnlyFrom("a", clip_frames=frames)


@pytest.mark.parametrize("frame", [-1, 1.5, True, "1"])
def test_constraint_frame_must_be_integer(frame):
    with pytest.raises(ValueError, match="`frame` must be a whole number of at least 0"):
        mc.Reach("LeftHand", (0, 0, 0), frame)


def test_segments_ragged_rows_raise_value_error():
    with pytest.raises(ValueError, match="`stop` must be an array, got rows of different lengths"):
        mg.Segments([0, 8], [[8], [15, 21]])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_obstacle_non_finite_values_raise_value_error(library, value):
    for name in ("yaw", "delay"):
        with pytest.raises(ValueError, match=f"`{name}` must be finite, got {value}"):
            mc.Character(library.clips[0], **{name: value})
    with pytest.raises(ValueError, match=f"`margin` must be finite, got {value}"):
        mc.Avoid(mc.Sphere((0, 0, 0), 1), margin=value)
