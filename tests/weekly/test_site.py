"""The site of the documentation holds one folder per version, and its pages a menu of them."""

import functools
import http.server
import json
import os
import shutil
import subprocess
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from release.site import list_versions, main, name_folder, place, publish
from tests.browser import TIMEOUT_MILLISECONDS, chromium, wait_until

DOCS = Path(__file__).resolve().parents[2] / "docs"
NUMBERS = st.integers(0, 120)
PAGE = """<!doctype html><html data-content_root="{root}"><meta charset="utf-8">
<title>{title}</title><body>{sidebar}<script src="{root}versions.js" defer></script></html>"""


def write_build(folder, title="start"):
    """Write what the site needs of a build: two pages with the menu, and the search."""
    (folder / "howto").mkdir(parents=True)
    sidebar = (DOCS / "_templates/sidebar/versions.html").read_text(encoding="utf-8")
    for name, root in (("index", "./"), ("search", "./"), ("howto/edit", "../")):
        text = PAGE.format(root=root, title=title, sidebar=sidebar)
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    (folder / "searchindex.js").write_text("Search.setIndex({})")
    script = (DOCS / "_static/versions.js").read_text(encoding="utf-8")
    (folder / "versions.js").write_text(script, encoding="utf-8")
    return folder


@given(NUMBERS, NUMBERS, NUMBERS)
def test_name_folder_of_tag_is_its_minor_version(major, minor, patch):
    for version in (f"{major}.{minor}.{patch}", f"v{major}.{minor}.{patch}", f"{major}.{minor}"):
        assert name_folder(version) == f"{major}.{minor}"


@pytest.mark.parametrize("version", ["", "1", "v1.2.3rc1", "../1.2", "1.2/..", "main", "dev "])
def test_name_folder_other_word_raises_value_error(version):
    with pytest.raises(ValueError, match="version must be MAJOR"):
        name_folder(version)


@given(st.lists(st.tuples(NUMBERS, NUMBERS), unique=True, min_size=1, max_size=9), st.booleans())
def test_list_versions_is_sorted_by_number_newest_first(tmp_path_factory, numbers, has_dev):
    site = tmp_path_factory.mktemp("site")
    for name in [*(f"{a}.{b}" for a, b in numbers), *(["dev"] if has_dev else []), "pictures"]:
        (site / name).mkdir()
        (site / name / "index.html").touch()
    expected = [f"{a}.{b}" for a, b in sorted(numbers, reverse=True)]
    assert list_versions(site) == (["dev", *expected] if has_dev else expected)


def test_place_second_version_keeps_first(tmp_path):
    site = tmp_path / "site"
    place(write_build(tmp_path / "a", "first"), site, "v0.9.0")
    before = {p: p.read_bytes() for p in (site / "0.9").rglob("*") if p.is_file()}
    assert place(write_build(tmp_path / "b"), site, "0.10.0") == ["0.10", "0.9"]
    assert {p: p.read_bytes() for p in before} == before
    assert 'url=0.10/"' in (site / "index.html").read_text()
    assert json.loads((site / "versions.json").read_text()) == [
        {"name": "0.10", "is_newest_release": True},
        {"name": "0.9", "is_newest_release": False},
    ]


def test_place_same_version_again_removes_old_pages(tmp_path):
    site = tmp_path / "site"
    place(write_build(tmp_path / "a"), site, "0.1.0")
    (site / "0.1" / "removed.html").touch()
    assert place(write_build(tmp_path / "b", "new"), site, "0.1.1") == ["0.1"]
    assert not (site / "0.1" / "removed.html").exists()
    assert "<title>new" in (site / "0.1" / "index.html").read_text()


def test_place_development_leads_to_newest_release_if_any(tmp_path):
    site, build = tmp_path / "site", write_build(tmp_path / "a")
    assert place(build, site, "dev") == ["dev"]
    assert 'url=dev/"' in (site / "index.html").read_text()
    place(build, site, "0.1.0")
    assert place(build, site, "dev") == ["dev", "0.1"]
    assert 'url=0.1/"' in (site / "index.html").read_text()


