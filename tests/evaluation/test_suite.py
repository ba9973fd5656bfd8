"""All measures at once: what is asked for, what is refused, what is written."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from mograft import Config, JointGroups, Library, Motion, Skeleton, read_bvh, write_bvh
from mograft.cli import main
from mograft.dancer import dance
from mograft.evaluation import (
    Analogy,
    ByCost,
    ContactPattern,
    Random,
    evaluate,
    evaluation_page,
    methods,
    naturalness,
    plots,
)
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.naturalness import Difference
from mograft.evaluation.report import order_of, reading
from tests.browser import chromium
from tests.strategies import wander

pytest.importorskip("sklearn", reason="scikit-learn is not installed")
pytest.importorskip("matplotlib", reason="matplotlib is not installed")

WAYS = (Random(), ContactPattern(), Analogy(), ByCost())


@pytest.fixture(autouse=True)
def few_parameters(monkeypatch):
    monkeypatch.setattr(naturalness, "_GRID", {"C": (10.0,), "gamma": (0.03,)})


@pytest.fixture(scope="module")
def library():
    return Library.build([take.motion for take in dance(seed=9, strides=1)[:1000].takes(3)])


@pytest.fixture(scope="module")
def found(library):
    before = naturalness._GRID
    naturalness._GRID = {"C": (10.0,), "gamma": (0.03,)}
    yield evaluate(library, ways=WAYS, runs=2, bases=1, seed=1)
    naturalness._GRID = before


def estimates(value):
    """All numbers with an interval below a place in a document."""
    if isinstance(value, dict):
        if {"value", "interval", "n", "of", "method"} <= value.keys():
            yield value
        for inner in value.values():
            yield from estimates(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from estimates(inner)


def test_every_number_has_its_sample_and_interval(found):
    document = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert document["schema"] == "mograft.evaluation/1"
    numbers = list(estimates(document))
    assert len(numbers) > 100
    for number in numbers:
        assert number["n"] >= 0
        assert number["of"]
        assert number["method"]
        if number["interval"] is not None and number["value"] is not None:
            low, high = number["interval"]
            assert low <= high
    assert document["parameters"]["seed"] == 1
    assert document["parameters"]["config"] == found.library.config.as_dict()
    assert document["body"]["model"] == "de Leva"
    rows = document["balance"]
    assert {row["method"] for row in rows} == {"recording", *(way.name for way in WAYS)}
    assert {(row["kind"], row["rule"]) for row in rows} == {
        (kind, rule) for kind in ("static", "dynamic") for rule in ("all", "majority", "any")
    }
    for row in rows:  # the recording is its own measure
        if row["method"] == "recording":
            assert row["difference_changed"]["value"] == 0


def test_the_same_seed_gives_the_same_document(library, found):
    again = evaluate(library, ["balance", "quality"], ways=WAYS, runs=2, bases=1, seed=1)
    for topic in ("balance", "quality"):
        assert again.as_dict()[topic] == found.as_dict()[topic]
    other = evaluate(library, ["quality"], ways=WAYS[:1], runs=1, bases=1, seed=2)
    assert other.quality[0].seam_gap != found.quality[0].seam_gap


def test_only_what_is_asked_for_is_measured(library):
    few = evaluate(library, ["enrichment"])
    assert few.counted is not None
    assert (few.balance, few.quality, few.naturalness) == ((), (), ())
    some = evaluate(library, ["balance"], ways=WAYS[:1], runs=1, bases=1)
    assert some.counted is None
    assert some.balance
    assert not some.quality
    for wrong in ([], ["beauty"]):
        with pytest.raises(ValueError, match="topics must be of"):
            evaluate(library, wrong)
    with pytest.raises(ValueError, match="runs must be 1"):
        evaluate(library, runs=0)


def pole_library():
    skeleton = Skeleton(["a", "b", "c"], [-1, 0, 1], [[0, 0, 0], [0, 1, 0], [0, 1, 0]])
    quats = wander(np.random.default_rng(0), 300, 3)
    motion = Motion(skeleton, 1 / 30, quats, np.tile(skeleton.offsets, (300, 1, 1)), name="pole")
    return Library.build(motion, JointGroups({"lower": ["a"], "upper": ["b", "c"]}), Config())


def test_what_is_no_body_is_refused_in_words_and_measured_where_it_can_be():
    poles = pole_library()
    own = evaluate(poles, runs=1)
    assert "no leg" in own.refused["balance"]
    assert own.balance == ()
    assert [row.method for row in own.quality] == [way.name for way in methods(poles)]
    assert "contact pattern" not in {row.method for row in own.quality}
    assert own.quality[0].foot_skate.n == 0
    assert own.quality[0].coordination.n == 0
    told = " ".join(reading(own))
    assert "Refused, balance" in told
    page = evaluation_page(own)
    assert "no leg" in page.html
    assert json.dumps(own.as_dict(), allow_nan=False)


def test_too_few_segments_are_refused_in_words():
    own = evaluate(Library.build(dance(seed=1, strides=1).motion[:250]), runs=1)
    assert "60 segments" in own.refused["naturalness of upper"]
    assert own.naturalness == ()
    assert own.balance


def test_the_page_tells_all_and_runs_nothing(found):
    page = evaluation_page(found, "A <b>bold</b> title")
    assert "<h1>A &lt;b&gt;bold&lt;/b&gt; title</h1>" in page.html
    for way in WAYS:
        assert way.name in page.html
    for heading in ("Balance", "Quality", "Enrichment", "In words"):
        assert f"<h2>{heading}</h2>" in page.html
    assert page.html.count("<img") >= 3
    assert re.search(r"<script[^>]*></script>", page.html)  # empty
    assert not re.search(r"\bnan\b", page.html)


def test_the_order_is_read_off_the_intervals():
    def with_gap(first, second, value, low, high):
        return Difference(first, second, Estimate(value, low, high, 40, "x", "y"))

    class Compared:
        def __init__(self, *gaps):
            self.gaps = gaps

        def difference(self, first, second):
            for own in self.gaps:
                if (own.first, own.second) == (first, second):
                    return own
            raise KeyError(first)

    above = with_gap("analogy", "contact pattern", 0.4, 0.1, 0.6)
    unsure = with_gap("contact pattern", "random", 0.1, -0.1, 0.3)
    below = with_gap("contact pattern", "random", -0.4, -0.5, -0.3)
    first, second = order_of(Compared(above, unsure))
    assert "above, outside" in first
    assert "undecided" in second
    assert "against the order" in order_of(Compared(above, below))[1]
    assert "not both compared" in order_of(Compared(above))[1]
    none = with_gap("analogy", "random", 0.1, float("nan"), float("nan"))
    assert none.verdict == "undecided"


def test_plots_are_the_same_every_time_and_small(found):
    several = [plots.as_svg(plots.draw_quality(found.quality)) for _ in range(2)]
    assert several[0] == several[1]
    assert len(several[0]) < 60_000
    counts = plots.as_svg(plots.draw_counts({"x": found.swept}, {2: [4.2]}))
    assert counts.count("K = ") == 4


def test_a_graft_that_is_another_length_of_time_keeps_its_ground(library):
    # Feet that were moved, where the base group holds no legs, stand on ground of their own.
    names = library.clips[0].skeleton.names
    upper = [n for n in names if "Leg" not in n and "Foot" not in n and n != "Hips"]
    lower = [n for n in names if n not in upper]
    groups = JointGroups({"upper": upper, "lower": lower}, base="upper")
    turned = Library.build(library.clips, groups)
    own = evaluate(turned, ["balance"], ways=(ByCost(),), runs=1, bases=1)
    assert {row.method for row in own.balance} == {"recording", "analogy, by cost"}


@pytest.fixture
def files(tmp_path, library):
    paths = [tmp_path / f"{clip.name}.bvh" for clip in library.clips[:2]]
    for clip, path in zip(library.clips, paths, strict=False):
        write_bvh(clip, path)
    return [str(path) for path in paths]


def test_the_command_writes_numbers_and_a_page(files, tmp_path, capsys):
    out = tmp_path / "report"
    command = ["evaluate", *files, "quality", "enrichment", "--runs", "1", "--bases", "1"]
    assert main([*command, "-o", str(out)]) == 0
    told = capsys.readouterr()
    assert told.out.split() == [str(out / "evaluation.json"), str(out / "index.html")]
    assert "combine to" in told.err
    document = json.loads((out / "evaluation.json").read_text())
    assert {"quality", "enrichment"} <= document.keys()
    assert "balance" not in document
    counts = ["evaluate", *files, "enrichment"]
    assert main([*counts, "-o", str(out)]) == 1
    assert "--force overwrites" in capsys.readouterr().err
    assert json.loads((out / "evaluation.json").read_text()) == document
    several = []
    for _ in range(2):
        assert main([*counts, "-o", str(out), "--force"]) == 0
        several.append([path.read_bytes() for path in sorted(out.iterdir())])
    assert several[0] == several[1]
    capsys.readouterr()
    assert main([*counts, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(several[0][0])


def test_a_library_says_what_its_files_say(files, tmp_path, capsys):
    Library.index(files, tmp_path / "lib")
    asked = ["quality", "enrichment", "--runs", "1", "--bases", "1", "--json"]
    documents = []
    for what in (files, [str(tmp_path / "lib")]):
        assert main(["evaluate", *what, *asked]) == 0
        documents.append(json.loads(capsys.readouterr().out))
    assert documents[0] == documents[1]
    for option in (["--rate", "15"], ["--groups", "lower_upper"], ["--preset", "paper"]):
        with pytest.raises(SystemExit, match="2"):
            main(["evaluate", str(tmp_path / "lib"), *option])
        assert "is fixed when a library is created" in capsys.readouterr().err


def test_labels_go_the_whole_way(files, tmp_path, capsys):
    page = tmp_path / "label.html"
    assert main(["evaluate", "label", *files, "-n", "120", "-o", str(page)]) == 0
    assert capsys.readouterr().out.split() == [str(page)]
    shown = json.loads(
        re.search(r'id="mograft-data">(.*?)</script>', page.read_text(), re.DOTALL).group(1)
    )
    rng = np.random.default_rng(0)
    lines = [",".join([*shown["columns"], "label", "seconds"])]
    for item in shown["items"]:
        label = "natural" if rng.random() < 0.5 else "unnatural"
        lines.append(",".join([*item["row"], label, "1.0"]))
    labels = tmp_path / "labels.csv"
    labels.write_text("\n".join(lines) + "\n")
    command = ["evaluate", "naturalness", *files, "--labels", str(labels), "--json"]
    assert main(command) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["people"]["learned"] + document["people"]["tested"] == 120
    # The labels of another cut are no labels of this one.
    assert main([*command, "--rate", "15"]) == 1
    assert "has no segment" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["enrichment"], 2, "expected one library or at least one BVH file"),
        (["label", "quality", "FILE"], 2, "label cannot be combined with enrichment"),
        (["label", "FILE"], 2, "an .html file with label"),
        (["label", "FILE", "-o", "x.txt"], 2, "an .html file with label"),
        (["FILE", "--rate", "0"], 2, "--rate: must be a number above 0"),
        (["FILE", "--runs", "0"], 2, "--runs: must be an integer of at least 1"),
        (["missing.bvh"], 1, "missing.bvh"),
        (["FILE", "--labels", "missing.csv"], 1, "missing.csv"),
        (["FILE", "--groups", "wings"], 2, "wings"),
    ],
)
def test_wrong_words_are_told(files, capsys, words, code, told):
    arguments = ["evaluate", *(files[0] if word == "FILE" else word for word in words)]
    try:
        found = main(arguments)
    except SystemExit as stop:
        found = stop.code
    assert found == code
    assert told in capsys.readouterr().err


def test_a_file_that_is_named_as_a_topic_is_a_file(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_bvh(read_bvh(files[0]), tmp_path / "quality")
    assert main(["evaluate", "quality", "enrichment", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert "quality" not in document
    assert document["library"]["segments"] > 0


def test_a_missing_package_is_named_with_its_extra(files, monkeypatch, capsys):
    from mograft.evaluation import _extra

    def absent(name):
        raise ImportError(name, name=name)

    monkeypatch.setattr(_extra, "import_module", absent)
    monkeypatch.setattr(naturalness, "FEWEST", 10)
    assert main(["evaluate", "naturalness", *files, "--json"]) == 1
    assert "scikit-learn: pip install 'mograft[evaluate]'" in capsys.readouterr().err


def test_flight_is_left_out_and_counted(library):
    # All is in the air but for a moment: no number without meaning.
    clip = library.clips[0]
    places = clip.positions.copy()
    places[30:, 0, 1] += 500.0
    jumping = replace(clip, positions=places, channel_values=None)
    with pytest.warns(UserWarning, match="jump"):
        own = evaluate(Library.build(jumping), ["balance"], ways=(ByCost(),), runs=1)
    rows = {row.method: row for row in own.balance if row.rule == "all"}
    assert rows["recording"].flight > 0.5
    assert rows["recording"].rate.n < len(own.library.segments)


@pytest.mark.browser
def test_the_page_shows_its_plots(found, tmp_path):
    path = evaluation_page(found).save(tmp_path / "page.html")
    said = []
    with chromium() as browser:
        page = browser.new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(path.as_uri())
        widths = page.evaluate("[...document.images].map((i) => i.naturalWidth)")
        page.close()
    assert len(widths) >= 3
    assert min(widths) > 100
    assert said == []
