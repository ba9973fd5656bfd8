"""Experiments, studies and figures, and what the laboratory imports."""

import ast
import fnmatch
import re
import shutil
import tarfile
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_1samp

import mograft
from lab import figures, plots
from lab.__main__ import SECTIONS, main
from lab.baselines.augmentation import N_COPIES, SCHEMES, LabelledClips, swap_sides
from lab.experiments import (
    balance,
    constants,
    editing,
    learning,
    readings,
    run,
    sources,
    tables,
    tradeoff,
    verdicts,
)
from lab.experiments.run import RESULTS, ROOT
from lab.measures.clip_features import clip_features
from lab.studies import compare
from mograft import Config, mirror, rotations
from mograft.dancer import dance
from mograft.evaluation.balance import BalanceSample
from tests.strategies import SEEDS, transform_motion


def test_constants_include_every_default_that_differs_from_the_paper():
    named = {own.name.removeprefix("Config.") for own in constants.CONSTANTS}
    default, paper = Config(), Config.paper()
    # Choices between methods, limits of length and switches are not numbers that were tuned.
    others = {"choice", "seam", "torso", "feet", "self_repair", "keep_heading", "max_length"}
    others |= {"reach_ik", "neighbourhood"}
    names = {own.name for own in fields(Config)}
    differing = {name for name in names if getattr(default, name) != getattr(paper, name)}
    assert differing - others <= named


DATA = ROOT.parent / "shared" / "data"


@pytest.mark.thorough
@pytest.mark.skipif(not (DATA / sources.ARCHIVE).exists(), reason="needs ../shared/data")
def test_sources_of_different_use_share_no_file(tmp_path):
    (tmp_path / "bn").mkdir()
    with tarfile.open(DATA / sources.ARCHIVE) as archive:
        for name in archive.getnames():
            (tmp_path / "bn" / Path(name).name).touch()
    by_use = {own.use: set() for own in sources.SOURCES.values()}
    for own in sources.SOURCES.values():
        by_use[own.use] |= {path.name for path in sources.find_files(own, DATA, tmp_path)}
    by_use["development"] |= {path.name for path in (DATA / "bandai_ds1").glob("*.bvh")}
    development, test, untouched = map(by_use.get, ("development", "test", "untouched"))
    assert min(map(len, by_use.values())) > 10
    assert not untouched & (test | development)
    assert not test & development


def test_every_experiment_writes_its_tables(tmp_path):
    refusals = run.write_tables(run.measure_tiny(), {"salsa A": [1, 2, 3]}, tmp_path)
    written = {path.stem.split("-")[0] for path in tmp_path.glob("*.csv")}
    names = {own.NAME.split("-")[0] for own in [*run.experiments(), *run.studies()]}
    assert written - {"refused"} == names - {name for name, *_ in refusals} | {
        *("sources", "constants", "code")
    }
    for path in tmp_path.glob("*.csv"):
        assert tables.read_csv(path), path.name


def test_stale_results_are_named_and_marked_in_their_figures(tmp_path):
    for path in RESULTS.glob("*.csv"):
        shutil.copy(path, tmp_path)
    every = [*run.experiments(), *run.studies()]
    codes = [(own.NAME, run.version_of(own)) for own in every]
    head = ("experiment", "code")
    tables.write_csv(tables.Table(head, codes), tmp_path / run.CODE)
    assert run.stale_experiments(tmp_path) == set()
    planted = [(name, "0" * 12 if name == "seams" else code) for name, code in codes[1:]]
    tables.write_csv(tables.Table(head, planted), tmp_path / run.CODE)
    assert run.stale_experiments(tmp_path) == {"seams", codes[0][0]}
    marked = {name for name, text in figures.draw_all(tmp_path) if figures.STALE in text}
    assert marked == {"seams", codes[0][0]}


