"""The script of the viewer: its modules share one scope in the page."""

import re
from importlib.resources import files

from mograft.viewing.page import _SCRIPTS

IMPORT = re.compile(r'^import \{ ([\w, ]+) \} from "\./(\w+)\.js";$', re.MULTILINE)
DECLARED = re.compile(
    r"^(export )?(?:async )?(?:function|const|let|class) (\w+|\{[\w, ]+\})", re.MULTILINE
)


def modules():
    folder = files("mograft.viewing").joinpath("script")
    return {name: folder.joinpath(f"{name}.js").read_text("utf-8") for name in _SCRIPTS}


def test_script_modules_use_imports_of_earlier_modules_only():
    exported = {}
    for name, text in modules().items():
        imports = IMPORT.findall(text)
        assert len(imports) == text.count("import ")
        for names, module in imports:
            assert set(names.split(", ")) <= exported[module], (name, module)
            for own in names.split(", "):
                assert len(re.findall(rf"\b{own}\b", text)) > 1, (name, own)
        exported[name] = {own for word, own in DECLARED.findall(text) if word}


def test_script_top_level_names_are_unique():
    declared = [own for text in modules().values() for _, own in DECLARED.findall(text)]
    assert len(declared) == len(set(declared))
