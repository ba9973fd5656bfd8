"""The study in which people compare motions, with simulated participants."""

import json
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import mograft as mg
from lab.common import tiny_motion
from lab.experiments.run import RESULTS
from lab.experiments.sources import Recordings
from lab.experiments.tables import read_csv
from lab.pairs import raters
from lab.pairs.__main__ import main
from lab.pairs.analysis import count_judgements, krippendorff_alpha, prefer, read_results
from lab.pairs.excerpts import ARMS, CAPTURED, CHECK, MIN_EXCHANGED, TARGET, find_excerpts
from lab.pairs.study import build_study, sign
from mograft.viewing.geometry import DrawnSkeleton
from tests.browser import chromium, open_page

N_PAIRS, N_CHECKS = 6, 2
RECORDINGS = [Recordings("tiny", (tiny_motion(), tiny_motion(2)))]


@pytest.fixture(scope="module")
def excerpts():
    return find_excerpts(RECORDINGS, N_PAIRS, seconds=1.0, n_checks=N_CHECKS)


@pytest.fixture(scope="module")
def study(excerpts):
    return build_study(excerpts, ARMS, "<A & B>", secret="secret")


@pytest.fixture(scope="module")
def large_key(excerpts):
    """Return the key of a study of the size of the real one."""
    return build_study(excerpts * 10, ARMS, "A", secret="secret")[1]


def test_excerpts_keep_legs_of_capture_and_exchange_the_upper_body(excerpts):
    assert len(excerpts) == N_PAIRS
    assert len({(own.clip, own.start) for own in excerpts}) == N_PAIRS
    library = RECORDINGS[0].library
    legs, arms = library.joints("lower"), library.joints("upper")
    for own in excerpts:
        captured = own.motions[CAPTURED].rotations
        for name in (TARGET, "random, same segments"):
            turns = own.motions[name].rotations
            assert_array_equal(turns[:, legs], captured[:, legs])
            is_changed = (mg.rotations.angle(turns, captured)[:, arms] > 0.01).any(axis=1)
            assert is_changed.mean() >= MIN_EXCHANGED - 0.1
    assert [CHECK in own.motions for own in excerpts] == [True] * 2 + [False] * 4


def test_excerpts_have_height_one_and_stand_on_the_floor(excerpts):
    clips = {own.name: own for own in RECORDINGS[0].library.clips}
    for own in excerpts:
        captured = clips[own.clip][own.start :][: own.motions[TARGET].n_frames]
        wanted, found = map(DrawnSkeleton.of, (captured, own.motions[CAPTURED]))
        assert_allclose((found.height, found.floor), (1, 0), atol=1e-9)
        expected = (wanted.positions - [0, wanted.floor, 0]) / wanted.height
        assert_allclose(found.positions, expected, atol=1e-9)


def test_find_excerpts_raises_error_without_enough_of_them():
    with pytest.raises(mg.InsufficientDataError, match=r"900 excerpts of 1 s .* recordings have"):
        find_excerpts(RECORDINGS, 900, seconds=1.0)


def test_every_set_shows_each_excerpt_once_and_all_sets_each_arm(study):
    _, key = study
    shown = [[key["items"][i] for i in own] for own in key["sets"]]
    for items in shown:
        assert sorted(own["excerpt"] for own in items if own["arm"] != CHECK) == list(range(6))
        assert sum(own["arm"] == CHECK for own in items) == N_CHECKS
        assert {own["arm"] for own in items} == {*ARMS, CHECK}
    pairs = {(own["excerpt"], own["arm"]) for items in shown for own in items}
    assert len(pairs) == 3 * N_PAIRS + N_CHECKS


