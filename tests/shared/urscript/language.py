"""The part of URScript that exported programs may use: grammar, arity and units of each call, and an interpreter."""

import math
from collections.abc import Callable
from typing import Any

from lark import Lark, Token, Tree

GRAMMAR = r"""
start: (function | statement)*
function: "def" NAME "(" [NAME ("," NAME)*] ")" ":" block "end"
block: statement+
?statement: "local" NAME "=" expression -> local
    | "global" NAME "=" expression -> set_global
    | NAME "=" expression -> assign
    | NAME "[" expression "]" "=" expression -> put
    | "if" expression ":" block ["else" ":" block] "end" -> if_
    | "while" expression ":" block "end" -> while_
    | "return" expression -> return_
    | "halt" -> halt
    | call
?expression: comparison
?comparison: sum (COMPARE sum)? | "not" comparison -> not_
?sum: product | sum "+" product -> add | sum "-" product -> sub
?product: atom | product "*" atom -> mul | product "/" atom -> div
?atom: NUMBER -> number | "-" atom -> neg | STRING -> string | "True" -> true | "False" -> false
    | call | NAME "[" expression "]" -> item | NAME -> name
    | "p" "[" expression ("," expression)* "]" -> pose | "[" expression ("," expression)* "]" -> list
    | "(" expression ")"
call: NAME "(" [expression ("," expression)*] ")"
COMPARE: "<=" | ">=" | "==" | "<" | ">"
NAME: /(?!(def|end|if|else|while|return|halt|local|global|not|True|False)\b)[a-zA-Z_]\w*/
NUMBER: /\d+(\.\d+)?(?![eE\d.])/
STRING: /"[^"\n]*"/
COMMENT: /#[^\n]*/
%ignore COMMENT
%import common.WS
%ignore WS
"""
PARSER = Lark(GRAMMAR, parser="lalr")

# What each built-in takes: a pose or list of six with units, or a scalar with its unit.
TWIST, WRENCH, POSE = "m/s m/s m/s rad/s rad/s rad/s", "N N N Nm Nm Nm", "pose"
BUILT_IN: dict[str, tuple[str, ...]] = {
    "force_mode": (POSE, "0|1 0|1 0|1 0|1 0|1 0|1", WRENCH, "type", "limits"),
    "end_force_mode": (),
    "force_mode_set_damping": ("0..1",),
    "force_mode_set_gain_scaling": ("0..2",),
    "zero_ftsensor": (),
    "movel": (POSE, "m/s^2", "m/s", "s", "m"),
    "speedl": (TWIST, "m/s^2", "s", "rad/s^2"),
    "stopl": ("m/s^2", "rad/s^2"),
    "get_steptime": (),
    "get_tcp_force": (),
    "get_actual_tcp_pose": (),
    "get_actual_tcp_speed": (),
    "point_dist": (POSE, POSE),
    "pose_trans": (POSE, POSE),
    "pose_inv": (POSE,),
    "sqrt": ("number",),
    "pow": ("number", "number"),
    "cos": ("rad",),
    "sin": ("rad",),
    "sleep": ("s",),
    "textmsg": ("text", "text"),
}


def parsed(text: str) -> Tree[Token]:
    return PARSER.parse(text)


def calls(tree: Tree[Token]) -> list[Tree[Token]]:
    return [node for node in tree.iter_subtrees_topdown() if node.data == "call"]


def arguments(call: Tree[Token]) -> list[Any]:
    return [child for child in call.children[1:] if child is not None]


def constant(node: Any) -> Any:
    """The value of an expression without names; None where it has some."""
    try:
        return Interpreter({}).value(node, {})
    except KeyError:
        return None


def faults(tree: Tree[Token]) -> list[str]:
    """Calls with the wrong name, number of arguments, or a constant that its unit does not allow."""
    functions = {node.children[0]: len([c for c in node.children[1:-1] if c]) for node in tree.find_data("function")}
    found = []
    for call in calls(tree):
        name, given = str(call.children[0]), arguments(call)
        wanted = BUILT_IN.get(name)
        if name in functions:
            if len(given) != functions[name]:
                found.append(f"{name} takes {functions[name]} arguments, not {len(given)}")
        elif wanted is None:
            found.append(f"{name} is no function")
        elif len(given) != len(wanted):
            found.append(f"{name} takes {len(wanted)} arguments, not {len(given)}")
        else:
            found += [f"{name}: {why}" for node, unit in zip(given, wanted, strict=True) if (why := _wrong(node, unit))]
    return found


