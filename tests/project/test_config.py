"""Checks of `Config` and its conversion to dictionaries."""

import inspect
import json
import pickle
import re
from dataclasses import dataclass, fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, Library
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.config import CHOICES, STAGES, setting
from mograft.dancer import dance
from mograft.library.derive import BUILD_STAGES
from mograft.library.origin import hash_library
from mograft.search.donor_choice import DONOR_CHOICES
from mograft.search.neighbourhoods import NEIGHBOURHOODS


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"samples": 1}, "`samples` must be a whole number of at least 2, got 1"),
        ({"sigma": "big"}, "`sigma` must be one of"),
        ({"distance_weight": float("inf")}, "`distance_weight` must be finite, got inf"),
        ({"sigma_scale": -1.0}, "`sigma_scale` must be above 0"),
        ({"sigma_scale": "auto"}, "`sigma_scale` must be a number"),
        ({"temperature": 10**400}, r"`temperature` must be at most 10\^300, got a larger number"),
        ({"samples": 10**16}, r"`samples` must be at most 10\^15"),
        ({"min_length": 2.0}, "`max_length` must be at least 4 s, twice `min_length`, got 2"),
        ({"max_angle": float("nan")}, "`max_angle` must be above 0, got nan"),
        ({"seam": "glue"}, "`seam` must be one of .*'offset'.*, got 'glue'"),
        ({"seam_blend": 0}, "seam_blend.* must be (?:above|greater than) 0, got 0"),
        ({"smoothing": "a"}, "`smoothing` must be a number, got 'a'"),
        ({"segmentation": "energi"}, "`segmentation` must be one of .*; did you mean 'energy'"),
        ({"segmentation": [4, 5]}, "`segmentation` must be 'energy', a mapping .*, or a function"),
        ({"segmentation": {3: [4, 5]}}, "`segmentation` must map names of clips to frames, got 3"),
        ({"segmentation": {"a": [5, 4]}}, "for the clip 'a' must be ascending whole numbers"),
        ({"segmentation": {"a": [-1]}}, "for the clip 'a' must be ascending whole numbers"),
        ({"segmentation": {"a": "45"}}, "for the clip 'a' must be ascending whole numbers"),
    ],
)
def test_config_invalid_parameter_raises_value_error(changes, message):
    with pytest.raises(ValueError, match=message):
        Config(**changes)


def test_config_from_dict_inverts_as_dict():
    for config in (Config(), Config.paper(sigma_scale=2.5)):
        assert Config.from_dict(config.as_dict()) == config
    with pytest.raises(ValueError, match="unknown fields of Config: speed"):
        Config.from_dict({"speed": 1})


def test_config_leaves_out_the_default_segmentation_as_earlier_versions_did():
    assert "segmentation" not in Config().as_dict()
    assert Config(segmentation={"a": [5]}).as_dict()["segmentation"] == {"a": [5]}


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
    assert Config.with_variety(0.5, seam="paper") == Config(seam="paper")


@pytest.mark.parametrize("variety", [-0.1, 1.1, float("nan"), True, "bold", None])
def test_config_invalid_variety_raises_value_error(variety):
    with pytest.raises(ValueError, match="`variety` must be a number from 0 to 1, got"):
        Config.with_variety(variety)


def test_config_with_variety_and_a_scale_raises_value_error():
    with pytest.raises(ValueError, match="`sigma_scale` must not be given together with `variety`"):
        Config.with_variety(0.5, sigma_scale=0.75)


@dataclass(frozen=True)
class Extended(Config):
    """`Config` with a new field of each stage."""

    new_segmentation: float = setting("segmentation", 1.0)
    new_embedding: float = setting("embedding", 1.0)
    new_neighbourhood: float = setting("neighbourhood", 1.0)
    new_search: float = setting("search", 1.0)
    new_blend: float = setting("blend", 1.0)


@pytest.mark.parametrize("stage", STAGES)
def test_new_field_of_a_stage_computes_again_what_depends_on_it(stage):
    library = Library.build(dance(strides=1).motion[:200], config=Extended())
    config = replace(library.config, **{f"new_{stage}": 2.0})
    changed = replace(library, config=config)
    assert (hash_library(changed) != hash_library(library)) == (stage in BUILD_STAGES)
    if stage in BUILD_STAGES:
        with pytest.raises(ValueError, match=f"`new_{stage}` must be 1.0, the value with which"):
            library.relabelled(config)
        return
    found = library.relabelled(config)
    assert found.embedding is library.embedding
    assert found.segments is library.segments
    assert (found.labels is not library.labels) == (stage == "neighbourhood")
    assert found.config == config


def test_every_field_of_config_has_a_stage_in_the_order_of_computation():
    by_stage = [Config.fields_of(stage) for stage in STAGES]
    assert sorted(sum(by_stage, ())) == sorted(own.name for own in fields(Config))
    assert "smoothing" in by_stage[0]
    assert "components" in by_stage[1]
    assert by_stage[2] == ("sigma", "sigma_scale")


@pytest.mark.parametrize("name", [name for name in CHOICES if name != "segmentation"])
def test_docstring_and_objects_have_the_words_of_the_annotation(name):
    text = inspect.getdoc(Config).replace("\n", "\n    ")
    (listed,) = re.findall(rf"^    {name} : {{(.*)}}$", text, re.M)
    assert listed == ", ".join(f'"{word}"' for word in CHOICES[name])
    objects = {"choice": DONOR_CHOICES, "neighbourhood": NEIGHBOURHOODS, "seam": SEAM_TREATMENTS}
    assert tuple(objects.get(name, CHOICES[name])) == CHOICES[name]
    for word in CHOICES[name]:
        assert getattr(Config(**{name: word}), name) == word
