"""The package's own functions as JavaScript, so that a page computes as Python does.

The functions of `facets.optics`, and the solver's of `facets.estimation`, are written in the part
of Python that a compiler for floats understands: arithmetic, comparisons, loops over ranges,
tuples, named tuples, elements of arrays, and calls of each other. This module translates that part
to JavaScript, statement by statement, from the requested functions on to all that they call. Floats
of both languages are the same IEEE doubles and operations keep their order, so that results differ
by no more than the elementary functions do. Code that depends on the number type is translated for
floats. Arrays are nested lists, whose rows are parts of them as in NumPy. JavaScript lacks erf and
erfc; `numbers.js` has these.

An unknown construction is refused with its file and line.
"""

from __future__ import annotations

import ast
import inspect
import json
import math
import textwrap
from collections.abc import Callable, Iterable
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from ...scalars import dispatch, dual

#: Functions with their own JavaScript: elementary ones, and Python's built-in ones.
KNOWN: dict[Any, str] = {
    **{
        getattr(module, name): f"Math.{name}"
        for module in (math, dispatch)
        for name in ("exp", "sqrt", "log", "sin", "cos", "atan2")
    },
    math.erf: "erf",
    math.erfc: "erfc",
    math.isfinite: "Number.isFinite",
    math.hypot: "Math.hypot",
    dispatch.erf: "erf",
    dispatch.erfc: "erfc",
    dispatch.nan_unless_positive: "defined",
    dispatch.maximum: "larger",
    dispatch.select: "choose",
    dispatch.select_each: "choose",
    dispatch.where_any: "whereAny",
    dispatch.where_each: "whereEach",
    dispatch.sum_over: "sumOver",
    dispatch.holds_anywhere: "Boolean",
    dispatch.real: "Number",
    dispatch.round_product: "Number",
    dispatch.turn_together: "Number",
    abs: "Math.abs",
    int: "Math.trunc",
    float: "Number",
    bool: "Boolean",
    min: "least",
    max: "most",
    tuple: "Array.from",
    list: "Array.from",
    range: "range",
    zip: "zip",
    enumerate: "enumerate",
}
#: Where numbers carry derivatives, functions and operators are those of `dual.js`.
CARRYING: dict[Any, str] = {
    dispatch.sqrt: "carriedSqrt",
    dispatch.log: "carriedLog",
    dispatch.sin: "carriedSin",
    dispatch.cos: "carriedCos",
    dispatch.atan2: "carriedAtan2",
    dispatch.nan_unless_positive: "carriedDefined",
    dispatch.maximum: "carriedLarger",
    dispatch.real: "realOf",
    dual.value_and_slope: "valueAndSlope",
    dual.Dual: "new Dual",
    complex: "new Dual",
}
CARRYING_OPERATORS: dict[type, str] = {
    ast.Add: "plus", ast.Sub: "minus", ast.Mult: "times", ast.Div: "over",
}  # fmt: skip
OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "===", ast.NotEq: "!==",
    ast.Is: "===", ast.IsNot: "!==", ast.And: "&&", ast.Or: "||", ast.USub: "-", ast.Not: "!",
    ast.BitAnd: "&", ast.BitOr: "|",
}  # fmt: skip
NOT_FINITE = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}
#: JavaScript's reserved words, and the names of functions that translated texts call.
RESERVED = {
    "default", "delete", "function", "in", "new", "this", "typeof", "var", "void", "with",
    "negative", "realOf", "imagOf", *KNOWN.values(), *CARRYING_OPERATORS.values(),
}  # fmt: skip


def javascript(*functions: Callable[..., Any], carrying: Iterable[Callable[..., Any]] = ()) -> str:
    """Translate functions of the optics, and all that they need, to JavaScript.

    Each has the name that `name_of` gives.  carrying: functions that are written for numbers which
    carry derivatives, under names of their own. Raises `TypeError` for an unknown construction.
    """
    written: dict[str, str] = {}
    for function in functions:
        _write(function, written)
    for function in carrying:
        _write(function, written, True)
    return "\n\n".join(written.values())


def name_of(thing: Any, carries: bool = False) -> str:
    """The JavaScript name of a function or named tuple of the optics: `forward_readings`."""
    suffix = "_carrying" if carries and isinstance(thing, FunctionType) else ""
    suffix = "_carrying" if makes_derivatives(thing) else suffix
    return f"{thing.__module__.rpartition('.')[2]}_{thing.__name__}{suffix}"


