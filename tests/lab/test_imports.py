"""The laboratory imports public names, and a short list of further modules in its README."""

import ast
import re
from pathlib import Path

import mograft

ROOT = Path(__file__).parents[2]
PUBLIC = (
    "mograft.evaluation",
    "mograft.scenario",
    "mograft.dancer",
    "mograft.clustering",
    "mograft.constraints",
)
TEXT = (ROOT / "lab" / "README.md").read_text(encoding="utf-8")
LISTED = re.findall(r"^- `(mograft\.[\w.]+)`", TEXT, re.MULTILINE)


def imported_modules(path):
    """Yield the modules of the package that a file imports, and the names from the top level."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module, tuple(alias.name for alias in node.names)


def test_lab_imports_public_names_and_listed_modules():
    used = set()
    for path in sorted((ROOT / "lab").rglob("*.py")):
        for module, names in imported_modules(path):
            if module == "mograft":
                assert set(names) <= {*mograft.__all__, "evaluation"}, path
            elif module.startswith("mograft.") and not module.startswith(PUBLIC):
                assert module in LISTED, f"{path} imports {module}"
                used.add(module)
    assert used == set(LISTED)
    assert len(LISTED) <= 16


def test_product_and_benches_do_not_import_the_lab():
    for folder in ("python", "python-fbx", "benches"):
        for path in (ROOT / folder).rglob("*.py"):
            modules = [module for module, _ in imported_modules(path)]
            assert not any(name.split(".")[0] == "lab" for name in modules), path
