"""Commands that take or write libraries."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest

from mograft.cli import main
from mograft.cli.files import select_clips


def run_command(capsys, *words):
    code = main([str(word) for word in words])
    return code, *capsys.readouterr()


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
        options = {"cwd": tmp_path, "env": environment | extra, "timeout": 60, "text": True}
        printed = subprocess.check_output([sys.executable, "-c", script], **options)
        assert printed.split() == [expected]


def test_commands_take_clips_of_a_library_by_name_glob_and_tag(stored_library, tmp_path, capsys):
    folder = stored_library.folder
    code, out, _ = run_command(
        *(capsys, "candidates", folder, "--clip", "b", "--segment", 2, "--json"),
        *("--not-tagged", "walk,jump"),
    )
    assert code == 0
    assert {donor["clip"] for donor in json.loads(out)["allowed"]} <= {"c", "d", "b"}
    page = tmp_path / "page.html"
    assert run_command(capsys, "view", folder, "--clip", "a*", "--clip", "c", "-o", page)[0] == 0
    data = "".join(re.findall(r'(?s)<script type="application/json".*?</script>', page.read_text()))
    assert [name in data for name in ('"a"', '"a~2"', '"c"', '"b"')] == [1, 1, 1, 0]
    made = ("graft", folder, "--base", "d", "--mirror", "--only-tagged", "walk")
    assert run_command(capsys, *made, "-o", tmp_path / "g.bvh")[0] == 0
    document = json.loads((tmp_path / "g.json").read_text())
    names = {s["clip"].removesuffix("_mirrored") for s in document["substitutions"]}
    assert document["clips"][0]["name"] == "d"
    assert names <= {"a~2", "b", "d"}


@pytest.mark.parametrize("kind", ["pca", "dendrogram", "timeline"])
def test_plot_command_accepts_library(stored_library, tmp_path, capsys, kind):
    pytest.importorskip("matplotlib", reason="needs the extra plot")
    folder, picture = stored_library.folder, tmp_path / "picture.svg"
    assert run_command(capsys, "plot", kind, folder, "-o", picture)[0] == 0
    assert picture.exists()


def test_select_clips_too_many_raises_value_error(stored_library):
    many = replace(stored_library, entries=stored_library.entries * 3)
    with pytest.raises(ValueError, match="at most 12 clips can be shown at once, got 15"):
        select_clips(many, [])
    assert select_clips(many, ["a~*", "c"]) == [0, 3, 5, 8, 10, 13]
