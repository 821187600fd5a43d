"""TOML files with the line and column of every key and value; a file that cannot be read becomes a fault."""

import hashlib
import json
import re
import stat
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TextIO

from fmopt.errors import Fault, GeometryError, InputError, ResourceError
from fmopt.plan import STDIO

Key = tuple[str | int, ...]

MAX_BYTES = 1_000_000
_SYNTAX = "see https://toml.io for the syntax; numbers take a decimal point, words quotation marks"
_PARTS = {".stl", ".obj", ".ply", ".3mf", ".glb", ".step", ".stp"}
NAME_PROBLEM = "name a problem file, which names two models under [moving] and [fixed]; or both parts, with --error"
MAX_DEPTH = 24


@dataclass(frozen=True)
class Place:
    """A place in a file; lines and columns count from 1, columns in characters."""

    file: str
    line: int = 1
    column: int = 1
    key: str = ""

    def fault(self, code: str, message: str, advice: str = "") -> Fault:
        """The fault of this place, with what to change; empty advice if that is plain."""
        return Fault(self.file, self.line, self.column, self.key, code, message, advice)

    @contextmanager
    def solid(self) -> Iterator[None]:
        """Refuses what is stated here where its geometry is refused inside.

        Raises:
            InputError: in place of a GeometryError.
        """
        try:
            yield
        except GeometryError as error:
            raise InputError(self.fault("geometry", error.message, error.advice)) from error


@dataclass(frozen=True)
class Source:
    """A TOML document: its data and the places of its keys and values."""

    path: Path
    data: Mapping[str, Any]
    keys: Mapping[Key, tuple[int, int]]
    values: Mapping[Key, tuple[int, int]]

    def place(self, key: Key, *, of_key: bool = False) -> Place:
        """Where a value stands, or its key; of a key without a place, its nearest table."""
        first, second = (self.keys, self.values) if of_key else (self.values, self.keys)
        for n in range(len(key), 0, -1):
            found = first.get(key[:n], second.get(key[:n]))
            if found is not None:
                return Place(str(self.path), *found, dotted(key))
        return Place(str(self.path), 1, 1, dotted(key))

    def missing(self, table: Key, name: str | int, advice: str) -> Fault:
        """The fault of a key that a table lacks."""
        place = replace(self.place(table, of_key=True), key=dotted((*table, name)))
        return place.fault("missing-key", "this key is missing", advice)

    def get(self, key: Key) -> Any:
        """The value at `key`.

        Raises:
            KeyError: there is none.
        """
        value: Any = self.data
        for part in key:
            if not holds(value, part):
                raise KeyError(dotted(key))
            value = value[part]
        return value


def holds(value: object, part: str | int) -> bool:
    """Whether a value is a table with this key, or an array with this index."""
    if isinstance(value, Mapping):
        return part in value
    return isinstance(value, list) and isinstance(part, int) and 0 <= part < len(value)


def dotted(key: Sequence[str | int]) -> str:
    """A key path as one reads it: `solids.block.size[2]`."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            escaped = part.encode("unicode_escape").decode("ascii").replace('"', '\\"')[:60]
            name = part if re.fullmatch(r"[A-Za-z0-9_-]+", part) else f'"{escaped}"'
            text += f".{name}" if text else name
    return text


def canonical_digest(value: object) -> str:
    """SHA-256 (hex) of plain data in one canonical form."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


@lru_cache(maxsize=1)
def _whole(stream: TextIO) -> bytes:
    """What comes in, up to what is too much; it comes once, and may be asked for again."""
    return stream.buffer.read(MAX_BYTES + 1)


