"""Labelling: the page, the table of labels, and the classifier that is trained on them."""

import base64
import csv
import io
import json
import math
import re

import numpy as np
import pytest

from mograft import InsufficientDataError, Library
from mograft.evaluation.baselines import Analogy, RandomLength
from mograft.evaluation.label_judgement import judgement
from mograft.evaluation.label_table import COLUMNS, Labels, read_labels
from mograft.evaluation.labelling import label_items, label_page
from mograft.evaluation.part_features import part_features
from tests.browser import chromium, open_page

METHODS = (RandomLength(), Analogy())


@pytest.fixture(scope="module")
def items(library):
    """Return 150 pieces with exchanged parts and 20 captured pieces."""
    return label_items(library, 150, captured=20, seed=3)


def csv_text(rows):
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow((*COLUMNS, "label", "seconds"))
    writer.writerows(rows)
    return text.getvalue()


def label_row(library, segment, donor, label):
    cut = library.segments
    cells = []
    for index in (segment, donor):
        cells += [library.clips[cut.clip[index]].name, cut.start[index], cut.stop[index]]
    return [*cells[:3], "upper", *cells[3:], label, "1.00"]


def page_data(page):
    text = re.search(r'id="mograft-data">(.*?)</script>', page.html, re.DOTALL).group(1)
    return json.loads(text)


def node_positions(data, item):
    integers = np.frombuffer(base64.b64decode(item["pos"]), "<i2")
    return integers.reshape(item["frames"], len(data["parents"]), 3) * data["unit"]


def test_label_items_have_requested_counts_and_similar_lengths(library, items):
    assert len(items) == 170
    assert sum(item.segment == item.donor for item in items) == 20
    assert len({(item.segment, item.donor) for item in items}) == 170
    cut = library.segments
    for item in items:
        assert item.graft.base.name == library.clips[cut.clip[item.segment]].name
        assert (item.start, item.stop) == (cut.start[item.segment], cut.stop[item.segment])
        if item.segment != item.donor:
            difference = cut.lengths[item.donor] - cut.lengths[item.segment]
            assert abs(difference) <= max(0.15 * cut.lengths[item.segment], 1)


def test_label_items_captured_pieces_are_shuffled(items):
    positions = [i for i, item in enumerate(items) if item.segment == item.donor]
    assert positions != list(range(150, 170))


def test_label_items_same_seed_gives_same_items(library, items):
    again = label_items(library, 150, captured=20, seed=3)
    assert [(i.segment, i.donor) for i in again] == [(i.segment, i.donor) for i in items]


def test_label_items_more_than_available_raises_insufficient_data_error(library):
    short = Library.build(library.clips[0][:120])
    with pytest.raises(InsufficientDataError, match="were requested"):
        label_items(short, 5000)


def test_label_items_count_zero_raises_value_error(library):
    with pytest.raises(ValueError, match="at least 1"):
        label_items(library, 0)


def test_label_items_negative_number_of_captured_pieces_raises_value_error(library):
    with pytest.raises(ValueError, match="`captured` must be a whole number of at least 0, got -1"):
        label_items(library, 5, captured=-1)


def test_read_labels_too_long_cell_raises_value_error(library, tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text("x" * 200_000)
    with pytest.raises(ValueError, match="not a CSV table: field larger"):
        read_labels(path, library)


def test_label_items_base_group_raises_value_error(library):
    with pytest.raises(ValueError, match="`group` must be one of upper"):
        label_items(library, 5, group="lower")


def test_label_page_has_every_piece_and_no_mark_of_captured_ones(library, items):
    page = label_page(library, items)
    data = page_data(page)
    assert len(data["items"]) == len(items)
    assert data["columns"] == list(COLUMNS)
    for item, shown in zip(items, data["items"], strict=True):
        expected = label_row(library, item.segment, item.donor, "x")[: len(COLUMNS)]
        assert shown["row"] == [str(cell) for cell in expected]
        heights = node_positions(data, shown)[..., 1]
        assert 0 <= shown["first"] <= shown["last"] < shown["frames"]
        assert -0.2 < heights.min() < heights.max() < 1.6  # skeleton heights above the floor
    assert "captured" not in json.dumps(data)


def test_label_page_without_items_raises_value_error(library):
    with pytest.raises(ValueError, match="at least one"):
        label_page(library, [])


def test_label_page_bone_lengths_are_constant(library, items):
    data = page_data(label_page(library, items[:3]))
    clip = library.clips[0]
    expected = np.linalg.norm(clip.skeleton.offsets, axis=1)
    for item in data["items"]:
        positions = node_positions(data, item)
        for joint in range(1, clip.n_joints):
            if expected[joint] > 1:
                bones = positions[:, joint] - positions[:, data["parents"][joint]]
                ratios = np.linalg.norm(bones, axis=1) / expected[joint]
                assert np.ptp(ratios) < 0.02 * ratios.mean()


def test_read_labels_written_rows_returns_same_labels(library, items, tmp_path):
    is_natural = np.random.default_rng(0).random(len(items)) < 0.5
    rows = [
        label_row(library, item.segment, item.donor, "natural" if natural else "unnatural")
        for item, natural in zip(items, is_natural, strict=True)
    ]
    path = tmp_path / "labels.csv"
    path.write_text(csv_text(rows))
    labels = read_labels(path, library)
    assert labels.segment.tolist() == [item.segment for item in items]
    assert labels.donor.tolist() == [item.donor for item in items]
    assert labels.natural.tolist() == is_natural.tolist()
    assert labels.group == "upper"
    assert len(labels.natural) == len(items)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: [r[0], "99999", *r[2:]], ":2: .* has no segment"),
        (lambda r: [r[0], "x", *r[2:]], ":2: frames must be whole numbers"),
        (lambda r: ["elsewhere", *r[1:]], ":2: elsewhere has no segment"),
        (lambda r: [*r[:7], "fine", "1"], ":2: label must be natural or unnatural"),
        (lambda r: r[:4], ":2: must have 8 columns"),
        (lambda r: [*r[:3], "wings", *r[4:]], "the same joint group of the library, got wings"),
    ],
)
def test_read_labels_invalid_row_raises_value_error(library, tmp_path, change, message):
    path = tmp_path / "labels.csv"
    path.write_text(csv_text([change(label_row(library, 3, 4, "natural"))]))
    with pytest.raises(ValueError, match=message):
        read_labels(path, library)


