"""Tags and descriptions by the names and paths of clips."""

import csv
import json
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.cli import main
from mograft.dancer import dance
from mograft.library.clip_keys import ClipKeys, read_tags
from mograft.library.discover import FoundClip
from tests.strategies import few_examples

NAMES = st.sampled_from(["walk", "run", "jump"])
PATHS = st.tuples(st.sampled_from(["a", "b"]), st.sampled_from(["x", "y"]), NAMES)
KEYS = st.one_of(
    NAMES,
    NAMES.map("{}.bvh".format),
    PATHS.map(lambda own: "/".join(own)),
    PATHS.map(lambda own: f"/clips/{'/'.join(own)}"),
    PATHS.map(lambda own: "/".join(own[1:]) + ".bvh"),
    st.sampled_from(["w*", "*/run.bvh", "k"]),
)


@given(st.dictionaries(KEYS, st.integers(), max_size=6), st.sets(PATHS, min_size=1))
def test_keys_match_ends_of_paths(table, paths):
    keys = ClipKeys(table)
    used, folders = set(), {}
    for path in sorted(paths):
        address = "/clips/" + "/".join(path) + ".bvh"
        found = FoundClip(address, path[:2])
        expected = []
        for key, value in table.items():
            own = Path(address)
            ends = [address, str(own.with_suffix(""))]
            is_end = any(end == key or end.endswith(f"/{key}") for end in ends)
            is_glob = (key == "w*" and path[2] == "walk") or (
                key == "*/run.bvh" and path[2] == "run"
            )
            if is_end or is_glob:
                expected.append(value)
                used.add(key)
            if is_end:
                folders.setdefault(key, set()).add(path[:2])
        assert keys.match(found) == expected
    unused = [key for key in table if key not in used]
    several = [key for key in table if len(folders.get(key, ())) > 1]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        keys.warn("tags", stacklevel=1)
    messages = [str(own.message) for own in caught]
    for names, part in ((unused, "match no clip"), (several, "several folders")):
        found = [own for own in messages if part in own]
        assert len(found) == bool(names)
        for message in found:
            assert message.startswith(f"{len(names)} of {len(table)} names of `tags`")
            assert message.endswith(": " + ", ".join(names))


CELLS = st.text("abc é", min_size=1, max_size=5).map(str.strip).filter(bool)


@few_examples(30)
@given(
    rows=st.dictionaries(CELLS, st.tuples(CELLS | st.none(), CELLS, CELLS | st.none())),
    columns=st.none() | st.permutations(["style", "content_natural_desc_1", "uid"]),
)
def test_parquet_and_csv_give_the_same_tags(tmp_path_factory, rows, columns):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    import pyarrow as pa
    from pyarrow import parquet

    heading = ("style", "filename", "content_natural_desc_1", "uid")
    columns = None if columns is None else columns[:2]
    folder = tmp_path_factory.mktemp("tables")
    table = [(own[0], clip, own[1], own[2]) for clip, own in rows.items()]
    lists = zip(*table, strict=True) if table else [[]] * 4
    arrays = {k: pa.array(v, pa.string()) for k, v in zip(heading, lists, strict=True)}
    numbers = {"height": pa.array(range(len(table)), pa.int64())}
    parquet.write_table(pa.table({**numbers, **arrays}), folder / "tags.parquet")
    with (folder / "tags.csv").open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([heading, *[[v or "" for v in row] for row in table]])
    expected = {}
    for style, clip, text, uid in table:
        known = {"style": style, "content_natural_desc_1": f"text:{text}", "uid": uid}
        chosen = known if columns is None else columns
        order = [name for name in heading if name in chosen] if columns is None else list(chosen)
        expected[clip] = tuple(known[name] for name in order if known[name] is not None)
    found = read_tags(folder / "tags.parquet", columns)
    assert found == expected
    assert {k: sorted(v) for k, v in read_tags(folder / "tags.csv", columns).items()} == {
        k: sorted(v) for k, v in expected.items()
    }


