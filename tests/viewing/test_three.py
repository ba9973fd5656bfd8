"""The part of three.js that pages contain: its origin, its names, and the size of pages."""

import hashlib
import re
import shutil
import subprocess
from importlib.resources import files

import pytest

from mograft import view
from mograft.viewing.page import embed_json, viewer_script
from release import three
from tests.viewing.page_content import page_data

MAX_PAGE_BYTES = 700_000
"""Maximum size of a page without the data of motions."""


def test_three_has_recorded_hashes_licence_and_version():
    lines = [
        f"{hashlib.sha256(own.target.read_bytes()).hexdigest()}  {own.name}"
        for own in three.BUNDLES
    ]
    assert three.DIGESTS.read_text().splitlines() == lines
    for own in three.BUNDLES:
        head = own.target.read_bytes()[:2000].decode()
        assert head.startswith(f"/*!\nthree.js {three.read_version()}, ")
        assert three.read_licence() in head
        folder, name = own.name.removeprefix("python/").rsplit("/", 1)
        installed = files("mograft").joinpath(folder.removeprefix("mograft/"), name)
        assert installed.read_bytes() == own.target.read_bytes()
    notices = (three.ROOT / "THIRD-PARTY-LICENSES.txt").read_text(encoding="utf-8")
    assert f"three.js {three.read_version()}" in notices
    assert notices.count(three.read_licence()) == 1


@pytest.mark.parametrize("own", three.BUNDLES, ids=lambda own: own.name)
def test_three_exports_exactly_the_names_that_the_scripts_use(own):
    text = own.target.read_text(encoding="utf-8")
    table = max(re.findall(r"\{((?:\w+:\(\)=>[\w$]+,?)+)\}", text), key=len)
    assert set(re.findall(r"(\w+):\(\)=>", table)) == set(own.used_names())


def test_three_of_viewer_has_the_names_of_its_page():
    names = set(re.findall(r"\bTHREE\.(\w+)", viewer_script()))
    assert names == set(three.VIEWER.used_names())


@pytest.mark.parametrize("own", three.BUNDLES, ids=lambda own: own.name)
def test_three_new_build_has_same_bytes(own, monkeypatch, tmp_path):
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    monkeypatch.setenv("npm_config_cache", str(tmp_path / "cache"))
    try:
        content = own.build()
    except subprocess.CalledProcessError as error:
        pytest.skip(f"the registry of npm is not available: {error}")
    assert content == own.target.read_bytes()


@pytest.mark.parametrize("is_notebook", [False, True])
def test_page_without_motion_data_is_small(motion, is_notebook):
    short = motion[:2]
    page = view(short, show=False)
    text = page._repr_html_() if is_notebook else page.html
    data = page_data(page)
    poses = embed_json({key: data["clips"][0][key] for key in ("units", "pose")})
    n_bytes = len(text.encode()) - len(poses)
    print(f"{n_bytes} bytes without motion data")
    assert n_bytes <= MAX_PAGE_BYTES
