"""The part of three.js that pages contain: its origin, its names, and the size of pages."""

import hashlib
import re
import shutil
import subprocess
from importlib.resources import files

import pytest

from mograft import view
from mograft.viewing.page import embed_json
from release import three
from tests.viewing.page_content import page_data

MAX_PAGE_BYTES = 700_000
"""Maximum size of a page without the data of motions."""


def test_three_has_recorded_hash_licence_and_version():
    content = three.TARGET.read_bytes()
    assert hashlib.sha256(content).hexdigest() == three.DIGEST.read_text().strip()
    head = content[:2000].decode()
    assert head.startswith(f"/*!\nthree.js {three.read_version()}, ")
    assert three.read_licence() in head
    assert files("mograft.viewing").joinpath("three.js").read_bytes() == content
    notices = (three.ROOT / "THIRD-PARTY-LICENSES.txt").read_text(encoding="utf-8")
    assert f"three.js {three.read_version()}" in notices
    assert notices.count(three.read_licence()) == 1


def test_three_exports_exactly_the_names_that_the_scripts_use():
    text = three.TARGET.read_text(encoding="utf-8")
    table = max(re.findall(r"\{((?:\w+:\(\)=>[\w$]+,?)+)\}", text), key=len)
    assert set(re.findall(r"(\w+):\(\)=>", table)) == set(three.used_names())


def test_three_new_build_has_same_bytes(monkeypatch, tmp_path):
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    monkeypatch.setenv("npm_config_cache", str(tmp_path / "cache"))
    try:
        content = three.build()
    except subprocess.CalledProcessError as error:
        pytest.skip(f"the registry of npm is not available: {error}")
    assert content == three.TARGET.read_bytes()


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