def test_page_does_not_reveal_what_the_motions_are(study, excerpts):
    page, key = study
    texts = page.html.split('<script type="application/json" id="')[1:]
    data = dict(own.split("</script>")[0].split('">', 1) for own in texts)
    shown = json.loads(data["study-data"])
    assert shown.keys() == {"format", "study", "secret", "sets", "items", "milliseconds"}
    assert all(first < second for first, second in shown["items"])
    targets = [own["target"] < own["other"] for own in key["items"]]
    assert 0.2 < np.mean(targets) < 0.8
    clips = json.loads(data["mograft-data"])["clips"]
    assert {(own["name"], own["note"], len(own["rows"])) for own in clips} == {("", "", 0)}
    assert not any(own.clip in "".join(data.values()) for own in excerpts)
    assert "&lt;A &amp; B&gt;" in page.html


def simulate(key, share, seed, n_raters=12):
    """Return the preferences of simulated participants, who have one preference in all arms."""
    rng = np.random.default_rng(seed)
    shares = dict.fromkeys(key["arms"], share)
    results = raters.simulate_results(key, shares, n_raters, rng)
    judged = count_judgements([own["trials"] for own in results], key)
    return [prefer(own) for own in judged.values()]


def test_planted_preference_is_found_and_its_opposite(large_key):
    for share, verdict in ((0.78, "graft preferred"), (0.22, "graft not preferred")):
        found = [own for seed in range(4) for own in simulate(large_key, share, seed)]
        assert [own.verdict for own in found].count(verdict) >= 11
        assert_allclose(np.mean([own.share for own in found]), share, atol=0.05)
        assert all(own.n == 240 for own in found)
    few = simulate(large_key, 0.9, 0, 9)
    assert {(own.interval, own.verdict) for own in few} == {(None, "fewer than 10 participants")}


def test_no_preference_is_rarely_found_and_more_judgements_show_equality(large_key):
    verdicts = [own.verdict for seed in range(30) for own in simulate(large_key, 0.5, seed)]
    assert sum(verdict.endswith("preferred") for verdict in verdicts) <= 0.05 * len(verdicts)
    many = [own.verdict for seed in range(3) for own in simulate(large_key, 0.5, seed, 60)]
    assert many.count("equally natural") >= 6


def test_stored_power_is_that_of_the_analysis():
    rows = {row["preference for the graft"]: row for row in read_csv(RESULTS / "pairs-power.csv")}
    assert float(rows["0.5"]["power, 12 participants"]) <= 0.05
    found = raters.power(0.65, 12, 60, n_studies=100)
    assert_allclose(found, float(rows["0.65"]["power, 12 participants"]), atol=0.15)


@given(st.lists(st.lists(st.sampled_from((0, 1)), max_size=6), min_size=1, max_size=8))
def test_krippendorff_alpha_equals_its_definition_by_pairs(choices):
    n, yes = (np.array([[f(own) for own in choices]], float) for f in (len, sum))
    kept = [own for own in choices if len(own) > 1]
    values = [value for own in kept for value in own]
    pairs = [
        ((a != b) / (len(own) - 1))
        for own in kept
        for i, a in enumerate(own)
        for k, b in enumerate(own)
        if i != k
    ]
    if not values:
        assert np.isnan(krippendorff_alpha(yes, n))
        return
    chance = [a != b for i, a in enumerate(values) for k, b in enumerate(values) if i != k]
    observed, expected = sum(pairs) / len(values), np.mean(chance)
    alpha = 1.0 if expected == 0 else 1 - observed / expected
    assert_allclose(krippendorff_alpha(yes, n), alpha, atol=1e-12)


def other_study(result):
    return sign({**result, "study": "other"}, "secret")


def changed(result):
    signed = sign(result, "secret")
    trial = signed["result"]["trials"][0]
    return {**signed, "result": {**result, "trials": [{**trial, "chosen": 0}]}}


def repeated(result):
    return sign({**result, "trials": [result["trials"][0]] * 6}, "secret")


