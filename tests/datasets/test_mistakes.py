"""Mistakes in the calls of data sets are named; those in commands: tests/cli/test_mistakes.py."""

import pytest

from mograft import datasets


@pytest.mark.parametrize(
    ("function", "options", "message"),
    [
        ("augment", {"seconds": 0.0}, "`seconds`"),
        ("augment", {"stride": 0.01}, "`stride` must be at least one frame, got 0.01"),
        ("augment", {"stride": float("nan")}, "`stride`"),
        ("augment", {"min_new": 2.0}, "`min_new`"),
        ("augment", {"features": []}, "`features` must name"),
        ("augment", {"features": ["humanml3d"]}, "needs the 22 joints of SMPL"),
        ("augment", {"split": {"p0*": "a", "p1*": "b"}, "part": "tset"}, "`part` must be one of"),
        ("augment", {"split": "auto:"}, "`split`"),
        ("augment", {"split": "auto:clip:x"}, "`split`"),
        ("augment", {"split": "auto:tag:none*"}, "`split`"),
        ("find", {}, "`query` or `text` is required"),
        ("find", {"text": '"'}, "`text` must be words"),
        ("find", {"query": "p0_100", "part": "arms"}, "`group` must be one of lower, upper"),
        ("find", {"query": "p0_100", "top": 0}, "`top`"),
        ("curate", {"radius": 1.0, "keep": 0.1}, "together with `radius`"),
        ("curate", {"keep": 1.5}, "`keep` must be"),
        ("curate", {"radius": 0.0}, "`radius` must be"),
        ("curate", {"shards": 0}, "`shards` must be"),
    ],
)
def test_wrong_options_are_refused(stored, function, options, message):
    with pytest.raises(ValueError, match=message):
        getattr(datasets, function)(stored, **options)
