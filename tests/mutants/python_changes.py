"""Changes of Python: operators, comparisons, signs, numbers, returned values, swapped arguments, dropped statements."""

from __future__ import annotations

import ast
from collections.abc import Iterator

OPERATORS: dict[type, type] = {
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult},
    **{ast.Pow: ast.Mult, ast.Mod: ast.FloorDiv, ast.And: ast.Or, ast.Or: ast.And, ast.BitAnd: ast.BitOr},
    **{ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In},
}
SYMMETRIC = {"max", "min", "zip", "isinstance", "issubclass", "getattr", "hasattr"}  # or never run swapped


def change(node: ast.AST) -> ast.AST | None:
    """Returns what is put in the place of an expression or a statement; None for one that stays."""
    match node:
        case ast.BinOp(left, operator, right) if type(operator) in OPERATORS:
            return ast.BinOp(left, OPERATORS[type(operator)](), right)
        case ast.BoolOp(operator, values):
            return ast.BoolOp(OPERATORS[type(operator)](), values)
        case ast.Compare(left, [first, *others], right):
            return ast.Compare(left, [OPERATORS[type(first)](), *others], right)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            return operand
        case ast.Constant(bool() as value):
            return ast.Constant(not value)
        case ast.Constant(int() as value):
            return ast.Constant(value + 1)
        case ast.Constant(float() as value) if not 0 < value < 1e-6:  # else only against division by 0
            return ast.Constant(1.25 * value or 1.0)
        case ast.Return(ast.expr() as value) if not isinstance(value, ast.Constant):
            return ast.Return(ast.UnaryOp(ast.USub(), value))
        case ast.AugAssign(target, operator, value) if type(operator) in OPERATORS:
            return ast.AugAssign(target, OPERATORS[type(operator)](), value)
        case ast.Call(function, [first, second, *others], keywords) if not is_symmetric(node):
            return ast.Call(function, [second, first, *others], keywords)
        case ast.Expr(ast.Call()) | ast.Raise() | ast.Continue() | ast.Break():
            return ast.Pass()
        case ast.Assign([ast.Name(name)], value) if any(
            isinstance(part, ast.Name) and part.id == name for part in ast.walk(value)
        ):
            return ast.Pass()
    return None


def is_symmetric(call: ast.Call) -> bool:
    """Returns whether a call with its first two arguments swapped would say nothing."""
    first, second = call.args[:2]
    name = call.func.id if isinstance(call.func, ast.Name) else ""
    starred = isinstance(first, ast.Starred) or isinstance(second, ast.Starred)
    return starred or name in SYMMETRIC or ast.dump(first) == ast.dump(second)


def find_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yields what can be changed in a node: no type, overload, decorator, docstring or message."""
    skipped: list[ast.AST | None] = []
    match node:
        case ast.Raise():
            yield node
            return
        case ast.Assert() | ast.JoinedStr() | ast.If(ast.Name("TYPE_CHECKING")):
            return
        case ast.FunctionDef(decorator_list=[ast.Name("overload")]):
            return
        case ast.FunctionDef(decorator_list=decorators, returns=returns):
            skipped = [*decorators, returns]
        case ast.ClassDef(decorator_list=decorators):
            skipped = [*decorators]
        case ast.AnnAssign(annotation=annotation) | ast.arg(annotation=annotation):
            skipped = [annotation]
        case ast.Call(ast.Attribute(attr="warn" | "add_argument")) | ast.keyword(arg="strict"):  # the latter: of zip
            return
    if change(node) is not None:
        yield node
    for child in ast.iter_child_nodes(node):
        if child not in skipped:
            yield from find_nodes(child)


def find_changes(source: bytes) -> Iterator[tuple[int, int, int, str]]:
    """Yields line, first byte, end and new text of all changes of a file."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in find_nodes(ast.parse(source)):
        assert isinstance(node, ast.expr | ast.stmt)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        new = ast.unparse(ast.fix_missing_locations(change(node) or node))
        yield node.lineno, start, end, f"({new})" if isinstance(node, ast.expr) else new
