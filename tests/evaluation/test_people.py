"""Labels: what a page asks, what comes back, and what may be concluded from it."""

import csv
import io
import json
import math
import re

import numpy as np
import pytest

from mograft import InsufficientDataError, Library
from mograft.dancer import dance
from mograft.evaluation import naturalness
from mograft.evaluation.baselines import Analogy, RandomLength
from mograft.evaluation.people import (
    COLUMNS,
    Labels,
    judgement,
    label_items,
    label_page,
    read_labels,
)
from tests.browser import chromium, open_page

WAYS = (RandomLength(), Analogy())


@pytest.fixture(scope="module")
def library():
    return Library.build([take.motion for take in dance(seed=8, strides=1).takes(2)])


@pytest.fixture(scope="module")
def items(library):
    return label_items(library, 150, captured=20, seed=3)


def table(rows, head=(*COLUMNS, "label", "seconds")):
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def row(library, segment, donor, label, group="upper"):
    cut = library.segments
    cells = []
    for own in (segment, donor):
        cells += [library.clips[cut.clip[own]].name, cut.start[own], cut.stop[own]]
    return [*cells[:3], group, *cells[3:], label, "1.00"]


def test_pieces_are_drawn_as_asked_and_are_what_they_say(library, items):
    assert len(items) == 170
    assert sum(item.segment == item.donor for item in items) == 20
    assert len({(item.segment, item.donor) for item in items}) == 170
    cut = library.segments
    for item in items:
        assert item.graft.base.name == library.clips[cut.clip[item.segment]].name
        assert (item.start, item.stop) == (cut.start[item.segment], cut.stop[item.segment])
        if item.segment != item.donor:
            ratio = cut.lengths[item.donor] - cut.lengths[item.segment]
            assert abs(ratio) <= max(0.15 * cut.lengths[item.segment], 1)
    again = label_items(library, 150, captured=20, seed=3)
    assert [(i.segment, i.donor) for i in again] == [(i.segment, i.donor) for i in items]
    assert items[0].segment != items[-1].segment  # shuffled: captured ones are among the others
    places = [at for at, item in enumerate(items) if item.segment == item.donor]
    assert places != list(range(150, 170))


def test_more_pieces_than_there_are_is_refused(library):
    few = Library.build(library.clips[0][:120])
    with pytest.raises(InsufficientDataError, match="were wanted"):
        label_items(few, 5000)
    with pytest.raises(ValueError, match="1 or more"):
        label_items(library, 0)
    with pytest.raises(ValueError, match="group must be one of upper"):
        label_items(library, 5, group="lower")


def test_the_page_holds_every_piece_and_no_answer(library, items):
    page = label_page(library, items)
    text = re.search(r'id="mograft-data">(.*?)</script>', page.html, re.DOTALL).group(1)
    values = json.loads(text)
    assert len(values["items"]) == len(items)
    assert values["columns"] == list(COLUMNS)
    n_nodes = len(values["parents"])
    for item, shown in zip(items, values["items"], strict=True):
        assert shown["row"] == [str(v) for v in row(library, item.segment, item.donor, "x")[:7]]
        raw = np.frombuffer(__import__("base64").b64decode(shown["pos"]), "<i2")
        places = raw.reshape(shown["frames"], n_nodes, 3) * values["unit"]
        assert 0 <= shown["first"] <= shown["last"] < shown["frames"]
        assert -0.2 < places[..., 1].min() < places[..., 1].max() < 1.6  # heights above the floor
    assert "captured" not in text  # they are shown among the others, unmarked
    with pytest.raises(ValueError, match="at least one"):
        label_page(library, [])


def test_bones_on_the_page_are_as_long_as_they_are(library, items):
    values = json.loads(
        re.search(
            r'id="mograft-data">(.*?)</script>', label_page(library, items[:3]).html, re.DOTALL
        ).group(1)
    )
    clip = library.clips[0]
    wanted = np.linalg.norm(clip.skeleton.offsets, axis=1)
    for shown in values["items"]:
        raw = np.frombuffer(__import__("base64").b64decode(shown["pos"]), "<i2")
        places = raw.reshape(shown["frames"], -1, 3) * values["unit"]
        for joint in range(1, clip.n_joints):
            way = places[:, joint] - places[:, values["parents"][joint]]
            lengths = np.linalg.norm(way, axis=1)
            ratio = lengths / max(wanted[joint], 1e-9)
            if wanted[joint] > 1:
                assert np.ptp(ratio) < 0.02 * ratio.mean()