def read_bytes(path: Path, cited: Place, limit: int) -> bytes:
    """The bytes of a regular file or of standard input.

    Raises:
        InputError: no such file, no regular file, no permission, too large, or a name no file can have.
        ResourceError: standard input cannot be read.
    """
    if path == STDIO:
        try:
            content = _whole(sys.stdin)
        except OSError as error:
            raise ResourceError(f"standard input: {error.strerror}", "give something to read, or a file") from error
        if len(content) > limit:
            raise InputError(cited.fault("file-size", f"more than {limit} bytes come in", "name a smaller file"))
        return content
    try:
        status = path.stat()
        # Asked before it is opened: a pipe waits for a writer, and a device may never end.
        if not stat.S_ISREG(status.st_mode):
            kind = "a directory" if stat.S_ISDIR(status.st_mode) else "no regular file"
            raise InputError(cited.fault("file-kind", f"{_name(path)} is {kind}", "name a file"))
        if status.st_size > limit:
            message = f"{_name(path)} has {status.st_size} bytes, more than {limit}"
            raise InputError(cited.fault("file-size", message, "name a smaller file"))
        return path.read_bytes()
    except FileNotFoundError:
        advice = "correct the path; it is relative to the file that names it" if cited.key else "correct the path"
        fault = cited.fault("file-missing", f"{_name(path)} does not exist", advice)
    except OSError as error:
        advice = "check its permissions" if isinstance(error, PermissionError) else "correct the path"
        fault = cited.fault("file-unreadable", f"{_name(path)} cannot be read: {error.strerror}", advice)
    except ValueError:  # a NUL in it
        fault = cited.fault("file-missing", f"{_name(path)} is no file name", "correct the path")
    raise InputError(fault)


def _name(path: Path) -> str:
    return str(path) if str(path).isprintable() else repr(str(path))


def read(path: Path, cited: Place | None = None) -> Source:
    """The TOML document of a file; faults of the file as a whole stand where it is `cited`, if it is.

    Raises:
        InputError: the file cannot be read, is not UTF-8, or is not TOML.
    """
    content = read_bytes(path, cited or Place(str(path)), MAX_BYTES)
    _refuse_others(path, content)
    try:
        text = _text(path, content)
        data = _parsed(path, text)
    except InputError as error:
        if path.suffix.lower() in ("", ".toml"):
            raise
        where = error.faults[0]  # of a TOML file of another name, the place of what is wrong
        message = f"{_name(path)} is of a kind that is not read"
        advice = "export the part as STEP or STL, and name that file"
        raise InputError(Place(str(path), where.line, where.column).fault("file-kind", message, advice)) from error
    keys, values = _places(text)
    source = Source(path, data, keys, values)
    # What reads the document after this goes down into it by recursion.
    for key, value in _walk(data):
        if len(key) >= MAX_DEPTH and isinstance(value, Mapping | list):
            place = source.place(key)
            raise InputError(_nesting(str(path), place.line, place.column))
    return source


def _refuse_others(path: Path, content: bytes) -> None:
    """Meshes, JSON and empty files get an error that says what they are."""
    begin = content.lstrip()[:1]
    if path.suffix.lower() in _PARTS:
        message, advice = f"{_name(path)} is a mesh or CAD file, not TOML", NAME_PROBLEM
    elif path.suffix.lower() == ".json" or begin == b"{":
        message = f"{_name(path)} is JSON, not TOML"
        advice = "name a problem or model file; a plan goes to fmopt verify"
    elif not begin:
        message, advice = f"{_name(path)} is empty", "copy a shipped problem or model and change it"
    else:
        return
    raise InputError(Place(str(path)).fault("file-kind", message, advice))


def _nesting(file: str, line: int, column: int) -> Fault:
    message = f"tables and arrays are nested more than {MAX_DEPTH} deep"
    return Place(file, line, column).fault("toml-nesting", message, "flatten the file")


def _walk(data: Mapping[str, Any]) -> Iterator[tuple[Key, Any]]:
    """Every key path and value down to the greatest depth allowed."""
    stack: list[tuple[Key, Any]] = [((), data)]
    while stack:
        key, value = stack.pop()
        yield key, value
        if len(key) <= MAX_DEPTH:
            if isinstance(value, Mapping):
                stack.extend(((*key, part), child) for part, child in value.items())
            elif isinstance(value, list):
                stack.extend(((*key, i), child) for i, child in enumerate(value))


def _text(path: Path, content: bytes) -> str:
    if content.startswith(b"\xef\xbb\xbf"):
        message = "the file starts with a byte order mark"
        raise InputError(Place(str(path)).fault("toml-bom", message, "save it as UTF-8 without one"))
    try:
        return content.decode("utf-8").replace("\r\n", "\n")  # as tomllib has it: both parsers count alike
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8")
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        message = f"byte 0x{content[error.start]:02x} is not UTF-8"
        raise InputError(Place(str(path), line, column).fault("toml-encoding", message, "save it as UTF-8")) from None