def makes_derivatives(thing: Any) -> bool:
    """Whether a function has numbers that carry a derivative, but no argument with one."""
    return isinstance(thing, FunctionType) and "complex" in thing.__code__.co_names


def literal(value: Any) -> str:
    """Write numbers, truth values and words in nested tuples and arrays, and named tuples and
    dictionaries by their keys."""
    if isinstance(value, np.ndarray):
        return literal(value.tolist())
    if hasattr(value, "_fields"):
        value = value._asdict()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}: {literal(each)}" for name, each in value.items()) + "}"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, tuple | list | range):
        return "[" + ", ".join(map(literal, value)) + "]"
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, int | float | np.number):
        text = repr(value if isinstance(value, int) else float(value))
        return NOT_FINITE.get(text, text)
    raise TypeError(f"{value!r} has no place in JavaScript")


def _write(thing: Any, written: dict[str, str], carries: bool = False) -> None:
    """Add a function, a named tuple or a constant and, before it, everything that it needs."""
    name, carries = name_of(thing, carries), carries or makes_derivatives(thing)
    if name in written:
        return
    written[name] = ""  # so that it is not begun again on the way
    if isinstance(thing, type):
        text = _constructor(thing)
    else:
        function = Function(thing, carries)
        text = function.text()
        for needed in function.functions:
            _write(needed, written, carries)
        for constant, value in function.constants.items():
            written.setdefault(constant, f"const {constant} = {literal(value)};")
    del written[name]
    written[name] = text


def _constructor(kind: Any) -> str:
    """Write a function that makes a named tuple: an object that also unpacks as a tuple."""
    fields = [_safe(field) for field in kind._fields]
    usual = {_safe(name): literal(value) for name, value in kind._field_defaults.items()}
    given = ", ".join(f"{field} = {usual[field]}" if field in usual else field for field in fields)
    parts, fields_of_this = ", ".join(fields), ", ".join(f"this.{field}" for field in fields)
    return (
        f"function {name_of(kind)}({given}) {{\n"
        f"  return {{{parts}, *[Symbol.iterator]() {{ yield* [{fields_of_this}]; }}}};\n}}"
    )


def is_named_tuple(kind: type) -> bool:
    return issubclass(kind, tuple) and hasattr(kind, "_fields")


def _safe(name: str) -> str:
    return f"{name}_" if name in RESERVED else name