def half(result):
    return sign({**result, "trials": result["trials"][:3]}, "secret")


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (other_study, "is of another study"),
        (changed, "was changed: its signature does not match"),
        (repeated, "has pairs that are not those of its set, once each"),
        (half, "3 of 8 pairs are judged"),
        (lambda _: "text", "is not a result"),
    ],
)
def test_spoiled_result_is_excluded_with_its_reason(study, spoil, reason, tmp_path):
    _, key = study
    rng, shares = np.random.default_rng(0), dict.fromkeys(ARMS, 0.5)
    results = raters.simulate_results(key, shares, 4, rng)
    missed = raters.simulate_results(key, shares, 4, rng, p_check=0.0)[3]
    signed = [sign(results[0], "secret"), spoil(results[1]), sign(results[2], "secret")]
    signed += [sign(results[2], "secret"), sign(missed, "secret")]
    paths = [tmp_path / f"{i}.json" for i in range(len(signed))]
    for path, own in zip(paths, signed, strict=True):
        path.write_text(json.dumps(own), encoding="utf-8")
    judgements, excluded = read_results(paths, key)
    assert [name for name, _ in excluded] == ["1.json", "3.json", "4.json"]
    assert reason in excluded[0][1]
    assert "earlier file" in excluded[1][1]
    assert "2 of 2 attention checks" in excluded[2][1]
    for own in judgements.values():
        assert own.shown.sum() == 2 * N_PAIRS / 3


@pytest.mark.browser
@pytest.mark.parametrize("width", [480, 1280])
def test_page_played_by_a_script_makes_results_that_are_read(study, width, tmp_path):
    page_of_study, key = study
    target = {frozenset((own["target"], own["other"])): own["target"] for own in key["items"]}
    path = page_of_study.save(tmp_path / "study.html")
    with chromium() as browser, open_page(browser, path, width) as page:
        wait = partial(page.wait_for_timeout, 30)
        assert page.is_disabled("#start")
        page.check("#agree")
        page.click("#start")
        n_trials = len(key["sets"][0])
        for trial in range(n_trials):
            while page.text_content("#progress") != f"Pair {trial + 1} of {n_trials}":
                wait()
            assert page.is_disabled("#choose-0")  # until both motions were seen once
            page.keyboard.press("1")
            while page.is_disabled("#choose-0"):
                wait()
            shown = page.evaluate("mograft.state.shown")
            side = shown.index(target[frozenset(shown)])
            page.keyboard.press("12"[side])
        while not page.is_visible("#text"):
            wait()
        text = page.input_value("#text")
        with page.expect_download() as download:
            page.click("#save")
        assert download.value.path().read_text(encoding="utf-8") == text
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    (tmp_path / "result.json").write_text(text, encoding="utf-8")
    judgements, excluded = read_results([tmp_path / "result.json"], key)
    assert excluded == []
    for own in judgements.values():
        assert own.preferred.sum() == own.shown.sum() == N_PAIRS / 3


def test_commands_make_a_study_and_analyse_it(tmp_path, capsys):
    folder = tmp_path / "study"
    main(["make", "--quick", "--contact", "A", "-o", str(folder)])
    with pytest.raises(FileExistsError, match="expected a new folder"):
        main(["make", "--quick", "--contact", "A", "-o", str(folder)])
    key = json.loads((folder / "key.json").read_text(encoding="utf-8"))
    rng, shares = np.random.default_rng(1), {arm: k / 2 for k, arm in enumerate(ARMS, 1)}
    shares = {arm: min(max(own, 0.02), 0.98) for arm, own in shares.items()}
    files = []
    for i, own in enumerate(raters.simulate_results(key, shares, 12, rng)):
        files.append(str(tmp_path / f"{i}.json"))
        text = json.dumps(sign(own, key["secret"]))
        (tmp_path / f"{i}.json").write_text(text, encoding="utf-8")
    main(["analyse", str(folder / "key.json"), *files, "-o", str(tmp_path / "found.csv")])
    assert "12 participants; 0 files excluded" in capsys.readouterr().out
    rows = read_csv(tmp_path / "found.csv")
    assert [row["graft against"] for row in rows] == list(ARMS)
    assert [row["verdict"] for row in rows][1:] == ["graft preferred"] * 2
    with pytest.raises(ValueError, match="expected the key of a study"):
        main(["analyse", files[0], *files])
