"""Evaluation of a library: topics, refusals, the JSON document and `mograft evaluate`."""

import json
import re

import numpy as np
import pytest

import mograft as mg
from lab.donors.methods import ByCost
from mograft import Library, read_bvh, write_bvh
from mograft._util import extras
from mograft.dancer import dance
from mograft.evaluation import (
    RandomLength,
    detectability,
    evaluate,
    novelty,
    quality,
    world_quality,
)
from mograft.viewing.evaluation_report import evaluation_page, summarize
from tests.strategies import smooth_rotations

pytest.importorskip("sklearn", reason="scikit-learn is not installed")

METHODS = (RandomLength(), ByCost())


def find_estimates(value):
    """Yield all dicts of estimates in a JSON document."""
    if isinstance(value, dict):
        if {"value", "interval", "n", "of", "method"} <= value.keys():
            yield value
        for inner in value.values():
            yield from find_estimates(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from find_estimates(inner)


def test_as_dict_all_estimates_have_sample_size_and_interval(evaluation):
    document = json.loads(json.dumps(evaluation.as_dict(), allow_nan=False))
    assert document["schema"] == "mograft.evaluation/1"
    estimates = list(find_estimates(document))
    assert len(estimates) > 50
    for found in estimates:
        assert found["n"] >= 0
        assert found["of"]
        assert found["method"]
        if found["interval"] is not None and found["value"] is not None:
            low, high = found["interval"]
            assert low <= high


def test_as_dict_balance_has_rows_of_all_methods_and_kinds(evaluation):
    rows = evaluation.as_dict()["balance"]
    assert {row["method"] for row in rows} == {"recording", *(m.name for m in METHODS)}
    assert {row["kind"] for row in rows} == {"static", "dynamic"}
    for row in rows:
        if row["method"] == "recording":
            assert row["difference_changed"]["value"] == 0


def test_evaluate_without_methods_measures_the_grafts_of_graft_many(small_library):
    found = evaluate(small_library, ["quality"], runs=2, bases=1)
    grafts = list(mg.graft_many(small_library, small_library.names[0], 2))
    assert found.quality == (quality("grafts", [grafts]),)
    assert found.parameters["ways"] == ["grafts"]


@pytest.mark.parametrize(
    "measure", [quality, world_quality, detectability, lambda _, grafts: novelty(grafts)]
)
@pytest.mark.parametrize("grafts", [[], [[]]])
def test_measures_without_grafts_raise_insufficient_data_error(measure, grafts):
    with pytest.raises(mg.InsufficientDataError, match="at least one graft"):
        measure("x", grafts)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"topics": []}, "`topics` must be among"),
        ({"topics": ["beauty"]}, "`topics` must be among"),
        ({"runs": 0}, "`runs` must be a whole number of at least 1"),
        ({"bases": 0}, "`bases` must be a whole number of at least 1"),
    ],
)
def test_evaluate_invalid_argument_raises_value_error(small_library, arguments, message):
    with pytest.raises(ValueError, match=message):
        evaluate(small_library, **arguments)


def test_evaluate_skeleton_without_legs_omits_measures_of_feet():
    skeleton = mg.Skeleton(["a", "b", "c"], [-1, 0, 1], [[0, 0, 0], [0, 1, 0], [0, 1, 0]])
    quats = smooth_rotations(np.random.default_rng(0), 300, 3)
    motion = mg.Motion(skeleton, 1 / 30, quats, np.tile(skeleton.offsets, (300, 1, 1)), name="pole")
    poles = Library.build(
        motion, mg.JointGroups({"lower": ["a"], "upper": ["b", "c"]}), mg.Config()
    )
    found = evaluate(poles, runs=1)
    assert "no leg" in found.refusals["balance"]
    assert found.balance == ()
    assert "Not measured, balance" in " ".join(summarize(found))
    assert "no leg" in evaluation_page(found).html
    assert json.dumps(found.as_dict(), allow_nan=False)


def test_evaluate_few_windows_refuses_detectability_only():
    found = evaluate(Library.build(dance(seed=1, strides=1).motion[:250]), runs=1)
    assert "windows" in found.refusals["detectability"]
    assert found.detectability == ()
    assert found.balance


def test_evaluation_page_has_all_sections_and_no_script(evaluation):
    page = evaluation_page(evaluation, "A <b>bold</b> title")
    assert "<h1>A &lt;b&gt;bold&lt;/b&gt; title</h1>" in page.html
    for method in evaluation.parameters["ways"]:
        assert method in page.html
    for heading in ("Summary", "Quality", "World space", "Detectability", "Balance"):
        assert f"<h2>{heading}</h2>" in page.html
    assert re.findall(r"<script[^>]*>(.*?)</script>", page.html, re.DOTALL) == [""]
    assert not re.search(r"\bnan\b", page.html)


@pytest.fixture
def files(tmp_path, small_library):
    paths = [tmp_path / f"{clip.name}.bvh" for clip in small_library.clips[:2]]
    for clip, path in zip(small_library.clips, paths, strict=False):
        write_bvh(clip, path)
    return [str(path) for path in paths]


def test_command_with_output_writes_document_and_page(files, tmp_path, succeed, fail):
    out = tmp_path / "report"
    command = ["evaluate", *files, "quality", "balance", "--runs", 1, "--bases", 1]
    written, told = succeed(*command, "-o", out)
    assert written.split() == [str(out / "evaluation.json"), str(out / "index.html")]
    assert "are exchanged" in told
    document = json.loads((out / "evaluation.json").read_text())
    assert {"quality", "balance"} <= document.keys()
    assert "world" not in document
    counts = ["evaluate", *files, "balance", "--runs", 1]
    assert "use --force to overwrite" in fail(1, *counts, "-o", out)
    assert json.loads((out / "evaluation.json").read_text()) == document
    written = []
    for _ in range(2):
        succeed(*counts, "-o", out, "--force")
        written.append([path.read_bytes() for path in sorted(out.iterdir())])
    assert written[0] == written[1]
    Library.index(files, tmp_path / "lib")
    printed, _ = succeed("evaluate", tmp_path / "lib", "balance", "--runs", 1, "--json")
    assert json.loads(printed) == json.loads(written[0][0])


def test_command_rate_resamples_the_motions_as_the_api_does(files, succeed):
    library = Library.build(read_bvh(files[0]).resample(20.0))
    expected = evaluate(library, ["balance"], runs=1)
    out, told = succeed("evaluate", files[0], "balance", "--runs", 1, "--rate", 20, "--json")
    assert "resampled" not in told
    found, wanted = json.loads(out), json.loads(json.dumps(expected.as_dict()))
    assert found["balance"] == wanted["balance"]
    assert found["library"]["rate"] == wanted["library"]["rate"]


def test_command_file_named_like_topic_is_read_as_file(files, tmp_path, monkeypatch, succeed):
    monkeypatch.chdir(tmp_path)
    write_bvh(read_bvh(files[0]), tmp_path / "quality")
    document = json.loads(succeed("evaluate", "quality", "balance", "--json")[0])
    assert "quality" not in document
    assert document["library"]["segments"] > 0


def test_command_missing_package_names_extra(files, monkeypatch, fail):
    def raise_import_error(name):
        raise ImportError(name, name=name)

    monkeypatch.setattr(extras, "import_module", raise_import_error)
    told = fail(1, "evaluate", "world", *files, "--runs", 1, "--json")
    assert "SciPy: pip install 'mograft[evaluate]'" in told