@pytest.mark.parametrize(
    ("table", "columns", "message"),
    [
        ("clip,tag\nwalk\n", None, r"tags\.csv:2: expected a clip and its tags, got \['walk'\]"),
        (f"walk,slow\nrun,{'x' * 200_000}\n", None, r"tags\.csv:2: expected CSV: field larger"),
        (
            "clip,style\nwalk,slow\n",
            ["styl"],
            r"no column 'styl' in clip, style; did you mean 'style'",
        ),
        ("walk,slow\n", ["style"], r"tags\.csv: expected a heading with one of style"),
        ("style,filename\nslow,\n", None, r"tags\.csv:2: expected a clip and its tags"),
        (b"PAR1 no", None, r"tags\.parquet: expected Parquet: "),
        ({"style": ["slow"]}, None, r"tags\.parquet: expected a heading with one of clip, file"),
        (
            {"clip": ["a", None], "style": ["slow", "fast"]},
            None,
            r"tags\.parquet:2: expected a clip and its tags",
        ),
    ],
)
def test_read_tags_invalid_table_raises_value_error(tmp_path, table, columns, message):
    path = tmp_path / ("tags.csv" if isinstance(table, str) else "tags.parquet")
    if isinstance(table, str):
        path.write_text(table)
    else:
        pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
        parquet = pytest.importorskip("pyarrow.parquet")
        if isinstance(table, bytes):
            path.write_bytes(table)
        else:
            parquet.write_table(pyarrow.table(table), path)
    with pytest.raises(ValueError, match=message):
        read_tags(path, columns)


def test_read_tags_clip_in_two_rows_warns_and_joins(tmp_path):
    (tmp_path / "tags.csv").write_text("walk,slow\nrun,fast\nwalk,calm\n")
    with pytest.warns(UserWarning, match=r"1 clips of .*tags\.csv are in several rows.*: walk$"):
        found = read_tags(tmp_path / "tags.csv")
    assert found == {"walk": ("slow", "calm"), "run": ("fast",)}


def test_command_index_clips_of_one_name_get_the_tags_of_their_paths(tmp_path, capsys):
    clips, library, tags = (tmp_path / name for name in ("clips", "lib", "tags.csv"))
    for name in ("a/walk", "b/walk", "run"):
        (clips / name).parent.mkdir(parents=True, exist_ok=True)
        mg.write_bvh(dance(seed=3, strides=1).motion[100:240], clips / f"{name}.bvh")
    rows = ["height,filename,style,content_short_description", "1,clips/a/walk.bvh,slow,she walks"]
    tags.write_text("\n".join([*rows, "2,b/walk,fast,he walks", "3,run,,", "4,jump,high,"]))
    words = ["--tags", str(tags), "--tag-columns", "style,content_short_description"]
    mg.Library.index(clips / "run.bvh", library)
    assert main(["index", "--add", str(clips), "-o", str(library), *words]) == 0
    err = capsys.readouterr().err
    assert "1 of 4 names of --tags match no clip and have no effect: jump" in err
    added = mg.Library.open(library).entries
    expected = [("a", "slow", "text:she walks"), ("b", "fast", "text:he walks"), ()]
    assert [own.tags for own in added] == expected
    assert len({own.name for own in added}) == 3
    assert main(["index", str(clips), "-o", str(tmp_path / "whole"), *words]) == 0
    assert mg.Library.open(tmp_path / "whole").entries == added
    # Tags of clips that the library has reach them by path, too.
    later = mg.Library.open(library).add(clips, tags={"a/walk.bvh": ["old"]})
    assert [own.tags[-1:] for own in later.entries] == [("old",), ("text:he walks",), ()]
    capsys.readouterr()
    assert main(["lib", "info", str(library), "--json"]) == 0
    assert "text:she walks" in json.loads(capsys.readouterr().out)["tags"]
    assert main(["lib", "info", str(library)]) == 0
    assert "  tags: a b fast old slow\n  2 descriptions\n" in capsys.readouterr().out
    with pytest.warns(UserWarning, match=r"1 of 1 names of `tags` match files in several folders"):
        mg.Library.build(clips, tags={"walk": ["all"]})
    with pytest.raises(SystemExit, match="2"):
        main(["index", "-o", str(library), "--add", "x", "--tag-columns", "a"])
