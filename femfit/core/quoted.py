"""Foreign text as it may stand in a message: without control characters, and short."""

_LONGEST = 80


def quoted(text: object, longest: int = _LONGEST) -> str:
    r"""Make a name or a cell of somebody's file fit for a terminal and a log.

    Examples
    --------
    >>> quoted("Kraft\x1b[31m [g]")
    'Kraft\\x1b[31m [g]'
    >>> quoted(1000 * "x", longest=5)
    'xxxxx...'
    """
    whole = str(text)
    start = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in whole[:longest])
    return start if len(whole) <= longest else f"{start}..."
