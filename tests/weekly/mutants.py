"""Small errors put into modules of mograft, for `tests.weekly.mutation`."""

import ast
import hashlib
import importlib.machinery
import importlib.util
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HIT = "_mutation_hit"  # builtin function by which instrumented modules report statements
HEAD = 0  # stands for the statements that run when a module is imported
_FLAGS = {"strict", "slots", "frozen", "kw_only", "eq", "stacklevel"}  # keywords left as they are
_SWAPS = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Mod: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """A change of a module, described independently of other lines of the module."""

    module: str
    line: str  # text of the changed line
    change: str
    repetition: int  # number of the same changes of the same line above it in the module
    number: int  # line number
    statement: int  # line number of the enclosing statement, or `HEAD`
    index: int  # of the change in the module

    @property
    def key(self):
        return (self.module.rpartition(".")[2], self.line, self.change, self.repetition)

    def hash(self, seed):
        return hashlib.sha256(repr((seed, self.key)).encode()).hexdigest()


class Mutation(ast.NodeTransformer):
    """Number all possible changes of a module, and make the one with number `chosen`, if any."""

    def __init__(self, chosen=None):
        self.chosen, self.sites, self.statement, self.in_function = chosen, [], HEAD, False

    def visit(self, node):
        before = self.statement, self.in_function
        if isinstance(node, ast.stmt) and self.in_function:
            self.statement = node.lineno
        changed = node
        for replacement in _replacements(node):
            if len(self.sites) == self.chosen:
                changed = ast.copy_location(replacement, node)
            change = f"{_text(node)} -> {_text(replacement)}"
            self.sites.append((node.lineno, self.statement, change))
        if isinstance(node, ast.FunctionDef):  # neither decorators nor annotations
            node.args.defaults = [self.visit(value) for value in node.args.defaults]
            self.in_function = True
            node.body = [self.visit(statement) for statement in node.body]
        elif isinstance(node, ast.AnnAssign):
            node.value = node.value and self.visit(node.value)
        elif isinstance(node, ast.ClassDef):
            node.body = [self.visit(statement) for statement in node.body]
        elif not (isinstance(node, ast.JoinedStr) or getattr(node, "arg", None) in _FLAGS):
            self.generic_visit(node)
        self.statement, self.in_function = before
        return changed


def _text(node):
    node = node.test if isinstance(node, ast.If) else node
    return " ".join(ast.unparse(ast.fix_missing_locations(node)).split())[:120]


def _replacements(node):
    """Yield the changed versions of a node, which share its children."""
    match node:
        case ast.Compare(left, [first, *others], values) if type(first) in _SWAPS:
            yield ast.Compare(left, [_SWAPS[type(first)](), *others], values)
        case ast.BinOp(left, operator, right) if type(operator) in _SWAPS:
            yield ast.BinOp(left, _SWAPS[type(operator)](), right)
        case ast.AugAssign(target, operator, value) if type(operator) in _SWAPS:
            yield ast.AugAssign(target, _SWAPS[type(operator)](), value)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(_SWAPS[type(operator)](), values)
        case ast.UnaryOp(ast.Not() | ast.USub() | ast.Invert(), operand):
            yield operand
        case ast.Constant(bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield ast.Constant(value + 1)
        case ast.If(test, body, others) | ast.IfExp(test, body, others):
            yield type(node)(ast.UnaryOp(ast.Not(), test), body, others)
        case ast.Expr(ast.Call()):
            yield ast.Pass()
        case ast.Break():
            yield ast.Continue()
        case ast.Continue():
            yield ast.Break()


def instrumented(tree, module):
    """Let each statement of each function report that it is executed."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    inner = {id(node): node for function in functions for node in ast.walk(function)}
    for node in inner.values():
        for field in ("body", "orelse", "finalbody"):
            statements = getattr(node, field, None)
            if isinstance(statements, list):
                setattr(node, field, [s for each in statements for s in _reported(each, module)])
    return tree


def _reported(statement, module):
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return [statement]  # a docstring stays the first statement
    place = ast.Tuple([ast.Constant(module), ast.Constant(statement.lineno)], ast.Load())
    report = ast.Expr(ast.Call(ast.Name(HIT, ast.Load()), [place], []))
    return [ast.copy_location(report, statement), statement]


class ChangedModules:
    """Import some modules with changed syntax trees: `changes` maps their names to functions."""

    def __init__(self, files, changes):
        self.files, self.changes = files, changes

    def find_spec(self, name, path=None, target=None):  # noqa: ARG002
        if name not in self.changes:
            return None
        loader = importlib.machinery.SourceFileLoader(name, str(self.files[name]))
        loader.get_code = self.code
        return importlib.util.spec_from_file_location(name, self.files[name], loader=loader)

    def code(self, name):
        tree = self.changes[name](ast.parse(self.files[name].read_text()))
        return compile(ast.fix_missing_locations(tree), self.files[name], "exec", dont_inherit=True)


def find_modules(names):
    """Return the files of packages and modules by module name."""
    files = {}
    for name in names:
        path = ROOT.joinpath("python", "mograft", *name.split("."))
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")]:
            parts = file.relative_to(ROOT / "python").with_suffix("").parts
            if parts[-1] != "__init__":
                files[".".join(parts)] = file
    return files


def find_mutants(module, file):
    """Return all mutants of a module."""
    mutation = Mutation()
    mutation.visit(ast.parse(file.read_text()))
    lines, repetitions, mutants = file.read_text().splitlines(), Counter(), []
    for index, (number, statement, change) in enumerate(mutation.sites):
        line = lines[number - 1].strip()
        repetition = repetitions[line, change]
        repetitions[line, change] += 1
        mutants.append(Mutant(module, line, change, repetition, number, statement, index))
    return mutants


def draw(mutants, count, seed):
    """Return about `count` mutants in random order, a share of each module, at least one.

    All are drawn if `count` is None.
    """
    modules = defaultdict(list)
    for mutant in sorted(mutants, key=lambda mutant: mutant.hash(seed)):
        modules[mutant.module].append(mutant)
    drawn = [
        mutant
        for members in modules.values()
        for mutant in members[: count and max(1, round(count * len(members) / len(mutants)))]
    ]
    return sorted(drawn, key=lambda mutant: mutant.hash(seed))