@pytest.mark.parametrize("text", ["", "a,b\n", "HIERARCHY\n"])
def test_read_labels_other_header_raises_value_error(library, tmp_path, text):
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=":1: header must begin with"):
        read_labels(path, library)


def test_read_labels_other_encoding_raises_value_error(library, tmp_path):
    path = tmp_path / "labels.csv"
    path.write_bytes(b"\xff\xfe\x00clip")
    with pytest.raises(ValueError, match="not UTF-8"):
        read_labels(path, library)


def label_all(items, is_natural):
    """Return labels of items by a function of segment and donor."""
    pairs = np.array([(item.segment, item.donor) for item in items])
    natural = np.array([is_natural(*pair) for pair in pairs.tolist()])
    return Labels(pairs[:, 0], pairs[:, 1], natural, "upper")


def test_judgement_labels_by_upper_feature_are_predicted(library):
    items = label_items(library, 400, captured=30, seed=1)
    features = part_features(library, "upper")
    centered = features - features.mean(axis=0)
    component = features @ np.linalg.svd(centered, full_matrices=False)[2][0]
    is_natural = component > np.median(component)
    labels = label_all(items, lambda _, donor: bool(is_natural[donor]))
    found = judgement(library, labels, METHODS)
    assert found.learned + found.tested == 400
    assert 0.55 < found.learned / 400 < 0.75
    assert found.accuracy.value > 0.8
    assert found.accuracy.n == found.tested
    truth = np.mean(is_natural)
    verdict = next(v for v in found.verdicts if v.method == "random, length limit")
    called, corrected = verdict.called, verdict.corrected
    assert called.value == pytest.approx(truth, abs=0.12)
    assert corrected.low <= truth + 0.05
    assert corrected.high >= truth - 0.05
    # The interval also covers the choice of the test labels.
    assert corrected.high - corrected.low > called.high - called.low
    assert json.loads(json.dumps(found.as_dict(), allow_nan=False))["learned"] == found.learned


def test_judgement_random_labels_have_no_corrected_share(library):
    items = label_items(library, 200, captured=0, seed=1)
    rng = np.random.default_rng(5)
    labels = label_all(items, lambda *_: bool(rng.random() < 0.5))
    found = judgement(library, labels, METHODS)
    assert found.captured.n == 0
    for verdict in found.verdicts:
        assert math.isnan(verdict.corrected.value)
        assert verdict.as_dict()["corrected"]["value"] is None


def test_judgement_fifty_labels_raises_insufficient_data_error(library, items):
    labels = label_all(items[:50], lambda segment, _: segment % 2 == 0)
    with pytest.raises(InsufficientDataError, match="100 labels of exchanged parts"):
        judgement(library, labels, METHODS)


def test_judgement_one_kind_of_labels_raises_insufficient_data_error(library, items):
    with pytest.raises(InsufficientDataError, match="at least 20 natural and 20 unnatural"):
        judgement(library, label_all(items, lambda *_: True), METHODS)


@pytest.mark.browser
def test_label_page_key_presses_become_readable_labels(library, items, tmp_path):
    path = label_page(library, items[:4], "Look").save(tmp_path / "label.html")
    with chromium() as browser, open_page(browser, path) as page:
        for key in ("j", "f", "u", "j", "s", "f"):
            page.keyboard.press(key)
        assert page.evaluate("mograft.index()") == 4
        text = page.evaluate("mograft.table()")
        assert "All 4 pieces are labelled" in page.inner_text('[data-part="count"]')
        has_size = page.evaluate(
            "() => { const c = document.querySelector('canvas');"
            " return c.width > 0 && c.height > 0; }"
        )
        assert has_size
    saved = tmp_path / "labels.csv"
    saved.write_text(text)
    labels = read_labels(saved, library)
    # The second label was undone and replaced; the third piece was skipped.
    assert labels.natural.tolist() == [True, True, False]
    assert labels.segment.tolist() == [items[index].segment for index in (0, 1, 3)]
