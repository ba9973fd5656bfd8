"""The page of experiments: its constants, its stored results and its text."""

import re
from dataclasses import fields

import pytest

from mograft import Config
from mograft.search.neighbourhoods import BALL_RADIUS
from tests.project.test_benches import ROOT, import_bench

pytest.importorskip("sklearn", reason="scikit-learn is not installed")

cache = import_bench("evidence.cache")
constants = import_bench("evidence.constants")
page = import_bench("evidence.page")
section = import_bench("evidence.section")
sources = import_bench("evidence.sources")


def test_constants_equal_those_of_the_program():
    frozen = {own.name: own.value for own in constants.CONSTANTS}
    expected = {
        "Config.sigma": "rms",
        "Config.sigma_scale": 0.75,
        "Config.novelty": 10.0,
        "Config.temperature": 0.25,
        "Config.diversity": 1.0,
        "Config.distance_weight": 0.25,
        "Config.balance_weight": 30.0,
    }
    assert expected.items() <= frozen.items()
    assert frozen["radius of a ball (BALL_RADIUS)"] == BALL_RADIUS == 0.65


def test_constants_include_every_default_that_differs_from_the_paper():
    named = {own.name.removeprefix("Config.") for own in constants.CONSTANTS}
    default, paper = Config(), Config.paper()
    # Choices between methods, limits of length and switches are not numbers that were tuned.
    others = {"choice", "seam", "torso", "feet", "self_repair", "keep_heading", "max_length"}
    others |= {"reach_ik"}
    differing = {
        own.name for own in fields(Config) if getattr(default, own.name) != getattr(paper, own.name)
    }
    assert differing - others <= named


def test_constants_chosen_on_a_source_make_it_a_development_source():
    tested = [sources.SOURCES[name] for name in sources.TEST]
    for source in tested:
        assert not source.pattern.startswith(("dance_", "database_", "paper_shape", "bandai_ds1"))
        # The development clips of set 1 are in the normal style.
        assert "dataset-1_*_normal" not in source.pattern


def test_cache_returns_what_was_written_for_the_same_version_only(tmp_path):
    store = cache.Cache(tmp_path)
    store.write("retrieval", "salsa A", "aa-11-full", {"value": [1.5, None]})
    assert store.read("retrieval", "salsa A", "aa-11-full") == {"value": [1.5, None]}
    assert store.read("retrieval", "salsa A", "bb-11-full") is None
    assert store.read("retrieval", "salsa B", "aa-11-full") is None
    found = store.read("retrieval", "salsa A", "bb-11-full", is_any_version=True)
    assert found == {"value": [1.5, None]}
    assert store.read("retrieval", "salsa A", "bb-22-full", is_any_version=True) is None


def test_cache_not_a_number_raises_value_error(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        cache.Cache(tmp_path).write("x", "y", "z", {"value": float("nan")})
    assert not list(tmp_path.glob("*.json"))


def test_input_version_depends_on_contents(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_text("one")
    first = cache.input_version([path])
    path.write_text("two")
    assert cache.input_version([path]) != first


@pytest.mark.parametrize(
    ("interval", "expected"),
    [([0.1, 0.4], "above"), ([-0.4, -0.1], "below"), ([-0.1, 0.4], "undecided")],
)
def test_verdict_is_position_of_interval(interval, expected):
    assert section.verdict({"value": 0.2, "interval": interval, "n": 3}) == expected


def test_verdict_without_interval_is_undecided():
    assert section.verdict({"value": 0.2, "interval": None, "n": 3}) == "undecided"


def test_format_estimate_states_interval_and_n():
    estimate = {"value": 0.25, "interval": [0.2, 0.3], "n": 7}
    assert section.format_estimate(estimate, 0, 100, " %") == "25 % (20 to 30), n = 7"
    assert section.format_estimate({**estimate, "value": None}) == "-"


@pytest.mark.skipif(not (ROOT / "docs" / "evidence.md").exists(), reason="the page is not written")
def test_page_has_all_sections_in_order():
    text = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## (.+)$", text, re.MULTILINE)
    anchors = [heading.lower().replace(" ", "-") for heading in headings]
    assert anchors[1:] == [experiment.NAME for experiment in page.experiments()]


@pytest.mark.skipif(not (ROOT / "docs" / "evidence.md").exists(), reason="the page is not written")
def test_page_limits_are_statements_that_do_not_follow():
    text = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
    found = re.findall(r"^\*\*What we do not conclude\.\*\*\n\n((?:- .+\n)+)", text, re.MULTILINE)
    assert len(found) == len(page.experiments())
    assert all(line.startswith("- That ") for own in found for line in own.splitlines())


def test_sources_that_a_section_lacks_are_named():
    experiment = next(own for own in page.experiments() if own.NAME == "counts")
    text = " ".join(page.list_left_out(experiment))
    assert {name for name in sources.SOURCES if name in text} == set(sources.SOURCES) - set(
        experiment.SOURCES
    )


def test_counts_name_the_rows_whose_ranges_contain_the_numbers_of_the_paper():
    counts = import_bench("evidence.counts")
    narrow, wide = [[0.0] * 4] * 40, [[0.0] * 4] * 20 + [[1e9] * 4] * 20
    rows = {
        f"{sigma} {scale:g} {kind}": wide if (sigma, kind) == ("literal", "unfiltered") else narrow
        for sigma, scale in (("literal", 1.0), ("rms", 1.0), ("rms", 0.75))
        for kind in ("unfiltered", "filtered")
    }
    results = {"x": {**rows, "segments": [[900]] * 40}, "y": {"segments": [[200]]}}
    (text,) = counts._covering_conclusion(results)
    assert "x 0 of 8." in text
    assert "1 of 6 (`x`, eq. 14 literal, factor 1, no length limit)" in text


def test_experiments_have_known_sources():
    for experiment in page.experiments():
        assert set(experiment.SOURCES) <= set(sources.SOURCES), experiment.NAME


@pytest.mark.thorough
def test_quick_run_writes_every_section(tmp_path, capsys):
    data = ROOT.parent / "shared" / "data"
    if not data.is_dir():
        pytest.skip(f"the recordings are not at hand in {data}")
    arguments = ["--quick", "--cache", str(tmp_path), "--data", str(data)]
    arguments += ["--sources", "salsa A", "stage", "slow walks"]
    experiments = import_bench("experiments")
    experiments.main(arguments)
    text = capsys.readouterr().out
    for experiment in page.experiments():
        heading = experiment.NAME.replace("-", " ").capitalize()
        assert f"## {heading}" in text or "Not measured" in text, experiment.NAME
    experiments.main([*arguments, "--stored"])
    assert capsys.readouterr().out == text


@pytest.mark.parametrize(
    ("lows", "expected"),
    [
        ((0.1, 0.2, -0.1), "2 of 3 sources, worse in 0, and undecided in 1."),
        ((-0.5, -0.4, -0.1), "0 of 3 sources, worse in 2 (s0, s1), and undecided in 1."),
        ((0.1, -0.5), "1 of 2 sources, worse in 1 (s1), and undecided in 0."),
        ((-0.1, -0.1), "0 of 2 sources, worse in 0, and undecided in 2."),
    ],
)
def test_plain_reading_counts_intervals_beside_zero(lows, expected):
    estimates = {
        f"s{i}": {"value": 0.0, "interval": [low, low + 0.2], "n": 9} for i, low in enumerate(lows)
    }
    assert section.plain_reading("a", "b", estimates) == f"a is better than b in {expected}"