def _wrong(node: Any, unit: str) -> str:
    if unit == POSE:
        is_pose = node.data in ("call", "name", "item") or (node.data == "pose" and len(node.children) == 6)
        return "" if is_pose else f"no pose for {unit}"
    if unit == "text":
        return "" if node.data in ("string", "name") else "no text"
    value = constant(node)
    if value is None:
        return ""
    if " " in unit or unit == "limits":
        if node.data != "list" or len(value) != 6:
            return f"no list of six for {unit}"
        if unit == "0|1 0|1 0|1 0|1 0|1 0|1" and not all(v in (0, 1) for v in value):
            return "selection is not of 0 and 1"
        return "a limit is not positive" if unit == "limits" and min(value) <= 0 else ""
    if not isinstance(value, float):
        return f"no number for {unit}"
    if unit == "type":
        return "" if value == 2 else "the frame would move"
    if ".." in unit:
        low, high = map(float, unit.split(".."))
        return "" if low <= value <= high else f"{value} is outside {unit}"
    return "" if value >= 0 else f"negative {unit}"


class Halt(Exception):
    """The program stopped itself."""


class _Return(Exception):
    def __init__(self, value: Any) -> None:
        self.value = value


class Interpreter:
    """Runs a parsed program; `built_in` are the functions of the robot."""

    def __init__(self, built_in: dict[str, Callable[..., Any]]) -> None:
        self.built_in, self.functions, self.globals = built_in, {}, {}

    def run(self, tree: Tree[Token]) -> None:
        self.functions = {str(node.children[0]): node for node in tree.find_data("function")}
        for node in tree.children:
            if node.data != "function":
                self.execute(node, {})

    def block(self, node: Tree[Token], local: dict[str, Any]) -> None:
        for statement in node.children:
            self.execute(statement, local)

    def execute(self, node: Tree[Token], local: dict[str, Any]) -> None:
        match node.data:
            case "local":
                local[str(node.children[0])] = self.value(node.children[1], local)
            case "set_global":
                self.globals[str(node.children[0])] = self.value(node.children[1], local)
            case "assign":
                name = str(node.children[0])
                (local if name in local else self.globals)[name] = self.value(node.children[1], local)
            case "put":
                name, at, given = str(node.children[0]), *(self.value(child, local) for child in node.children[1:])
                (local if name in local else self.globals)[name][int(at)] = given
            case "if_":
                wanted, first, second = node.children
                chosen = first if self.value(wanted, local) else second
                if chosen is not None:
                    self.block(chosen, local)
            case "while_":
                while self.value(node.children[0], local):
                    self.block(node.children[1], local)
            case "return_":
                raise _Return(self.value(node.children[0], local))
            case "halt":
                raise Halt
            case "call":
                self.value(node, local)
            case other:
                raise ValueError(f"{other} is no statement")

    def call(self, node: Tree[Token], local: dict[str, Any]) -> Any:
        name, given = str(node.children[0]), [self.value(child, local) for child in arguments(node)]
        if name not in self.functions:
            return self.built_in[name](*given)
        _, *parameters, body = self.functions[name].children
        try:
            self.block(body, dict(zip((str(p) for p in parameters if p), given, strict=True)))
        except _Return as answer:
            return answer.value
        return None

    def value(self, node: Any, local: dict[str, Any]) -> Any:
        def at(k: int) -> Any:
            return self.value(node.children[k], local)

        match node.data:
            case "number":
                return float(node.children[0])
            case "string":
                return str(node.children[0])[1:-1]
            case "true" | "false":
                return node.data == "true"
            case "neg":
                return -at(0)
            case "not_":
                return not at(0)
            case "add":
                return at(0) + at(1)
            case "sub":
                return at(0) - at(1)
            case "mul":
                return at(0) * at(1)
            case "div":
                return at(0) / at(1)
            case "comparison":
                a, b = at(0), at(2)
                return {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b, "==": a == b}[str(node.children[1])]
            case "pose" | "list":
                return [self.value(child, local) for child in node.children]
            case "name" | "item":
                name = str(node.children[0])
                found = local[name] if name in local else self.globals[name]
                return found if node.data == "name" else found[int(at(1))]
            case "call":
                return self.call(node, local)
            case other:
                raise ValueError(f"{other} is no expression")


def distance(a: list[float], b: list[float]) -> float:
    return math.dist(a[:3], b[:3])
