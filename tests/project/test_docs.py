"""The examples of the documentation run and print the documented output; pages and links work."""

import contextlib
import doctest
import importlib.util
import inspect
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from functools import cache
from pathlib import Path

import pytest

import mograft
from mograft.cli import main
from mograft.io.smpl.body_models import SMPL_H, stand_in
from tests.io.npz_files import dance_arrays, write_arrays, write_rest_pose
from tests.io.robot_files import write_walks

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if not {"_made", "_build"} & set(page.parts)]
# Indented in a list, too.
FENCE = re.compile(r"^( *)```(\{?[\w-]*\}?)[^\n]*\n(.*?)^\1```", re.MULTILINE | re.DOTALL)
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE

pytest.importorskip("matplotlib", reason="the examples draw with matplotlib").use("agg")


def run_command(words):
    """Return the output of a command that must succeed."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        assert main(words) == 0, words
    return out.getvalue()


@cache
def make_demo():
    """Run the demo once for all pages; return its output and the folder that has its own."""
    around = tempfile.TemporaryDirectory()
    with contextlib.chdir(around.name):
        return run_command(["demo", "-o", "demo"]), around


def run_demo(folder):
    """Return the output of the demo, and copy its folder if no command of the page has made it."""
    output, around = make_demo()
    if not Path(folder).exists():
        shutil.copytree(Path(around.name, "demo"), folder)
    return output.replace("demo/", f"{folder}/")


def run_console(text):
    """Run the commands of a block; compare their output with that in the block."""
    commands = re.split(r"^\$ ", text, flags=re.MULTILINE)
    assert not commands[0].strip(), "a block must begin with a command"
    for part in commands[1:]:
        command, _, expected_output = part.partition("\n")
        words = shlex.split(command)
        assert words[0] == "mograft", f"a console block must run mograft, got {words[0]}"
        is_demo = words[1:3] == ["demo", "-o"] and len(words) == 4
        output = run_demo(words[3]) if is_demo else run_command(words[1:])
        checker = doctest.OutputChecker()
        assert checker.check_output(expected_output, output, FLAGS), (command, output)


def run_python(text, names, page):
    """Run the examples of a block as doctests that share their names with the page."""
    test = doctest.DocTestParser().get_doctest(text, names, page, page, 0)
    assert test.examples, "a pycon block must contain an example"
    output = io.StringIO()
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    failed = runner.run(test, out=output.write, clear_globs=False).failed
    names.update(test.globs)
    assert not failed, output.getvalue()


def make_amass_files():
    """Write the AMASS-like files and the body that the page about AMASS names."""
    for seed, name in enumerate(("walk", "wave")):
        write_arrays(f"{name}_poses.npz", dance_arrays(seed))
    write_rest_pose(stand_in(SMPL_H), "body.bvh")


PREPARATIONS = {"amass.md": make_amass_files, "robots.md": lambda: write_walks(Path())}
"""Functions that write the files which the reader of a page has."""


@pytest.mark.parametrize("page", PAGES, ids=[str(p.relative_to(ROOT)) for p in PAGES])
def test_documentation_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    PREPARATIONS.get(page.name, lambda: None)()
    names = {}
    for indent, language, fenced in FENCE.findall(page.read_text(encoding="utf-8")):
        text = re.sub(f"^{indent}", "", fenced, flags=re.MULTILINE)
        if language == "console":
            run_console(text)
        elif language == "pycon":
            run_python(text, names, page.name)
        else:
            # Blocks that the tests cannot run are marked `sh`.
            assert language not in ("python", "py", "bash", "shell"), (page.name, language)
            assert ">>>" not in text
    with contextlib.suppress(ImportError):
        from matplotlib import pyplot

        pyplot.close("all")


def test_readme_commands_run_in_order_in_a_new_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = re.findall(r"^    (.*\bmograft (?:demo|graft)\b.*)$", text, re.MULTILINE)
    commands = [re.split(r"(?:\.venv/bin/)?\bmograft (?=\w)", line)[-1] for line in lines]
    assert len(commands) > 1
    assert commands[0] == "demo"
    run_demo("demo")
    for command in commands[1:]:
        paths = run_command([*shlex.split(command), "--json"])
        assert json.loads(paths)


def test_documentation_wrong_example_fails():
    with pytest.raises(AssertionError):
        run_python(">>> 1 + 1\n3\n", {}, "x")
    with pytest.raises(AssertionError):
        run_console("$ mograft groups none.bvh\n")
    with pytest.raises(AssertionError):
        run_console("$ rm -r x\n")


def test_paper_table_names_existing_code():
    text = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 8
    for name in re.findall(r"`(mograft\.[\w.]+)`", text):
        value = importlib.import_module("mograft")
        for part in name.split(".")[1:]:
            if not hasattr(value, part):
                value = importlib.import_module(f"{value.__name__}.{part}")
            else:
                value = getattr(value, part)
    for row in rows:
        assert re.search(r"`tests/[\w/]+\.py`", row), row


def test_documentation_table_lists_every_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    text = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8").partition("## Extras")[2]
    cells = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    listed = [name for cell in cells[1:] for name in re.findall(r"`([a-z]+)`", cell)]
    assert sorted(listed) == sorted(project["optional-dependencies"])


@pytest.mark.thorough
def test_documentation_builds_without_warnings(tmp_path):
    for module in ("sphinx", "furo", "myst_parser"):
        pytest.importorskip(module, reason=f"{module} is not installed")
    start = time.time_ns() - 10**9  # file systems round times
    words = ["sphinx", "-q", "-W", "--keep-going", "-t", "tiny", "docs", str(tmp_path)]
    process = subprocess.run(
        [sys.executable, "-m", *words], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert process.returncode == 0, process.stderr[-3000:]
    assert (tmp_path / "graft.html").exists()
    for page in set(PAGES) - {ROOT / "README.md"}:
        # A page such as search.md would be replaced by a page that Sphinx generates.
        lines = page.read_text(encoding="utf-8").splitlines()
        heading = next(line for line in lines if line.startswith("# "))
        built_page = tmp_path / page.relative_to(ROOT / "docs").with_suffix(".html")
        (title,) = re.findall("<h1>(.*?)<a", built_page.read_text(encoding="utf-8"))
        assert re.sub(r"<[^>]*>|\W", "", title) == re.sub(r"\W", "", heading), page.name
    gallery = (tmp_path / "_made" / "gallery.html").read_text(encoding="utf-8")
    found = (ROOT / "docs" / "_made").glob("*.png")
    pictures = {path.stem for path in found if path.stat().st_mtime_ns >= start}
    assert pictures == set(re.findall(r'src="\.\./_images/(\w+)\.png"', gallery))
    pages = {path.name for path in (ROOT / "docs" / "_made" / "pages").glob("*.html")}
    assert pages <= set(re.findall(r'href="\.\./(\w+\.html)"', gallery))


def test_generated_pages_name_every_command_and_public_name(tmp_path):
    pytest.importorskip("sphinx", reason="sphinx is not installed")
    spec = importlib.util.spec_from_file_location("conf", ROOT / "docs" / "conf.py")
    conf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conf)
    conf.MADE = tmp_path
    conf.make_command_line()
    commands = (tmp_path / "cli.md").read_text(encoding="utf-8")
    for words in ("graft", "lib verify", "config show"):
        assert f"mograft {words}\n" in commands
    conf.make_api()
    listed = re.findall(
        r"^(?:\.\. \S+ |`|## )(mograft\.[\w.]+)", (tmp_path / "api.md").read_text("utf-8"), re.M
    )
    for name in set(mograft.__all__) - {"__version__"}:
        value = getattr(mograft, name)
        assert f"mograft.{name}" in listed
        if inspect.ismodule(value):
            for inner in value.__all__:
                assert {f"mograft.{name}.{inner}", f"mograft.{inner}"} & set(listed), inner


FILE = re.compile(r"\b(?:tests|benches|lab)/[\w/]+\.(?:py|md)\b")
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)|^\[[\w-]+\]: ([^#:\s]+)(?:#\S*)?$", re.MULTILINE)


ANCHOR = re.compile(r"(?:\]\(|^\[[\w-]+\]: )([^)#:\s]*)#([\w-]+)\)?", re.MULTILINE)


def find_anchors(page):
    """Return the anchors that Sphinx and GitHub make from the headings of a page."""
    lines = FENCE.sub("", page.read_text(encoding="utf-8")).splitlines()
    headings = [line.lstrip("#").strip().lower() for line in lines if line.startswith("#")]
    return {re.sub(r"[^\w -]", "", heading).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=[str(p.relative_to(ROOT)) for p in PAGES])
def test_documentation_links_and_named_files_exist(page):
    text = page.read_text(encoding="utf-8")
    for target, anchor in ANCHOR.findall(text):
        assert anchor in find_anchors(page.parent / target if target else page), (target, anchor)
    for path in FILE.findall(text):
        assert (ROOT / path).exists(), path
    for target in map("".join, LINK.findall(text)):
        if "_made/" not in target:
            assert (page.parent / target).exists(), target


def test_architecture_names_modules_that_exist():
    package = ""
    packages = {path.parent.name for path in (ROOT / "python/mograft").glob("[a-z]*/__init__.py")}
    text = (ROOT / "docs/architecture.md").read_text("utf-8")
    for row in text[text.index("| to change |") :].splitlines():
        package = next(iter(re.findall(r"\*\*(\w+)\*\*", row)), package)
        packages.discard(package)
        for name in re.findall(r"`([\w/-]+(?:\.\w+|/))`", row):
            source = ROOT / "python/mograft"
            assert any((own / name).exists() for own in (source / package, source, ROOT)), name
    assert not packages
