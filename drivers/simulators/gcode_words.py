"""Reads one line of G-code the way small controllers do; words only, no meaning."""

from __future__ import annotations

import re

_COMMENT = re.compile(r"\([^)]*\)|;.*$")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")

LETTER_EXPECTED, BAD_NUMBER = 1, 2


class WordError(Exception):
    """A line that is not made of words; ``code`` in the numbering of GRBL."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error:{code}")
        self.code = code


def cleaned(line: bytes) -> str:
    """Comments, blanks and bytes above 7F taken out, in capitals."""
    text = bytes(b for b in line if b < 0x80).decode("ascii")
    return re.sub(r"\s", "", _COMMENT.sub("", text)).upper()


def words(text: str, *, bare: bool = False) -> list[tuple[str, float]]:
    """Letter and value of each word.

    Args:
        text: as ``cleaned`` gives it.
        bare: a letter without a number counts as 0, as Marlin has it.

    Raises:
        WordError: something that is no letter, or a letter without a number.
    """
    found, place = [], 0
    while place < len(text):
        letter = text[place]
        if not letter.isalpha():
            raise WordError(LETTER_EXPECTED)
        number = _NUMBER.match(text, place + 1)
        if number is None and not bare:
            raise WordError(BAD_NUMBER)
        found.append((letter, float(number.group()) if number else 0.0))
        place = number.end() if number else place + 1
    return found
