"""Checks of `Config` and its conversion to dictionaries."""

import json
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config
from mograft.config import variety_fields


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"samples": 1}, "`samples` must be a whole number of at least 2, got 1"),
        ({"sigma": "big"}, "`sigma` must be one of"),
        ({"sigma": -1.0}, "`sigma` must be above 0"),
        ({"min_length": 2.0}, "`max_length` must be at least 4 s, twice `min_length`, got 2"),
        ({"max_angle": float("nan")}, "`max_angle` must be above 0, got nan"),
        ({"seam": "glue"}, "`seam` must be one of"),
        ({"smoothing": "a"}, "`smoothing` must be a number, got 'a'"),
        ({"segmentation": "beat"}, "`segmentation` must be one of .*; did you mean 'beats'"),
        ({"segmentation": [4, 5]}, "`segmentation` must be a name, a mapping .*, or a function"),
        ({"segmentation": {3: [4, 5]}}, "`segmentation` must map names of clips to frames, got 3"),
        ({"segmentation": {"a": [5, 4]}}, "for the clip 'a' must be ascending whole numbers"),
        ({"segmentation": {"a": [-1]}}, "for the clip 'a' must be ascending whole numbers"),
        ({"segmentation": {"a": "45"}}, "for the clip 'a' must be ascending whole numbers"),
        ({"segmentation_parameters": 3}, "`segmentation_parameters` must map names"),
        (
            {"segmentation": {"a": [5]}, "segmentation_parameters": {"b": 1}},
            "`segmentation_parameters` must be empty unless `segmentation` is a name",
        ),
    ],
)
def test_config_invalid_parameter_raises_value_error(changes, message):
    with pytest.raises(ValueError, match=message):
        Config(**changes)


def test_config_from_dict_inverts_as_dict():
    for config in (Config(), Config.paper(sigma=2.5)):
        assert Config.from_dict(config.as_dict()) == config
    with pytest.raises(ValueError, match="unknown fields of Config: speed"):
        Config.from_dict({"speed": 1})


def test_config_leaves_out_the_default_segmentation_as_earlier_versions_did():
    assert not {"segmentation", "segmentation_parameters"} & Config().as_dict().keys()
    assert Config(segmentation="beats").as_dict()["segmentation"] == "beats"


@given(
    st.dictionaries(
        st.text(max_size=5), st.sets(st.integers(0, 10**6), max_size=5).map(sorted), max_size=4
    )
)
def test_config_cut_frames_are_copied_and_survive_json_and_pickle(clips):
    config = Config(segmentation=clips)
    read = Config.from_dict(json.loads(json.dumps(config.as_dict())))
    assert read == config == pickle.loads(pickle.dumps(config))
    assert hash(read) == hash(config)
    assert {name: list(frames) for name, frames in config.segmentation.items()} == clips
    clips["another"] = [1]
    assert "another" not in config.segmentation
    with pytest.raises(TypeError):
        config.segmentation["another"] = (1,)


def test_config_with_a_function_names_it_and_is_not_read_again():
    document = Config(segmentation=sorted).as_dict()
    assert document["segmentation"] == "function builtins.sorted"
    with pytest.raises(
        ValueError, match=r"was the function builtins\.sorted, and functions are not"
    ):
        Config.from_dict(document)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_config_with_variety_has_a_threshold_that_grows_with_it(one, other):
    low, high = sorted((one, other))
    narrow, wide = Config.with_variety(low), Config.with_variety(high)
    assert 0.3 - 1e-12 <= narrow.sigma_scale <= wide.sigma_scale <= 1.875 + 1e-12
    assert (low == high) or high - low < 1e-9 or narrow.sigma_scale < wide.sigma_scale


def test_config_with_variety_in_the_middle_is_the_default():
    assert Config.with_variety(0.5) == Config()
    assert Config.with_variety(0.5, seam="dead") == Config(seam="dead")


@pytest.mark.parametrize("variety", [-0.1, 1.1, float("nan"), True, "bold", None])
def test_config_invalid_variety_raises_value_error(variety):
    with pytest.raises(ValueError, match="`variety` must be a number from 0 to 1, got"):
        Config.with_variety(variety)


@pytest.mark.parametrize("name", list(variety_fields(0.5)))
def test_config_with_variety_and_a_field_that_it_sets_raises_value_error(name):
    changes = {name: getattr(Config(), name)}
    with pytest.raises(ValueError, match=f"`{name}` must not be given together with `variety`"):
        Config.with_variety(0.5, **changes)