@given(st.floats(-2, 2), st.floats(0, 2), st.floats(0.01, 1))
def test_verdict_is_equal_only_within_the_margin_and_changes_side_with_the_sign(
    value, half, margin
):
    def judge(centre):
        own = {"value": centre, "interval": [centre - half, centre + half]}
        return verdicts.verdict(own, margin)

    assert verdicts.verdict({"value": value, "interval": None}, margin) == "no interval"
    found = judge(value)
    assert (found == "equal") == (abs(value) + half < margin)
    opposite = {"better": "worse", "worse": "better"}
    assert judge(-value) == opposite.get(found, found)
    if found in opposite:
        assert abs(value) > half


def test_at_newness_interpolates_between_settings_only():
    rows = [{"newness": x, "gross": {"value": y}} for x, y in ((4.0, 0.6), (8.0, 0.8))]
    assert tradeoff.at_newness(rows, "gross", 5.0) == pytest.approx(0.65)
    assert tradeoff.at_newness(rows, "gross", 3.0) is tradeoff.at_newness(rows[:1], "gross", 4.0)


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
    assert tables.spread(tables.Table(("source", "angle"), [])) == (["source", "angle"], [])


@given(SEEDS, st.integers(1, 3), st.integers(12, 60))
def test_balance_pair_is_the_mean_over_segments_that_both_exchange(seed, n_runs, n_segments):
    rng = np.random.default_rng(seed)

    def draw():
        states = rng.choice([0.0, 1.0, np.nan], (n_runs + 1, n_segments))
        changed = rng.random((n_runs, n_segments)) < 0.7
        return BalanceSample(states[-1], states[:-1], changed)

    first, second = draw(), draw()
    differences = [
        first.after[run, k] - second.after[run, k]
        for run in range(n_runs)
        for k in range(n_segments)
        if first.changed[run, k] and second.changed[run, k]
    ]
    known = [own for own in differences if not np.isnan(own)]
    found = balance.pair([first], [second])
    assert found.n == len(known)
    assert found.value == pytest.approx(np.mean(known) if known else np.nan, nan_ok=True)
    assert balance.pair([second], [first]).value == pytest.approx(-found.value, nan_ok=True)


def test_readings_euler_angles_of_hinges_have_the_clusters_of_rotation_vectors():
    """Joints that turn about one axis have the same angles in both coordinates."""
    clip = dance(seed=2, strides=1).motion
    turns = rotations.log(clip.rotations)
    turns[..., 1:] = 0.0
    hinged = replace(clip, rotations=rotations.exp(turns), channel_values=None)
    library = mograft.Library.build(hinged, config=Config.paper(sigma="rms"))
    found = readings._with_euler_angles(library)
    for group, labels in library.labels.items():
        other = found.labels[group]
        first, second = (own[:, None] == own for own in (labels, other))
        assert (first & second).sum() > 0.98 * (first | second).sum() > len(labels), group


FEW_TOPICS = ("combinations", "quality", "balance")
ALL_TOPICS = pytest.param(compare.TOPICS, marks=pytest.mark.thorough)
STUDIES = [name for name in SECTIONS if name not in ("experiments", "compare", "figures")]


@pytest.mark.parametrize("name", STUDIES)
def test_study_tiny_run_completes_without_output(name, capsys):
    assert not main([name, "--tiny"])
    assert capsys.readouterr().out == ""


def test_without_a_section_studies_are_measured_once_and_continued(tmp_path, capsys):
    words = ["--only", "pairs", "--quick", "--processes", "1", "--data", str(tmp_path)]
    words += ["--cache", str(tmp_path / "cache"), "-o"]
    tables_of = []
    for name, is_measured in (("first", True), ("second", False)):
        assert not main([*words, str(tmp_path / name)])
        assert ("pairs, power" in capsys.readouterr().err) == is_measured
        tables_of.append(tables.read_csv(tmp_path / name / "pairs-power.csv"))
        (row,) = tables.read_csv(tmp_path / name / "code.csv")
        assert (row["experiment"], len(row["code"])) == ("pairs", 12)
    assert tables_of[0] == tables_of[1]


def test_refused_study_is_listed_with_the_reason(tmp_path):
    results = {"pairs": {"power": {"refused": "too few"}}}
    assert run.write_tables(results, {}, tmp_path) == [("pairs", "power", "too few")]
    assert not (tmp_path / "pairs-power.csv").exists()


