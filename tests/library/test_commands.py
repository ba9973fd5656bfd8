"""Commands that take or write libraries."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest

import mograft as mg
from mograft.cli import main
from mograft.cli.files import select_clips


def run_command(capsys, *words):
    code = main([str(word) for word in words])
    return code, *capsys.readouterr()


def test_graft_command_unknown_base_lists_clips(stored_library, tmp_path, capsys):
    options = ["graft", str(stored_library.folder), "-o", str(tmp_path / "new.bvh")]
    name = stored_library.entries[1].name
    assert main([*options, "--base", name, "--mirror"]) == 0
    capsys.readouterr()
    options[-1] = str(tmp_path / "other.bvh")
    for more in ([], ["--mirror"]):
        assert main([*options, "--base", "waltz", *more]) == 1
        message = capsys.readouterr().err
        assert "--base must be a clip, one of" in message
        assert name in message
        assert "got 'waltz'" in message
    assert not (tmp_path / "other.bvh").exists()


def test_index_command_sets_blas_threads_before_numpy_is_imported(tmp_path):
    script = """
import os, sys
from mograft.cli import main
class PrintThreads:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"))
sys.meta_path.insert(0, PrintThreads())
main(["index", "nothing.bvh", "-o", "l"])
"""
    environment = {key: value for key, value in os.environ.items() if not key.endswith("_THREADS")}
    for extra, expected in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")):
        process = subprocess.run(
            [sys.executable, "-c", script],
            cwd=tmp_path,
            env=environment | extra,
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        assert process.stdout.split() == [expected]


def test_commands_accept_library_in_place_of_files(stored_library, tmp_path, capsys):
    folder = stored_library.folder
    listed = ("candidates", folder, "--segment", 2)
    code, out, _ = run_command(capsys, *listed, "--clip", "b", "--json")
    assert code == 0
    index = [entry.name for entry in stored_library.entries].index("b")
    found = mg.candidates(stored_library, int(stored_library.segments.of_clip(index)[2]), "upper")
    assert len(json.loads(out)["allowed"]) == len(found.allowed)
    _, out, _ = run_command(capsys, *listed, "--json", "--not-tagged", "walk,jump")
    assert {donor["clip"] for donor in json.loads(out)["allowed"]} <= {"c", "d"}
    code, _, err = run_command(capsys, *listed, "--only-tagged", "glad")
    assert (code, err) == (1, "error: --only-tagged must be among jump, walk; got 'glad'\n")

    page = tmp_path / "page.html"
    assert run_command(capsys, "view", folder, "--clip", "a*", "--clip", "c", "-o", page)[0] == 0
    data = "".join(re.findall(r'(?s)<script type="application/json".*?</script>', page.read_text()))
    assert [name in data for name in ('"a"', '"a~2"', '"c"', '"b"')] == [1, 1, 1, 0]
    code, _, err = run_command(capsys, "view", folder, "--clip", "e", "-o", tmp_path / "no.html")
    assert (code, "--clip must match at least one of c, d, a, a~2, b; got 'e'" in err) == (1, True)
    made = ("graft", folder, "--only-tagged", "walk", "-o", tmp_path / "g.bvh")
    assert run_command(capsys, *made)[0] == 0
    document = json.loads((tmp_path / "g.json").read_text())
    assert {s["clip"] for s in document["substitutions"] if s["exchanged"]} <= {"a~2", "b"}


@pytest.mark.parametrize("kind", ["pca", "dendrogram", "clusters", "timeline", "strip", "energy"])
def test_plot_command_accepts_library(stored_library, tmp_path, capsys, kind):
    pytest.importorskip("matplotlib", reason="needs the extra plot")
    folder, picture = stored_library.folder, tmp_path / "picture.svg"
    code, _, err = run_command(capsys, "plot", kind, folder, "-o", picture)
    if kind in ("strip", "energy"):
        assert (code, "shows one motion, got 5: give one by --clip of " in err) == (1, True)
        code, _, _ = run_command(capsys, "plot", kind, folder, "--clip", "b", "-o", picture)
        assert code == 0
    assert picture.exists()
    other = tmp_path / "other.svg"
    with pytest.raises(SystemExit):
        run_command(capsys, "plot", kind, folder, "--groups", "lower_upper", "-o", other)


def test_select_clips_too_many_raises_value_error(stored_library):
    many = replace(stored_library, entries=stored_library.entries * 3)
    with pytest.raises(ValueError, match="at most 12 clips can be shown at once, got 15"):
        select_clips(many, [])
    assert select_clips(many, ["a~*", "c"]) == [0, 3, 5, 8, 10, 13]
