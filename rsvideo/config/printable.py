"""Text of strangers (names of files, metadata, words of libraries) as it may reach a terminal, a log or a page: nothing in it acts."""

import unicodedata


def printable(text: str, *, keep: str = "") -> str:
    r"""The text with everything that is not shown as itself (control characters, turns of the writing direction) written out: `\x1b`.

    The letters of `keep` stay as they are. From DEL on the escapes are those of JSON, so that JSON stays what it is.
    """
    if text.isprintable():
        return text
    return "".join(letter if letter in keep or _shown(letter) else _escape(letter) for letter in text)


def in_unicode(name: str) -> str:
    """The name of a file, whose bytes may be no text, with those bytes written out."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace") if not name.isascii() else name


def _shown(letter: str) -> bool:
    return letter.isprintable() or unicodedata.category(letter) == "Zs"  # blanks of any width are harmless


def _escape(letter: str) -> str:
    if letter < " ":
        return f"\\x{ord(letter):02x}"
    units = letter.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[at : at + 2].hex()}" for at in range(0, len(units), 2))