@pytest.mark.parametrize("topics", [FEW_TOPICS, ALL_TOPICS], ids=len)
def test_compare_measures_every_topic_and_draws_figures(small_library, topics):
    found, figures = compare.compare(small_library, topics, runs=1 if len(topics) < 4 else 3)
    assert found.keys() == {*topics, "refused"}
    assert set(topics) & {"combinations", "quality", "detectability"} <= figures.keys()


PAGE = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("draw", figures.DRAWN, ids=lambda draw: draw.__name__)
def test_figure_is_small_and_the_same_twice(draw):
    first, second = (plots.as_svg(draw(RESULTS)) for _ in range(2))
    assert first == second
    assert len(first) < 75_000


def test_page_shows_every_figure_and_names_every_experiment():
    shown = re.findall(r"\]\(figures/(\w+)\.svg\)", PAGE)
    assert sorted(shown) == sorted(draw.__name__ for draw in figures.DRAWN)
    named = re.findall(r"`([\w*-]+)\.csv`", PAGE)
    stored = {path.stem for path in RESULTS.glob("*.csv")}
    assert all(fnmatch.filter(stored, name) for name in named)
    studies = {name for name in stored if name.startswith(("segmentations", "behaviours"))}
    found = {name for pattern in named for name in fnmatch.filter(stored, pattern)}
    assert stored - studies - found <= {"refused", "code"}


PUBLIC = ("evaluation", "scenario", "dancer", "clustering", "constraints")
TEXT = (ROOT / "lab" / "README.md").read_text(encoding="utf-8")
LISTED = re.findall(r"^- `(mograft\.[\w.]+)`", TEXT, re.MULTILINE)


def imported_names(folder):
    """Yield the module and the names of each import from a package in the files of a folder."""
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                yield node.module, {alias.name for alias in node.names}
            elif isinstance(node, ast.Import):
                yield from ((alias.name, set()) for alias in node.names)


def test_lab_imports_public_names_and_listed_modules():
    used = set()
    for module, names in imported_names("lab"):
        if module == "mograft":
            assert names <= {*mograft.__all__, "evaluation"}
        elif module.startswith("mograft.") and module.split(".")[1] not in PUBLIC:
            used.add(module)
    assert used == set(LISTED)


def test_product_and_benches_do_not_import_the_lab():
    modules = {m for name in ("python", "python-fbx", "benches") for m, _ in imported_names(name)}
    assert "lab" not in {module.split(".")[0] for module in modules}


@pytest.fixture(scope="module")
def labelled_clips():
    """Eight clips of two dancers: those of one label are slow, those of the other fast."""
    clips = [take.motion for take in dance(seed=3, strides=1).takes(8)]
    return LabelledClips(tuple(clips), np.array(["wave-left-hand", "run"] * 4))


