"""Checks of `Config` and its conversion to dictionaries."""

import pytest

from mograft import Config


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
    ],
)
def test_config_invalid_parameter_raises_value_error(changes, message):
    with pytest.raises(ValueError, match=message):
        Config(**changes)


def test_config_from_dict_inverts_as_dict():
    for config in (Config(), Config.paper(sigma=2.5)):
        assert Config.from_dict(config.as_dict()) == config
    with pytest.raises(ValueError, match="unknown parameters: speed"):
        Config.from_dict({"speed": 1})
