"""From bytes to text: UTF-8, UTF-16 with or without byte-order mark, Windows and Latin-1 files."""

import codecs

from femfit.core.errors import TableError

_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


def decode(content: bytes, source: str, encoding: str | None = None) -> tuple[str, str]:
    """Text of a file and its encoding."""
    if content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise TableError(f"{source} is a spreadsheet; save the sheet as CSV and import that.")
    name = encoding or _guess(content)
    try:
        text = content.decode(name)
    except LookupError as error:
        raise TableError(f"--encoding must be a name that Python knows; instead received {name!r}.") from error
    except UnicodeError as error:
        raise TableError(f"{source} is not written in {name}: {error}. Give the right one with --encoding.") from error
    if "\x00" in text:
        raise TableError(f"{source} is no text table (it holds NUL characters); export it as CSV or Parquet.")
    return text.removeprefix("\ufeff"), name


def _guess(content: bytes) -> str:
    for mark, name in _MARKS:
        if content.startswith(mark):
            return name
    head = content[:4096]
    if len(head) >= 4:
        odd, even = head[1::2].count(0), head[0::2].count(0)
        if odd > 0.4 * len(head[1::2]) and even == 0:
            return "utf-16-le"
        if even > 0.4 * len(head[0::2]) and odd == 0:
            return "utf-16-be"
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        # Windows-1252 leaves five codes undefined; Latin-1 takes every byte.
        return "cp1252" if not set(content) & {0x81, 0x8D, 0x8F, 0x90, 0x9D} else "latin-1"
    return "utf-8"