class Function:
    """The translation of one function of the optics to JavaScript.

    functions: the called functions.  constants: those it reads, by name; complete after `text`.
    carries: whether numbers carry derivatives.
    """

    def __init__(self, function: Callable[..., Any], carries: bool = False) -> None:
        if not isinstance(function, FunctionType):
            raise TypeError(f"{function!r} is no function of the optics")
        self.function, self.globals = function, function.__globals__
        self.carries = carries
        self.known = {**KNOWN, **CARRYING} if carries else KNOWN
        self.functions: list[Any] = []
        self.constants: dict[str, Any] = {}
        lines, self.first = inspect.getsourcelines(function)
        definition = ast.parse(textwrap.dedent("".join(lines))).body[0]
        assert isinstance(definition, ast.FunctionDef)
        self.definition = definition
        self.arguments = [argument.arg for argument in definition.args.args]
        self.locals = {*self.arguments, *_local_names(definition)}

    def text(self) -> str:
        defaults = self.definition.args.defaults
        without = len(self.arguments) - len(defaults)
        given = [
            _safe(name) + (f" = {self.expression(defaults[n - without])}" if n >= without else "")
            for n, name in enumerate(self.arguments)
        ]
        body = self.block(self.definition.body, 1)
        used = sorted(_safe(name) for name in self.locals - set(self.arguments))
        if used:
            body.insert(0, f"  let {', '.join(used)};")
        head = f"function {name_of(self.function, self.carries)}({', '.join(given)}) {{"
        about = (inspect.getdoc(self.function) or "").partition("\n\n")[0].replace("*/", "* /")
        comment = "".join(f"// {line}\n" for line in about.splitlines())
        return comment + "\n".join([head, *body, "}"])

    def refuse(self, node: ast.AST) -> TypeError:
        line = self.first + getattr(node, "lineno", 1) - 1
        return TypeError(
            f"{inspect.getsourcefile(self.function)}, line {line}: "
            f"`{ast.unparse(node)}` is not understood; see {__name__}"
        )

    # statements

    def block(self, statements: Iterable[ast.stmt], depth: int) -> list[str]:
        """Return lines of JavaScript, without those after a statement that returns."""
        lines: list[str] = []
        for statement in statements:
            lines += ["  " * depth + line for line in self.statement(statement, depth)]
            if isinstance(statement, ast.Return):
                break
        return lines

    def asks_for_digits(self, test: ast.expr) -> bool:
        """Whether a test asks if numbers have more digits than floats, which these have not."""
        return isinstance(test, ast.Call) and self.callee(test.func) is dispatch.has_more_digits

    def statement(self, node: ast.stmt, depth: int) -> list[str]:
        """Return the lines of one statement, with its inner lines already indented."""
        pad = "  " * depth
        if isinstance(node, ast.If):
            return self.conditional(node, depth)
        if isinstance(node, ast.While):
            return [
                f"while ({self.expression(node.test)}) {{",
                *self.inner_block(node.body, depth, pad),
                "}",
            ]
        if isinstance(node, ast.For):
            return [self.loop(node), *self.inner_block(node.body, depth, pad), "}"]
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return []  # a docstring
        return ["" if isinstance(node, ast.Pass) else f"{self.simple_statement(node)};"]

    def simple_statement(self, node: ast.stmt) -> str:
        """Write a statement without an inner block, without its semicolon."""
        match node:
            case ast.Expr():
                return self.expression(node.value)
            case ast.Return():
                return f"return {self.expression(node.value)}" if node.value else "return"
            case ast.Assign():
                value = self.expression(node.value)
                for target in reversed(node.targets):
                    value = f"{self.target(target)} = {value}"
                return value
            case ast.AnnAssign(value=ast.expr() as value):
                return f"{self.target(node.target)} = {self.expression(value)}"
            case ast.AugAssign(op=ast.Add(), value=ast.List() | ast.ListComp() as more):
                return f"{self.target(node.target)}.push(...{self.expression(more)})"
            case ast.AugAssign():
                place = self.target(node.target)
                return f"{place} = {self.binary(node.op, place, self.expression(node.value), node)}"
            case ast.Continue() | ast.Break():
                return ast.unparse(node)
        raise self.refuse(node)

    def inner_block(self, body: list[ast.stmt], depth: int, pad: str) -> list[str]:
        """Return a block's lines, indented once within the enclosing block."""
        return [line.removeprefix(pad) for line in self.block(body, depth + 1)]

    def conditional(self, node: ast.If, depth: int) -> list[str]:
        pad = "  " * depth
        if self.asks_for_digits(node.test):
            return [line.removeprefix(pad) for line in self.block(node.orelse, depth)]
        lines = [f"if ({self.expression(node.test)}) {{", *self.inner_block(node.body, depth, pad)]
        if node.orelse:
            lines += ["} else {", *self.inner_block(node.orelse, depth, pad)]
        return [*lines, "}"]

    def loop(self, node: ast.For) -> str:
        target, over = self.target(node.target), node.iter
        is_range = isinstance(over, ast.Call) and getattr(over.func, "id", "") == "range"
        if not is_range:
            return f"for ({target} of {self.expression(over)}) {{"
        assert isinstance(over, ast.Call)
        bounds = [self.expression(each) for each in over.args]
        start, end = ("0", bounds[0]) if len(bounds) == 1 else bounds[:2]
        step = bounds[2] if len(bounds) > 2 else "1"
        how = ">" if step.lstrip("(").startswith("-") else "<"
        return f"for ({target} = {start}; {target} {how} {end}; {target} += {step}) {{"

    def target(self, node: ast.expr) -> str:
        if isinstance(node, ast.Tuple):
            return "[" + ", ".join(self.target(part) for part in node.elts) + "]"
        if isinstance(node, ast.Name):
            return _safe(node.id)
        if isinstance(node, ast.Subscript):
            return self.expression(node)
        raise self.refuse(node)

    # expressions

    def expression(self, node: ast.expr) -> str:
        """Write an expression, with brackets that keep Python's order."""
        if type(node) not in EXPRESSIONS:
            raise self.refuse(node)
        return EXPRESSIONS[type(node)](self, node)

    def constant(self, node: ast.Constant) -> str:
        if not isinstance(node.value, bool | int | float | str | None):
            raise self.refuse(node)
        return literal(node.value)

    def sequence(self, node: ast.Tuple | ast.List) -> str:
        return "[" + ", ".join(map(self.expression, node.elts)) + "]"

    def dictionary(self, node: ast.Dict) -> str:
        if not all(isinstance(key, ast.Constant) for key in node.keys):
            raise self.refuse(node)
        pairs = zip(map(ast.unparse, filter(None, node.keys)), node.values, strict=True)
        return "({" + ", ".join(f"{key}: {self.expression(value)}" for key, value in pairs) + "})"

    def spread(self, node: ast.Starred) -> str:
        return f"...{self.expression(node.value)}"

    def unary(self, node: ast.UnaryOp) -> str:
        if type(node.op) not in OPERATORS:
            raise self.refuse(node)
        if self.carries and isinstance(node.op, ast.USub):
            return f"negative({self.expression(node.operand)})"
        return f"({OPERATORS[type(node.op)]}{self.expression(node.operand)})"

    def arithmetic(self, node: ast.BinOp) -> str:
        return self.binary(node.op, self.expression(node.left), self.expression(node.right), node)

    def logic(self, node: ast.BoolOp) -> str:
        return "(" + f" {OPERATORS[type(node.op)]} ".join(map(self.expression, node.values)) + ")"

    def choice(self, node: ast.IfExp) -> str:
        parts = map(self.expression, (node.test, node.body, node.orelse))
        return "({} ? {} : {})".format(*parts)

    def binary(self, operator: ast.operator, left: str, right: str, node: ast.AST) -> str:
        if self.carries and type(operator) in CARRYING_OPERATORS:
            return f"{CARRYING_OPERATORS[type(operator)]}({left}, {right})"
        if isinstance(operator, ast.FloorDiv):
            return f"Math.floor({left} / {right})"
        if isinstance(operator, ast.Mod):  # counts are not negative
            return f"({left} % {right})"
        if type(operator) not in OPERATORS:
            raise self.refuse(node)
        return f"({left} {OPERATORS[type(operator)]} {right})"

    def comparison(self, node: ast.Compare) -> str:
        write = self.real_part if self.carries else self.expression
        parts, left = [], write(node.left)
        for operator, each in zip(node.ops, node.comparators, strict=True):
            right = write(each)
            if isinstance(operator, ast.In):
                parts.append(f"{right}.includes({left})")
            elif type(operator) in OPERATORS:
                parts.append(f"{left} {OPERATORS[type(operator)]} {right}")
            else:
                raise self.refuse(node)
            left = right
        return "(" + " && ".join(parts) + ")"

    def real_part(self, node: ast.expr) -> str:
        return f"realOf({self.expression(node)})"

    def subscript(self, node: ast.Subscript) -> str:
        value = self.expression(node.value)
        index = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for each in index:
            if isinstance(each, ast.Slice):
                value = self.part(value, each)
            elif isinstance(each, ast.UnaryOp):
                value += f".at({self.expression(each)})"
            else:
                value += f"[{self.expression(each)}]"
        return value

    def part(self, value: str, node: ast.Slice) -> str:
        if node.step:
            ends = (self.expression(end) if end else "null" for end in (node.lower, node.upper))
            return f"everyNth({value}, {', '.join(ends)}, {self.expression(node.step)})"
        start = self.expression(node.lower) if node.lower else "0"
        return f"{value}.slice({start}{f', {self.expression(node.upper)}' if node.upper else ''})"

    def comprehension(self, node: ast.ListComp | ast.GeneratorExp) -> str:
        (loop,) = node.generators
        target, items = self.target(loop.target), self.expression(loop.iter)
        for condition in loop.ifs:
            items = f"Array.from({items}).filter(({target}) => {self.expression(condition)})"
        return f"Array.from({items}, ({target}) => {self.expression(node.elt)})"

    def attribute(self, node: ast.Attribute) -> str:
        if isinstance(node.value, ast.Name) and node.value.id not in self.locals:
            owner = self.value_of(node.value.id)
            if isinstance(owner, ModuleType):
                return self.module_value(getattr(owner, node.attr), node.attr, owner.__name__, node)
        if self.carries and node.attr in ("real", "imag"):
            return f"{node.attr}Of({self.expression(node.value)})"
        return f"{self.expression(node.value)}.{_safe(node.attr)}"

    def call(self, node: ast.Call) -> str:
        callee = self.callee(node.func)
        if isinstance(node.func, ast.Name) and node.func.id in self.locals:
            return f"{_safe(node.func.id)}({', '.join(map(self.expression, node.args))})"
        if callee is len:
            return f"{self.expression(node.args[0])}.length"
        if callee is getattr:
            return "{}[{}]".format(*map(self.expression, node.args))
        if isinstance(node.func, ast.Attribute) and callee is None:
            return self.call_of_method(node, node.func)
        if callee is dispatch.pi:
            return "Math.PI"
        if callee in self.known:
            given = ", ".join(map(self.expression, node.args))
            alone = callee in (min, max) and len(node.args) == 1
            return f"{self.known[callee]}({'...' * alone}{given})"
        if not isinstance(callee, type | FunctionType):
            raise self.refuse(node)
        name = self.module_value(callee, callee.__name__, callee.__module__, node)
        return f"{name}({', '.join(self.ordered_arguments(callee, node))})"

    def call_of_method(self, node: ast.Call, method: ast.Attribute) -> str:
        """Write a named tuple with other values, or what makes a list longer."""
        owner = self.expression(method.value)
        if method.attr == "append":
            return f"{owner}.push({self.expression(node.args[0])})"
        if method.attr != "_replace" or node.args:
            raise self.refuse(node)
        given = (f"{_safe(str(k.arg))}: {self.expression(k.value)}" for k in node.keywords)
        return f"({{...{owner}, {', '.join(given)}}})"

    def ordered_arguments(self, function: Any, node: ast.Call) -> list[str]:
        """Return a call's arguments in the order of the function's parameters."""
        given = list(map(self.expression, node.args))
        if not node.keywords:
            return given
        named = {each.arg: self.expression(each.value) for each in node.keywords}
        order = list(inspect.signature(function).parameters)[len(given) :]
        given += [named.pop(name, "undefined") for name in order]
        if named:
            raise self.refuse(node)
        return given

    def callee(self, node: ast.expr) -> Any:
        """Return the called function, resolved as Python does."""
        if isinstance(node, ast.Name):
            return None if node.id in self.locals else self.value_of(node.id)
        owner = node.value if isinstance(node, ast.Attribute) else None
        if isinstance(owner, ast.Name) and owner.id not in self.locals:
            return getattr(self.value_of(owner.id), node.attr, None)  # type: ignore[attr-defined]
        return None

    def value_of(self, name: str) -> Any:
        """Return the value of a name outside the function."""
        if name in self.globals:
            return self.globals[name]
        return getattr(__import__("builtins"), name, None)

    def name(self, node: ast.Name) -> str:
        if node.id in self.locals:
            return _safe(node.id)
        return self.module_value(self.value_of(node.id), node.id, self.function.__module__, node)

    def module_value(self, value: Any, name: str, module: str, node: ast.AST) -> str:
        """Write a function, a class or a constant of a module, and record that it is needed."""
        if isinstance(value, float | bool) or (isinstance(value, int) and name.isupper()):
            return literal(value)
        if isinstance(value, FunctionType) or (isinstance(value, type) and is_named_tuple(value)):
            self.functions.append(value)
            return name_of(value, self.carries)
        if isinstance(value, np.ndarray | tuple | range):
            constant = f"{module.rpartition('.')[2]}_{name}"
            self.constants[constant] = value
            return constant
        raise self.refuse(node)


#: The writers of expressions, by kind.
EXPRESSIONS: dict[type, Callable[[Function, Any], str]] = {
    ast.Constant: Function.constant,
    ast.Name: Function.name,
    ast.Tuple: Function.sequence,
    ast.List: Function.sequence,
    ast.Starred: Function.spread,
    ast.Attribute: Function.attribute,
    ast.Subscript: Function.subscript,
    ast.BinOp: Function.arithmetic,
    ast.UnaryOp: Function.unary,
    ast.BoolOp: Function.logic,
    ast.Compare: Function.comparison,
    ast.IfExp: Function.choice,
    ast.Call: Function.call,
    ast.Dict: Function.dictionary,
    ast.ListComp: Function.comprehension,
    ast.GeneratorExp: Function.comprehension,
}


def _local_names(definition: ast.FunctionDef) -> set[str]:
    """Return the names that a function's own statements assign."""
    return {
        node.id
        for node in ast.walk(definition)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