@pytest.mark.parametrize("missing", ["index.html", "search.html", "searchindex.js"])
def test_place_incomplete_build_raises_value_error_and_keeps_site(tmp_path, missing, capsys):
    site, build = tmp_path / "site", write_build(tmp_path / "a")
    place(build, site, "0.1.0")
    before = sorted(site.rglob("*"))
    (build / missing).unlink()
    assert main([str(build), str(site), "--version", "v0.1.1"]) == 1
    assert missing in capsys.readouterr().err
    assert sorted(site.rglob("*")) == before


@pytest.fixture
def no_git_settings(monkeypatch):
    """Let git ignore the settings of the user, and the variables of a hook that runs the tests."""
    for name in [name for name in os.environ if name.startswith("GIT_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", os.devnull)
    monkeypatch.setenv("GIT_CONFIG_NOSYSTEM", "1")


def git(folder, *words):
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    command = ["git", "-C", folder, *identity, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.mark.usefixtures("no_git_settings")
@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_publish_pushes_branch_that_holds_all_versions(tmp_path):
    remote, repository, site = (tmp_path / name for name in ("remote", "repository", "site"))
    subprocess.run(["git", "init", "-q", "--bare", remote], check=True)
    subprocess.run(["git", "init", "-q", repository], check=True)
    git(repository, "commit", "-q", "--allow-empty", "-m", "start")
    git(repository, "remote", "add", "origin", str(remote))
    build = write_build(tmp_path / "build")
    assert publish(repository, build, "v0.1.0", site) == ["0.1"]
    assert publish(repository, build, "dev", site) == ["dev", "0.1"]
    head = git(remote, "rev-parse", "gh-pages")
    files = git(remote, "ls-tree", "-r", "--name-only", "gh-pages").split()
    assert {".nojekyll", "versions.json", "dev/index.html", "0.1/howto/edit.html"} <= set(files)
    assert publish(repository, build, "dev", site) == ["dev", "0.1"]
    assert git(remote, "rev-parse", "gh-pages") == head  # equal pages make no commit
    assert not site.exists()
    assert git(repository, "status", "--porcelain") == ""


@pytest.fixture
def site_address(tmp_path):
    """The address of a site with three versions; the page howto/edit is absent in version 0.1."""
    for version in ("0.1.0", "0.2.0", "dev"):
        place(write_build(tmp_path / version, version), tmp_path / "site", version)
    (tmp_path / "site" / "0.1" / "howto" / "edit.html").unlink()

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_words):
            pass

    handler = functools.partial(Quiet, directory=str(tmp_path / "site"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.browser
def test_menu_of_versions_opens_same_page_or_start(site_address):
    with chromium() as browser:
        page = browser.new_page()
        page.set_default_timeout(TIMEOUT_MILLISECONDS)
        page.goto(site_address, wait_until="commit")  # this page loads the next one at once
        page.wait_for_url(f"{site_address}/0.2/")
        page.goto(f"{site_address}/dev/howto/edit.html")
        page.wait_for_selector("#versions select")
        options = page.locator("#versions option")
        assert options.all_inner_texts() == ["dev", "0.2 (newest)", "0.1"]
        assert page.locator("#versions select").input_value() == "dev"
        page.select_option("#versions select", "0.2")
        page.wait_for_url(f"{site_address}/0.2/howto/edit.html")
        page.wait_for_selector("#versions select")
        page.select_option("#versions select", "0.1")
        page.wait_for_url(f"{site_address}/0.1/")
        assert page.title() == "0.1.0"


@pytest.mark.browser
def test_menu_of_versions_is_hidden_in_opened_folder(tmp_path):
    build = write_build(tmp_path / "a")
    with chromium() as browser:
        page = browser.new_page()
        page.set_default_timeout(TIMEOUT_MILLISECONDS)
        errors = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto((build / "index.html").as_uri())
        wait_until(page, "document.readyState === 'complete'")
        assert not page.locator("#versions").is_visible()
        assert errors == []
