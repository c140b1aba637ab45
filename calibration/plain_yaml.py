"""The part of YAML that camera files use: nothing that can surprise.

Block mappings and sequences, lists in brackets (over several lines), numbers, text,
comments; OpenCV's ``%YAML:1.0`` first line and ``!!opencv-matrix`` tags are passed over.
Anchors, aliases, multi-line text and braces are refused. Only what reads entirely as a
number is one; ``yes``, ``no`` and dates stay text.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TypeAlias

Value: TypeAlias = "float | str | list[Value] | dict[str, Value] | None"

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_KEY = re.compile(r"""("[^"]*"|'[^']*'|[^\s:\[\]{}#&*!|>][^:\[\]{}#]*?)\s*:(\s+|$)""")
_TAG = re.compile(r"!!?[\w.-]+\s*")
_COMMENT = re.compile(r"""("[^"]*"|'[^']*'|[^"'#]|(?<=\S)#|["'])*+""")
_REFUSED = ("&", "*", "|", ">", "{", "}", "@", "`")
_DEEPEST = 30


class PlainYamlError(ValueError):
    """What cannot be read, with the number of the line."""

    def __init__(self, line: int, message: str) -> None:
        super().__init__(f"line {line}: {message}")
        self.line = line


@dataclass(frozen=True)
class _Line:
    number: int
    indent: int
    text: str


def read_plain_yaml(text: str) -> dict[str, Value]:
    """The mapping that a text holds.

    Raises:
        PlainYamlError: it is not such a mapping.
    """
    lines = _joined(_lines(text))
    if not lines:
        raise PlainYamlError(1, "nothing is in it")
    value, end = _block(lines, 0, 0)
    if end < len(lines):
        raise PlainYamlError(lines[end].number, "indented unlike the lines before")
    if not isinstance(value, dict):
        raise PlainYamlError(lines[0].number, "a mapping (key: value) is expected")
    return value


def _lines(text: str) -> list[_Line]:
    found = []
    for number, raw in enumerate(text.splitlines(), start=1):
        if raw.startswith(("%", "---", "...")):
            continue
        matched = _COMMENT.match(raw)
        content = (matched.group() if matched else raw).rstrip()
        stripped = content.lstrip(" ")
        if stripped.startswith("\t"):
            raise PlainYamlError(number, "a tab cannot indent")
        if stripped:
            found.append(_Line(number, len(content) - len(stripped), stripped))
    return found


def _joined(lines: list[_Line]) -> list[_Line]:
    """Lines of one bracketed list become one line."""
    found: list[_Line] = []
    open_brackets = 0
    for line in lines:
        if open_brackets:
            last = found[-1]
            found[-1] = _Line(last.number, last.indent, f"{last.text} {line.text}")
        else:
            found.append(line)
        open_brackets += line.text.count("[") - line.text.count("]")
    if open_brackets:
        raise PlainYamlError(found[-1].number, "a bracket is not closed")
    return found


def _block(lines: list[_Line], start: int, depth: int) -> tuple[Value, int]:
    if depth > _DEEPEST:
        raise PlainYamlError(lines[start].number, "nested too deeply")
    if lines[start].text.startswith("- ") or lines[start].text == "-":
        return _sequence(lines, start, depth)
    return _mapping(lines, start, depth)


def _mapping(lines: list[_Line], start: int, depth: int) -> tuple[Value, int]:
    indent, at = lines[start].indent, start
    found: dict[str, Value] = {}
    while at < len(lines) and lines[at].indent == indent:
        line = lines[at]
        matched = _KEY.match(line.text)
        if matched is None:
            break
        key = matched.group(1).strip("\"'")
        if key in found:
            raise PlainYamlError(line.number, f"{key} appears twice")
        rest = _TAG.sub("", line.text[matched.end() :], count=1).strip()
        at += 1
        if rest:
            found[key] = _scalar_or_list(rest, line.number)
        elif at < len(lines) and _belongs(lines[at], indent):
            found[key], at = _block(lines, at, depth + 1)
        else:
            found[key] = None
    if not found:
        raise PlainYamlError(lines[start].number, "key: value is expected")
    return found, at


def _belongs(line: _Line, indent: int) -> bool:
    """A deeper line, or a sequence that is not indented under its key."""
    return line.indent > indent or (line.indent == indent and line.text.startswith("-"))


def _sequence(lines: list[_Line], start: int, depth: int) -> tuple[Value, int]:
    indent, at = lines[start].indent, start
    found: list[Value] = []
    while at < len(lines) and lines[at].indent == indent:
        line = lines[at]
        if not line.text.startswith("-"):
            break
        rest = line.text[1:].lstrip()
        if _KEY.match(rest):
            shifted = indent + len(line.text) - len(rest)
            nested = [*lines[:at], _Line(line.number, shifted, rest), *lines[at + 1 :]]
            value, at = _block(nested, at, depth + 1)
        else:
            value, at = _scalar_or_list(rest, line.number), at + 1
        found.append(value)
    return found, at


def _scalar_or_list(text: str, number: int) -> Value:
    if not text.startswith("["):
        return _scalar(text, number)
    tokens = re.findall(r"""\[|\]|,|"[^"]*"|'[^']*'|[^\[\],\s][^\[\],]*""", text)
    value, end = _list(tokens, 1, number, 0)
    if end != len(tokens):
        raise PlainYamlError(number, "text follows a closed bracket")
    return value


def _list(
    tokens: list[str], at: int, number: int, depth: int
) -> tuple[list[Value], int]:
    found: list[Value] = []
    if depth > _DEEPEST:
        raise PlainYamlError(number, "nested too deeply")
    while at < len(tokens):
        token = tokens[at]
        at += 1
        if token == "]":
            return found, at
        if token == "[":
            inner, at = _list(tokens, at, number, depth + 1)
            found.append(inner)
        elif token != ",":
            found.append(_scalar(token.strip(), number))
    raise PlainYamlError(number, "a bracket is not closed")


def _scalar(text: str, number: int) -> Value:
    if text[:1] in _REFUSED:
        raise PlainYamlError(number, f"{text[:1]} is not read here")
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1]
    if _NUMBER.fullmatch(text):
        return float(text)
    return None if text in ("", "~", "null") else text