def _parsed(path: Path, text: str) -> dict[str, Any]:
    lines = text.split("\n")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        # tomllib says the place in words alone.
        found = re.search(r"^(.*) \(at (?:line (\d+), column (\d+)|end of document)\)$", str(error), re.DOTALL)
        message = found[1] if found else str(error)
        line, column = len(lines), len(lines[-1]) + 1
        if found and found[2]:
            line, column = int(found[2]), int(found[3])
        fault = Place(str(path), line, column).fault("toml-syntax", message[:200], _SYNTAX)
    except RecursionError:
        depths = [line.count("[") + line.count("{") for line in lines]  # it names no line: most brackets are likeliest
        worst = max(range(len(lines)), key=depths.__getitem__)
        fault = _nesting(str(path), worst + 1, 1)
    except ValueError as error:  # an integer of thousands of digits
        longest = [max((len(run) for run in re.findall(r"[0-9_]+", line)), default=0) for line in lines]
        worst = max(range(len(lines)), key=longest.__getitem__)
        fault = Place(str(path), worst + 1, 1).fault("toml-syntax", str(error)[:200], "shorten the number")
    raise InputError(fault)


def _places(text: str) -> tuple[dict[Key, tuple[int, int]], dict[Key, tuple[int, int]]]:
    """Places of keys and of values of a valid document."""
    import tree_sitter
    import tree_sitter_toml

    # What is valid and what it means, tomllib has said; the syntax tree says where it stands.
    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_toml.language()))
    index = _Index(text)
    index.document(parser.parse(index.content).root_node)
    return index.keys, index.values


class _Index:
    """One walk over a syntax tree; the tables of arrays are counted as they come."""

    def __init__(self, text: str) -> None:
        self.content = text.encode()
        self._lines = self.content.split(b"\n")
        self.keys: dict[Key, tuple[int, int]] = {}
        self.values: dict[Key, tuple[int, int]] = {}
        self._elements: dict[Key, int] = {}

    def document(self, root: Any) -> None:
        """Notes every table, pair and array element below `root`."""
        stack: list[tuple[Any, Key]] = []
        for node in root.named_children:
            if node.has_error:  # the two parsers disagree: the nearest known place serves
                continue
            if node.type == "pair":
                stack.append((node, ()))
            elif node.type in ("table", "table_array_element"):
                key = self._header(node)
                stack.extend((child, key) for child in node.named_children[1:] if child.type == "pair")
        while stack:
            node, key = stack.pop()
            if len(key) > MAX_DEPTH:
                continue
            if node.type == "pair":
                name, value = [child for child in node.named_children if child.type != "comment"]
                stack.append((value, self._note(key, name)))
                continue
            self.values[key] = self._place(node)
            children = [child for child in node.named_children if child.type != "comment"]
            if node.type == "inline_table":
                stack.extend((child, key) for child in children if child.type == "pair")
            elif node.type == "array":
                stack.extend((child, (*key, i)) for i, child in enumerate(children))

    def _header(self, node: Any) -> Key:
        key: Key = self._note((), node.named_children[0], last=node.type == "table")
        if node.type == "table_array_element":
            n = self._elements.get(key, 0)
            self._elements[key] = n + 1
            self.keys.setdefault(key, self._place(node))
            key = (*key, n)
            self.keys[key] = self._place(node)
        return key

    def _note(self, key: Key, node: Any, *, last: bool = True) -> Key:
        """The key path of a (dotted) key node below `key`; each part is noted where it stands first."""
        parts = self._parts(node)
        for i, part in enumerate(parts):
            key = (*key, self._name(part))
            if last or i < len(parts) - 1:
                self.keys.setdefault(key, self._place(part))
                if key in self._elements:  # below an array of tables it is in the last one so far
                    key = (*key, self._elements[key] - 1)
        return key

    def _parts(self, node: Any) -> list[Any]:
        parts: list[Any] = []
        while node.type == "dotted_key":  # left-recursive
            parts.append(node.named_children[-1])
            node = node.named_children[0]
        return [node, *reversed(parts)]

    def _name(self, node: Any) -> str:
        text = str(node.text.decode())
        # tomllib itself reads the escapes, so that the key is the one in its data.
        return next(iter(tomllib.loads(f"{text} = 0"))) if node.type == "quoted_key" else text

    def _place(self, node: Any) -> tuple[int, int]:
        row, column = node.start_point
        return row + 1, len(self._lines[row][:column].decode(errors="replace")) + 1  # columns of the tree are bytes
