"""The laboratory imports public names, and a short list of further modules in its README."""

import ast
import re
from pathlib import Path

import mograft

ROOT = Path(__file__).parents[2]
PUBLIC = ("evaluation", "scenario", "dancer", "clustering", "constraints")
TEXT = (ROOT / "lab" / "README.md").read_text(encoding="utf-8")
LISTED = re.findall(r"^- `(mograft\.[\w.]+)`", TEXT, re.MULTILINE)


def imported_names(folder):
    """Yield the module and the names of each import from a package in the files of a folder."""
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                yield node.module, {alias.name for alias in node.names}
            elif isinstance(node, ast.Import):
                yield from ((alias.name, set()) for alias in node.names)


def test_lab_imports_public_names_and_listed_modules():
    used = set()
    for module, names in imported_names("lab"):
        if module == "mograft":
            assert names <= {*mograft.__all__, "evaluation"}
        elif module.startswith("mograft.") and module.split(".")[1] not in PUBLIC:
            used.add(module)
    assert used == set(LISTED)
    assert len(LISTED) <= 16


def test_product_and_benches_do_not_import_the_lab():
    modules = {m for name in ("python", "python-fbx", "benches") for m, _ in imported_names(name)}
    assert "lab" not in {module.split(".")[0] for module in modules}
