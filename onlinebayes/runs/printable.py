"""Text of others on one line of ours: what a terminal or a comment would obey is shown as its code instead.

A name in a log may hold a line break or an escape sequence; in a message, or in a comment of a file that is written, it
must stay what it is, a name.
"""

from __future__ import annotations


def one_line(text: str) -> str:
    """The text with runs of white space as one blank and each other unprintable character as its escape."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in " ".join(text.split()))
