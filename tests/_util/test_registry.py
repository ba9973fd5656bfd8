"""Properties of registries, and of the options that `Config` and the command line share."""

import inspect
import re
import typing

import pytest

from mograft import Config
from mograft._util.registry import CONFIG_OPTIONS, Registry


@pytest.mark.parametrize("value", ["ofset", "", None, 3, ["offset"]])
def test_registry_unknown_value_raises_value_error_listing_accepted_values(value):
    with pytest.raises(ValueError, match=r"^`seam` must be one of 'offset', 'paper', got "):
        Registry("seam", {"offset": 1, "paper": 2}).get(value)


def test_registry_close_value_is_suggested():
    with pytest.raises(ValueError, match=r"got 'vitterbi'; did you mean 'viterbi'\?$"):
        Config(choice="vitterbi")


def test_registry_implementations_keep_the_declared_order():
    declared = Registry("seam", {"offset": "a", "paper": "b"})
    assert list(declared.implemented_by({"paper": 2, "offset": 1}).entries.items()) == [
        ("offset", 1),
        ("paper", 2),
    ]
    with pytest.raises(ValueError, match="`seam` needs implementations of offset, paper, got pap"):
        declared.implemented_by({"paper": 2})


# These are extended by a module and a registry line alone: their annotation is any string.
_OPEN = ("seam", "segmentation")


@pytest.mark.parametrize("parameter", [name for name in CONFIG_OPTIONS if name not in _OPEN])
def test_config_annotation_and_docstring_list_the_registered_values(parameter):
    names = CONFIG_OPTIONS[parameter].names
    assert typing.get_args(typing.get_type_hints(Config)[parameter]) == names
    (listed,) = re.findall(
        rf"^    {parameter} : {{(.*)}}$", inspect.getdoc(Config).replace("\n", "\n    "), re.M
    )
    assert listed == ", ".join(f'"{name}"' for name in names)


@pytest.mark.parametrize("parameter", list(CONFIG_OPTIONS))
def test_config_accepts_all_registered_values(parameter):
    for name in CONFIG_OPTIONS[parameter].names:
        assert getattr(Config(**{parameter: name}), parameter) == name
