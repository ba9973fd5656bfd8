"""Damaged settings, groups, tags and provenance give a result or one line of error."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mograft.cli import main

SETTINGS = 'seed = 7\n[graft]\nvariety = 0.3\n[set]\nchoice = "viterbi"\n'
TAGS = "clip,tags\na.bvh,walk,slow\n*.bvh,run\n"
COMMANDS = {
    "mograft.toml": ["config", "show", "graft"],
    "groups.toml": ["candidates", "a.bvh", "--segment", "3", "--groups", "groups.toml"],
    "tags.csv": ["index", "a.bvh", "-o", "library", "--force", "--tags", "tags.csv"],
    "a_graft.json": ["graft", "--from", "a_graft.json", "-o", "again.bvh", "--force"],
}

scalars = st.one_of(
    st.none(), st.booleans(), st.integers(-10, 10**20), st.floats(), st.text(max_size=6)
)


def list_places(value):
    """Return (container, key) of each entry of a JSON document."""
    keys = list(value) if isinstance(value, dict) else range(len(value))
    places = [(value, key) for key in keys]
    inner = (value[key] for key in keys if isinstance(value[key], dict | list))
    return places + [place for each in inner for place in list_places(each)]


@st.composite
def damaged_bytes(draw, text):
    """A text in which bytes, or the values of a JSON document, were changed."""
    if text.startswith("{") and draw(st.booleans()):
        document = json.loads(text)
        for _ in range(draw(st.integers(1, 3))):
            container, key = draw(st.sampled_from(list_places(document)))
            container[key] = draw(st.one_of(scalars, st.lists(scalars, max_size=3)))
        return json.dumps(document).encode("utf-8", "surrogatepass")
    data = bytearray(text.encode())
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        stop = start + draw(st.integers(0, 12))
        data[start:stop] = draw(st.sampled_from([b"", b"[", b'"', b"\n", b"=", b"\0", b"9" * 30]))
    return bytes(data)


@pytest.fixture(scope="module")
def valid(clip, tmp_path_factory):
    """A valid text of each file."""
    folder = tmp_path_factory.mktemp("valid")
    assert main(["graft", str(clip), "-o", str(folder / "a_graft.bvh")]) == 0
    assert main(["groups", str(clip), "-o", str(folder / "groups.toml")]) == 0
    (folder / "mograft.toml").write_text(SETTINGS)
    (folder / "tags.csv").write_text(TAGS)
    return {name: (folder / name).read_text() for name in COMMANDS}


@pytest.mark.parametrize("name", COMMANDS)
def test_damaged_file_gives_an_exit_code_and_no_exception(
    working_folder, clip, valid, capsys, name, request
):
    (working_folder / "a.bvh").symlink_to(clip)
    Path(name).write_text(valid[name])
    assert main(COMMANDS[name]) == 0
    n_examples = 300 if request.config.getoption("--thorough") else 15

    @settings(max_examples=n_examples, suppress_health_check=list(HealthCheck), deadline=None)
    @given(damaged_bytes(valid[name]))
    def check(data):
        Path(name).write_bytes(data)
        try:
            code = main(COMMANDS[name])
        except SystemExit as stop:
            code = stop.code
        err = capsys.readouterr().err
        assert code in (0, 1, 2, 3, 4)
        assert code == 0 or "error: " in err.splitlines()[-1]

    check()
