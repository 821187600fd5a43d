"""Text from outside, written into a text of another language so that nothing of it is read as that language.

One function for each place; none of them trusts that a reader has refused anything before.
"""

_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what spreadsheets take for the beginning of a formula


def one_line(text: str) -> str:
    """Text on one line, for comments: all that is not printable is written as its code, as line breaks of any kind."""
    # Marks that turn the direction of writing are not printable either.
    return "".join(letter if letter.isprintable() else _code(letter) for letter in text)


def urscript_string(text: str) -> str:
    """A string of URScript, with its quotes; the language has no escapes, so that quotes become apostrophes."""
    return '"' + one_line(text).replace('"', "'").replace("\\", "/") + '"'


def csv_text(text: str) -> str:
    """A text for a cell of a table, which no spreadsheet takes for a formula; who writes the table puts the quotes."""
    line = one_line(text)
    # Tabs and returns are stripped like spaces: whether one begins the text is asked of it as it is.
    return "'" + line if text.lstrip().startswith(_FORMULA) or text.startswith(_FORMULA) else line


def csv_comment(text: str) -> str:
    """Text for the rest of a line of a table that begins with #: to a spreadsheet all of the line is one cell."""
    return one_line(text).translate(dict.fromkeys(map(ord, ",;|\"'"), " "))


def _code(letter: str) -> str:
    return f"\\u{ord(letter):0{4 if ord(letter) < 0x10000 else 8}x}"
