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
LIBRARY = mg.Library.build(MOTION)
GROUPS = mg.JointGroups.preset("lower_upper", MOTION.skeleton)


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


@pytest.mark.parametrize("copy_value", COPIES, ids=["copy", "deepcopy", "pickle"])
@pytest.mark.parametrize(
    "value",
    [MOTION, MOTION.skeleton, LIBRARY.segments, mass_model(MOTION.skeleton), dance(strides=1)],
    ids=lambda value: type(value).__name__,
)
def test_value_copies_have_read_only_arrays(value, copy_value):
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


def test_graft_many_accepts_numpy_integers():
    expected = mg.graft(LIBRARY, constraints=[mc.KeepOriginal(frames=(5, 9))], seed=7)
    keep = mc.KeepOriginal(frames=(np.int64(5), np.uint8(9)))
    given = mg.graft(LIBRARY, constraints=[keep], seed=np.uint16(7))
    assert json.dumps(mg.graft_record(given)) == json.dumps(mg.graft_record(expected))
    assert len(mg.graft_many(LIBRARY, count=np.int32(2))) == 2
    assert mg.Config(samples=np.int64(8)) == mg.Config(samples=8)
    reach = mc.Reach("LeftHand", np.zeros(3, np.float32), np.int64(3), weight=np.float32(1))
    assert reach == mc.Reach("LeftHand", (0.0, 0.0, 0.0), 3, weight=1.0)


KINDS = {
    "`motion` must be a Motion, got int": [
        *(mg.segment, mg.kinetic_energy, mg.mirror, mg.find_faults, mg.plant_feet, mg.foot_skate),
        *(mc.Character, lambda own: mg.write_bvh(own, "a.bvh")),
    ],
    "`skeleton` must be a Skeleton, got int": [
        *(GROUPS.resolve, GROUPS.divided_channels),
        lambda own: mg.JointGroups.preset("lower_upper", own),
    ],
    "`library` must be a Library, got int": [mg.graft, mg.Stream],
    "`config` must be a Config, got int": [lambda own: mg.segment(MOTION, own)],
    "`base` must be a Motion, got int": [lambda own: mg.graft(LIBRARY, own)],
    "`base` must be a Motion, got list": [lambda own: mg.graft(LIBRARY, [own])],
    "`swap` must be a list of groups": [lambda _: mg.graft(LIBRARY, swap="upper")],
    "`target` must be a path or a file": [lambda own: mg.write_bvh(MOTION, own)],
    "`indices` must be a slice or an array, got 3": [lambda own: mg.Segments([0, 8], [8, 9])[own]],
    "must be an obstacle such as Sphere, Capsule or Box, got 3": [
        *(mc.Avoid, lambda own: mc.KeepOut("Hips", own))
    ],
    "`clips` must be a name or several names, got": [mc.OnlyFrom, lambda n: mc.NotFrom(["a", n])],
    "must be a number, got '3'": [
        *(lambda own: mc.MaxStretch(str(own)), lambda own: mc.Sphere((0, 0, 0), str(own)))
    ],
}
"""Calls with a number that raise TypeError, by the message."""


@pytest.mark.parametrize("message", KINDS)
def test_public_functions_wrong_type_raises_type_error(message):
    for call in KINDS[message]:
        with pytest.raises(TypeError, match=message):
            call(3)


@pytest.mark.parametrize("segment", [1.5, True, None, -1, np.int64(10**6)])
def test_candidates_invalid_segment_raises_value_error(segment):
    message = f"`segment` must be 0 to .*, got {re.escape(repr(segment))}"
    with pytest.raises(ValueError, match=message):
        mg.candidates(LIBRARY, segment, "upper")


PAIR = "must be a first and a last frame, ascending"
FRAMES, WHOLE = f"`frames` {PAIR}", "`frame` must be a whole number of at least 0"
NO_PAIRS, NOT_FINITE, BALL = [3, (5, 2), "ab"], [np.nan, np.inf], mc.Sphere((0, 0, 0), 1)
RAGGED = "`stop` must be an array, got rows of different lengths"


@pytest.mark.parametrize(
    ("call", "values", "message"),
    [
        (lambda own: mc.AvoidSelf(frames=own), [*NO_PAIRS, (1,), (0.5, 2), (-1, 2)], FRAMES),
        (lambda own: mc.OnlyFrom("a", clip_frames=own), NO_PAIRS, f"`clip_frames` {PAIR}"),
        (lambda own: mc.Reach("LeftHand", (0, 0, 0), own), [-1, 1.5, True, "1"], WHOLE),
        (lambda own: mg.Segments([0, 8], own), [[[8], [15, 21]]], RAGGED),
        (lambda own: mc.Character(MOTION, yaw=own), NOT_FINITE, "`yaw` must be finite"),
        (lambda own: mc.Character(MOTION, delay=own), NOT_FINITE, "`delay` must be finite"),
        (
            lambda own: mc.Avoid(BALL, margin=own),
            NOT_FINITE,
            "`margin` must be finite, got (nan|inf)",
        ),
    ],
)
def test_public_values_out_of_range_raise_value_error(call, values, message):
    for value in values:
        with pytest.raises(ValueError, match=message):
            call(value)