@pytest.mark.parametrize("name", SCHEMES)
def test_scheme_adds_copies_with_their_labels_and_exchanges_keep_the_legs(labelled_clips, name):
    added = SCHEMES[name](labelled_clips, np.random.default_rng(0))
    n = 0 if name == "none" else N_COPIES * len(labelled_clips)
    assert len(added) == len(added.labels) == n
    if name == "mirror and noise":
        assert list(added.labels[: len(labelled_clips)]) == ["wave-right-hand", "run"] * 4
    else:
        assert sorted(added.labels) == sorted([*labelled_clips.labels] * (n // len(labelled_clips)))
    if name.startswith(("CutMix", "grafts")):
        pairs = zip(labelled_clips.clips, labelled_clips.labels, strict=True)
        originals = {clip.rotations[:, 0].tobytes(): (clip, label) for clip, label in pairs}
        changes = []
        for clip, label in zip(added.clips, added.labels, strict=True):
            base, expected = originals[clip.rotations[:, 0].tobytes()]
            assert label == expected
            changes.append(rotations.angle(clip.rotations, base.rotations).max())
        assert np.median(changes) > 0.2


def test_swap_sides_is_an_involution():
    for label in ("walk", "wave-left-hand", "walk-turn-right", "raise-up-both-hands"):
        assert swap_sides(swap_sides(label)) == label
    assert swap_sides("walk-turn-right") == "walk-turn-left"


def test_clip_features_do_not_depend_on_place_and_heading(labelled_clips):
    clip = labelled_clips.clips[0]
    moved = transform_motion(clip, yaw=1.0, offset=(50.0, 0.0, 0.0))
    np.testing.assert_allclose(clip_features(moved), clip_features(clip), atol=1e-6)
    assert np.abs(clip_features(mirror(clip)) - clip_features(clip)).max() > 0.01


def test_run_share_finds_planted_gain_and_no_gain_of_nothing(monkeypatch):
    """Training clips of one class are few and atypical; one scheme adds typical ones."""
    rng = np.random.default_rng(0)

    def draw(n, shift):
        labels = np.array(["a", "b"] * (n // 2))
        rows = (labels == "b")[:, None] + shift + rng.normal(0, 0.6, (n, 6))
        return LabelledClips(tuple(map(tuple, rows)), labels)

    pool, test = draw(200, 0.8), draw(200, 0.0)
    monkeypatch.setattr(learning.clip_features, "clip_features", np.array)
    learning._captured_features.cache_clear()
    schemes = {name: SCHEMES[name] for name in ("none", "repeated")}
    schemes["planted"] = lambda train, own: draw(2 * len(train), 0.0)  # noqa: ARG005
    found = learning.run_share(lambda seed: (pool, test), 0.1, 5, schemes)  # noqa: ARG005
    learning._captured_features.cache_clear()
    assert (found["train"], found["test"]) == (20, 200)
    for scores in found["scores"].values():
        assert learning.differences(scores, "planted")["interval"][0] > 0.05
        assert abs(learning.differences(scores, "none")["value"]) < 0.1
        assert learning.differences(scores, "repeated")["value"] == 0


def test_split_actions_tests_on_one_performer_only(labelled_clips):
    groups = np.array([0, 0, 0, 1, 1, 1, 2, 2])
    for seed in range(6):
        pool, test = learning.split_actions(labelled_clips, groups, seed)
        own = {groups[k] for k, clip in enumerate(labelled_clips.clips) if clip in test.clips}
        assert own == {seed % 3}
        assert len(pool) + len(test) == len(labelled_clips)


def test_mean_estimate_interval_is_students():
    values = np.random.default_rng(0).normal(size=10)
    expected = ttest_1samp(values, 0).confidence_interval(0.95)
    assert learning.mean_estimate(values)["interval"] == pytest.approx([*expected])


def test_editor_learns_planted_arms_and_exposes_wrong_pairs():
    """Arms that are a function of the legs are found; pairs with other arms make the error grow."""
    clips = [take.motion for take in dance(seed=5, strides=2).takes(12)]
    groups = mograft.JointGroups.preset("lower_upper", clips[0].skeleton).groups
    legs, arms = (
        [clips[0].skeleton.index(name) for name in groups[own]] for own in ("lower", "upper")
    )

    def plant(clip, rng=None):
        turns = np.zeros((clip.n_frames, len(arms), 3))
        driver = rotations.log(clip.rotations[:, legs[1]])
        if rng is None:
            turns[:, ::2] = driver[:, None]
        else:
            turns[:, ::2] = rng.normal(0, 0.5, (1, 1, 3))
        quats = clip.rotations.copy()
        quats[:, arms] = rotations.exp(turns)
        return replace(clip, rotations=quats, channel_values=None)

    labelled = LabelledClips(tuple(map(plant, clips)), np.array(["a"] * len(clips)))
    rng = np.random.default_rng(0)

    def mix(train, _):
        wrong = tuple(plant(clip, rng) for clip in train.clips for _ in range(2))
        return LabelledClips(wrong, np.repeat(train.labels, 2))

    pool, test = labelled.choose(range(8)), labelled.choose(range(8, 12))
    schemes = {"none": SCHEMES["none"], "wrong": mix}
    scores = editing.run_draws(pool, test, 6, 2, schemes)["scores"]
    best, wrong, mean = (np.mean(scores[own]) for own in ("none", "wrong", editing.MEAN_POSE))
    assert best < 0.3 * mean
    assert wrong > 1.5 * best
