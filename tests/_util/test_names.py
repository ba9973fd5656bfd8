"""Names of files are accepted by Linux, macOS and Windows."""

import re

from hypothesis import example, given
from hypothesis import strategies as st

from mograft._util.names import portable_stem

DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d|conin\$|conout\$)", re.IGNORECASE)
names = st.text(max_size=300) | st.from_regex(r"(?i)(con|nul|lpt1|walk)[ .]?[a-z.: ]{0,4}")


def is_portable(name):
    """Return whether Windows, with the strictest rules, accepts a name."""
    return (
        bool(name)
        and len(name.encode("utf-8", "surrogateescape")) <= 255
        and not re.search(r'[<>:"/\\|?*\x00-\x1f]', name)
        and name[-1] not in " ."
        and not DEVICE.fullmatch(name.partition(".")[0].rstrip())
    )


@given(names)
@example("CON")
@example("con .bvh")
@example("a.")
@example("")
@example("\udcff")
@example("\ud800")
@example("ä" * 200)
@example("a" * 219 + ". b")
def test_portable_stem_any_text_gives_name_that_windows_accepts(name):
    assert is_portable(portable_stem(name))
    assert is_portable(portable_stem(name) + "_graft0.bvh")


@given(names)
def test_portable_stem_twice_changes_nothing_more(name):
    assert portable_stem(portable_stem(name)) == portable_stem(name)


@given(st.from_regex(r"[\w][\w \-.~()#]{0,40}\w", fullmatch=True))
def test_portable_stem_accepted_name_is_unchanged(name):
    if is_portable(name) and len(name.encode()) <= 220:
        assert portable_stem(name) == name
