"""The experiments: constants, stored results, tables."""

from dataclasses import fields
from functools import partial

import pytest

from lab.experiments import cache, constants, run, sources, tables
from mograft import Config


def test_constants_include_every_default_that_differs_from_the_paper():
    named = {own.name.removeprefix("Config.") for own in constants.CONSTANTS}
    default, paper = Config(), Config.paper()
    # Choices between methods, limits of length and switches are not numbers that were tuned.
    others = {"choice", "seam", "torso", "feet", "self_repair", "keep_heading", "max_length"}
    others |= {"reach_ik", "neighbourhood"}
    differing = {
        own.name for own in fields(Config) if getattr(default, own.name) != getattr(paper, own.name)
    }
    assert differing - others <= named


def test_constants_chosen_on_a_source_make_it_a_development_source():
    for source in map(sources.SOURCES.get, sources.TEST):
        assert not source.pattern.startswith(("dance_", "database_", "paper_shape", "bandai_ds1"))
        # The development clips of set 1 are in the normal style.
        assert "dataset-1_*_normal" not in source.pattern


def test_cache_returns_what_was_written_for_the_same_version_only(tmp_path):
    store, value = cache.Cache(tmp_path), {"value": [1.5, None]}
    store.write("retrieval", "salsa A", "aa-11-full", value)
    read = partial(store.read, "retrieval", "salsa A")
    assert read("aa-11-full") == read("bb-11-full", is_any_version=True) == value
    assert read("bb-11-full") is read("bb-22-full", is_any_version=True) is None
    assert store.read("retrieval", "salsa B", "aa-11-full") is None


def test_input_version_depends_on_contents(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_text("one")
    first = cache.input_version([path])
    path.write_text("two")
    assert cache.input_version([path]) != first


def test_every_experiment_writes_its_tables(tmp_path):
    refusals = run.write_tables(run.measure_tiny(), {"salsa A": [1, 2, 3]}, tmp_path)
    written = {path.stem.split("-")[0] for path in tmp_path.glob("*.csv")}
    names = {own.NAME.split("-")[0] for own in run.experiments()}
    assert written == names - {name for name, *_ in refusals} | {"sources", "constants", "refused"}
    for path in tmp_path.glob("*.csv"):
        assert tables.read_csv(path), path.name


def test_spread_divides_estimates_into_columns(tmp_path):
    angle = tables.format_estimate({"value": 1.5, "interval": [1.0, 2.0], "n": 7}, 1)
    none = tables.format_estimate({"value": None, "interval": None, "n": 7})
    rows = [("a", angle, "80 (70 to 90), n = 3 (40 %)"), ("b", none, none)]
    table = tables.Table(("source", "angle", "share"), rows)
    tables.write_csv(table, tmp_path / "x" / "y.csv")
    first, second = tables.read_csv(tmp_path / "x" / "y.csv")
    assert first == {
        **{"source": "a", "angle": "1.5", "angle low": "1.0", "angle high": "2.0", "angle n": "7"},
        **{"share": "80", "share low": "70", "share high": "90", "share n": "3"},
        "share share": "40",
    }
    assert set(second.values()) == {"b", ""}


@pytest.mark.thorough
def test_quick_run_writes_tables_of_recordings(tmp_path):
    data = run.ROOT.parent / "shared" / "data"
    if not data.is_dir():
        pytest.skip(f"the recordings are not at hand in {data}")
    arguments = ["--quick", "--cache", str(tmp_path / "cache"), "--data", str(data)]
    arguments += ["--sources", "salsa A", "stage", "slow walks", "-o", str(tmp_path / "tables")]
    run.main(arguments)
    assert len(list((tmp_path / "tables").glob("*.csv"))) > 15