def test_labels_come_back_as_they_were_given(library, items, tmp_path):
    rng = np.random.default_rng(0)
    said = rng.random(len(items)) < 0.5
    rows = [
        row(library, item.segment, item.donor, "natural" if good else "unnatural")
        for item, good in zip(items, said, strict=True)
    ]
    path = tmp_path / "labels.csv"
    path.write_text(table(rows))
    labels = read_labels(path, library)
    assert labels.segment.tolist() == [item.segment for item in items]
    assert labels.donor.tolist() == [item.donor for item in items]
    assert labels.natural.tolist() == said.tolist()
    assert labels.group == "upper"
    assert len(labels) == len(items)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda r: [r[0], "99999", *r[2:]], ":2: .* has no segment"),
        (lambda r: [r[0], "x", *r[2:]], ":2: frames must be whole numbers"),
        (lambda r: ["elsewhere", *r[1:]], ":2: elsewhere has no segment"),
        (lambda r: [*r[:7], "fine", "1"], ":2: label must be natural or unnatural"),
        (lambda r: r[:4], ":2: must have 8 columns"),
        (lambda r: [*r[:3], "wings", *r[4:]], "one group of the library, got wings"),
    ],
)
def test_a_wrong_row_is_told_with_its_line(library, tmp_path, change, told):
    path = tmp_path / "labels.csv"
    path.write_text(table([change(row(library, 3, 4, "natural"))]))
    with pytest.raises(ValueError, match=told):
        read_labels(path, library)


def test_what_is_no_table_of_labels_is_refused(library, tmp_path):
    path = tmp_path / "labels.csv"
    for text in ("", "a,b\n", "HIERARCHY\n"):
        path.write_text(text)
        with pytest.raises(ValueError, match=":1: must begin with"):
            read_labels(path, library)
    path.write_bytes(b"\xff\xfe\x00clip")
    with pytest.raises(ValueError, match="no UTF-8"):
        read_labels(path, library)


def labelled(items, say):
    pairs = np.array([(item.segment, item.donor) for item in items])
    return Labels(pairs[:, 0], pairs[:, 1], np.array([say(*p) for p in pairs.tolist()]), "upper")


@pytest.fixture(autouse=True)
def few_parameters(monkeypatch):
    monkeypatch.setattr(naturalness, "_GRID", {"C": (10.0,), "gamma": (0.03,)})


def test_a_person_who_looks_at_arms_is_learned_from(library):
    # The simplest taste that can be learned: of the upper body's feature, one half is liked.
    items = label_items(library, 400, captured=30, seed=1)
    taste = naturalness.part_features(library, "upper")
    taste = taste @ np.linalg.svd(taste - taste.mean(axis=0), full_matrices=False)[2][0]
    middle = np.median(taste)
    labels = labelled(items, lambda _, donor: bool(taste[donor] > middle))
    own = judgement(library, labels, WAYS)
    assert own.learned + own.tested == 400
    assert 0.55 < own.learned / 400 < 0.75
    assert own.accuracy.value > 0.8
    assert own.accuracy.n == own.tested
    verdicts = {verdict.method: verdict for verdict in own.verdicts}
    truth = np.mean(taste > middle)
    chance = verdicts["random, length limit"]
    assert chance.called.value == pytest.approx(truth, abs=0.12)
    assert chance.corrected.low <= truth + 0.05
    assert chance.corrected.high >= truth - 0.05
    # The interval of the corrected share holds the errors of the labels too.
    wide = chance.corrected.high - chance.corrected.low
    assert wide > chance.called.high - chance.called.low
    assert json.loads(json.dumps(own.as_dict(), allow_nan=False))["learned"] == own.learned


def test_a_person_who_tosses_a_coin_corrects_nothing(library):
    items = label_items(library, 200, captured=0, seed=1)
    rng = np.random.default_rng(5)
    own = judgement(library, labelled(items, lambda *_: bool(rng.random() < 0.5)), WAYS)
    assert own.captured.n == 0
    for verdict in own.verdicts:
        assert math.isnan(verdict.corrected.value)
        assert verdict.as_dict()["corrected"]["value"] is None


def test_too_few_labels_are_refused(library, items):
    with pytest.raises(InsufficientDataError, match="labels of 100"):
        judgement(library, labelled(items[:50], lambda a, _: a % 2 == 0), WAYS)
    with pytest.raises(InsufficientDataError, match="20 of each kind"):
        judgement(library, labelled(items, lambda *_: True), WAYS)


@pytest.mark.browser
def test_keys_become_labels_that_can_be_read(library, items, tmp_path):
    path = label_page(library, items[:4], "Look").save(tmp_path / "label.html")
    with chromium() as browser, open_page(browser, path) as page:
        for key in ("j", "f", "u", "j", "s", "f"):
            page.keyboard.press(key)
        assert page.evaluate("mograft.at()") == 4
        text = page.evaluate("mograft.table()")
        assert "All 4 are judged" in page.inner_text('[data-part="count"]')
        drawn = page.evaluate(
            "() => { const c = document.querySelector('canvas');"
            " return c.width > 0 && c.height > 0; }"
        )
        assert drawn
    saved = tmp_path / "labels.csv"
    saved.write_text(text)
    labels = read_labels(saved, library)
    # The second was taken back and called natural; the third skipped.
    assert labels.natural.tolist() == [True, True, False]
    assert labels.segment.tolist() == [items[at].segment for at in (0, 1, 3)]
