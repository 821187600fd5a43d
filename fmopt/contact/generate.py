"""Writes `kernels_generated.py` from the definitions of contacts: `python -m fmopt.contact.generate`."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import sympy
from sympy.printing.pycode import PythonCodePrinter

from fmopt.contact.algebra import Role
from fmopt.contact.definitions import CONTACTS
from fmopt.contact.derive import Derived, derived

FILE = Path(__file__).with_name("kernels_generated.py")
_HEAD = '''"""Kernels of primitive contacts, written by `python -m fmopt.contact.generate`: do not edit.

`tables` has records of the contacts of each kind, in the order of the definitions; all contacts
together are numbered in that order. A pose is its position p (3) in m and its rotation R (3, 3); distances are in m.
"""

from typing import Any, TypeAlias

from numpy import sqrt

from fmopt.runtime.compiled import part
from fmopt.spatial.kernels import turned, vector
from fmopt.spatial.values import Array

Tables: TypeAlias = tuple[Any, ...]
Row: TypeAlias = Any
Position: TypeAlias = Any
'''
_COUNT = '''

@part
def number_of(tables: Tables) -> int:
    """How many contacts there are."""
    {unpacked}
    return {total}
'''


class _Printer(PythonCodePrinter):  # type: ignore[misc]  # SymPy has no types
    """Small powers as products, so that all compilers do the same."""

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base, exponent = expr.args
        # Products are rounded alike by all compilers; a library's power is not.
        if exponent.is_Integer and 2 <= abs(exponent) <= 4:
            text = " * ".join([self.parenthesize(base, 60)] * abs(int(exponent)))
            return f"({text})" if exponent > 0 else f"(1.0 / ({text}))"
        if exponent == -1:
            return f"(1.0 / {self.parenthesize(base, 60)})"
        return str(super()._print_Pow(expr, rational=rational))

    def _print_Rational(self, expr: Any) -> str:
        return repr(float(expr))

    _print_Integer = _print_Rational


def written() -> str:
    """The text of the file."""
    kinds = [derived(name) for name in CONTACTS]
    text = [_HEAD]
    for kind in kinds:
        text += [_function(kind, "height", [kind.f]), _function(kind, "wrench", [kind.f, *kind.N])]
        # Kinds without roots are regular everywhere.
        if kind.regular:
            least = kind.regular[0] if len(kind.regular) == 1 else sympy.Min(*kind.regular)
            text.append(_function(kind, "regularity", [least]))
    told = "The distance of a contact at a pose p (3,), R (3, 3)."
    text.append(_dispatch(kinds, "height", "", told, "return float(_{name}_height({name}[i], p, R))"))
    told = "The distance of a contact at a pose p (3,), R (3, 3), and its wrench into the first six numbers of N."
    fill = "f, N[0], N[1], N[2], N[3], N[4], N[5] = _{name}_wrench({name}[i], p, R)\nreturn float(f)"
    text.append(_dispatch(kinds, "wrench", ", N: Array", told, fill))
    told = "At a pose p (3,), R (3, 3) the least of what a distance has roots of, as the squared sine of edges; else 1."
    known = "return float(_{name}_regularity({name}[i], p, R))"
    text.append(_dispatch(kinds, "regularity", "", told, known))
    names = [kind.name for kind in kinds]
    text.append(_COUNT.format(unpacked=_unpacked(kinds), total=" + ".join(f"len({name})" for name in names)))
    return "".join(text)


def _function(kind: Derived, ending: str, outputs: Sequence[Any]) -> str:
    """One function of a kind's record and a pose."""
    lines, results = _body(outputs)
    used = " ".join([*lines, *results])
    # Names that the expressions do not use are left out, so that nothing is turned in vain.
    lines = [*(line for line in _names(kind) if any(name in used for name in line.split(" = ")[0].split(", "))), *lines]
    value = results[0] if len(results) == 1 else f"({', '.join(results)})"
    head = f"\n\n@part\ndef _{kind.name}_{ending}(row: Row, p: Position, R: Array) -> Any:\n"
    return head + "".join(f"    {line}\n" for line in [*lines, f"return {value}"])


def _names(kind: Derived) -> Iterator[str]:
    """What symbols are in a record and a pose."""
    yield "p_0, p_1, p_2 = vector(p)"
    for name, role in CONTACTS[kind.name].roles.items():
        left, numbers = ", ".join(f"{name}_{i}" for i in range(3)), f'row["{name}"]'
        match role:
            case Role.BODY:
                yield f"{left} = turned(R, vector({numbers}))"
            case Role.WORLD:
                yield f"{left} = vector({numbers})"
            case Role.SCALAR:
                yield f"{name} = {numbers}"


def _body(outputs: Sequence[Any]) -> tuple[list[str], list[str]]:
    """Assignments, each of what others need once, and results, of Python source."""
    powers = {q for expression in outputs for q in expression.atoms(sympy.Pow) if q.exp.is_Rational and q.exp.q == 2}
    bases = sorted({q.base for q in powers}, key=sympy.default_sort_key)
    roots = [sympy.Symbol(f"root_{i}", positive=True) for i in range(len(bases))]
    # All half-integer powers of a base become powers of one root, which is taken once.
    of = dict(zip(bases, roots, strict=True))
    plain = [expression.xreplace({q: of[q.base] ** int(2 * q.exp) for q in powers}) for expression in outputs]
    # Common subexpressions among all outputs: a wrench and its distance share most of their work.
    shared, reduced = sympy.cse([*bases, *plain], symbols=sympy.numbered_symbols("s"))
    known = {**dict(shared), **{r: sympy.sqrt(e) for r, e in zip(roots, reduced[: len(roots)], strict=True)}}
    printer, lines, done = _Printer({"fully_qualified_modules": False}), list[str](), set[Any]()

    def settle(expression: Any) -> None:
        # In the order of need, and among equals of their names: the same text on every machine.
        for symbol in sorted(expression.free_symbols & known.keys() - done, key=lambda s: (len(str(s)), str(s))):
            if symbol not in done:
                settle(known[symbol])
                done.add(symbol)
                lines.append(f"{symbol} = {printer.doprint(known[symbol])}")

    for expression in reduced[len(roots) :]:
        settle(expression)
    return lines, [printer.doprint(expression) for expression in reduced[len(roots) :]]


def _dispatch(kinds: Sequence[Derived], name: str, more: str, told: str, body: str) -> str:
    """A function of a contact's number: that of its kind."""
    lines = [f'"""{told}"""', _unpacked(kinds)]
    for kind in kinds:
        one = body.format(name=kind.name) if name != "regularity" or kind.regular else "return 1.0"
        inside = one.split("\n")
        if kind is kinds[-1]:
            lines += inside
        else:
            lines += [f"if i < len({kind.name}):", *(f"    {line}" for line in inside), f"i -= len({kind.name})"]
    head = f"\n\n@part\ndef {name}(tables: Tables, i: int, p: Position, R: Array{more}) -> float:\n"
    return head + "".join(f"    {line}\n" for line in lines)


def _unpacked(kinds: Sequence[Derived]) -> str:
    return f"{', '.join(kind.name for kind in kinds)}{',' * (len(kinds) == 1)} = tables"


if __name__ == "__main__":
    FILE.write_text(written())
