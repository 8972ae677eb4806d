"""pbrt-v4's scene format: tokens with file and line, and parameter lists."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.files import named_file
from clsim.values import read_text

MAX_BYTES = 512 << 20
_TAIL_BYTES = 1 << 16
MAX_INCLUDES = 1000
MAX_INCLUDE_DEPTH = 32
TOKEN = re.compile(r'[ \t\r\n]+|#[^\n]*|"(?:\\.|[^"\\\n])*"|[\[\]]|[^\s"#\[\]]+')
NUMBERS = re.compile(r"[\s0-9eE.+\-]+(?=[\]])")
"""A whole list of numbers: read at once, for meshes have millions."""
HARMLESS = {
    *("shutteropen", "shutterclose", "maxanisotropy", "edgelength", "levels", "scheme", "faceIndices", "S", "name"),
    *("thickness", "maxdepth", "nsamples", "remaproughness", "focaldistance"),
}
"""Parameters that say how pbrt samples, or that matter little."""


@dataclass(frozen=True)
class Token:
    """A word, a quoted string, a bracket, or a whole list of numbers.

    ``place`` is file and line.
    """

    text: str
    place: str
    quoted: bool = False
    numbers: npt.NDArray[np.float64] | None = None


class Tokens:
    """The tokens of a file and those that it includes, one at a time, with one of lookahead."""

    def __init__(self, path: Path) -> None:
        """Start at the top of a file; what it includes must lie in its folder."""
        self.folder = path.parent
        self._stack: list[Iterator[Token]] = [_tokens(path)]
        self._next: Token | None = None
        self._includes = 0
        self.last = f"{path}:1"

    @property
    def depth(self) -> int:
        """How many files are open: one, and those that it includes."""
        return len(self._stack)

    def peek(self) -> Token | None:
        """Return the next token without taking it; None at the end."""
        while self._next is None and self._stack:
            self._next = next(self._stack[-1], None)
            if self._next is None:
                self._stack.pop()
        return self._next

    def take(self, expected: str = "more") -> Token:
        """Take the next token; raises InputError at the end."""
        token = self.peek()
        if token is None:
            raise InputError(f"{self.last}: the file ends, expected {expected}")
        self._next, self.last = None, token.place
        return token

    def string(self) -> str:
        """Take a quoted string."""
        token = self.take("a quoted string")
        if not token.quoted:
            fail(token, "a quoted string")
        return token.text

    def floats(self, count: int) -> list[float]:
        """Take some numbers, in brackets or not."""
        token = self.take(f"{count} numbers")
        if token.numbers is not None:
            found: list[float] = token.numbers.tolist()
            if len(found) != count:
                raise InputError(f"{token.place}: got {len(found)} numbers, expected {count}")
            return found
        found = [_number(token)]
        while len(found) < count:
            found.append(_number(self.take(f"{count} numbers")))
        return found

    def include(self, name: str, place: str) -> None:
        """Go on with another file, and come back at its end."""
        self._includes += 1
        if self._includes > MAX_INCLUDES or len(self._stack) > MAX_INCLUDE_DEPTH:
            raise InputError(f"{place}: includes too much: do files include each other?")
        self._stack.append(_tokens(file_of(place, name, self.folder)))

    def parameters(self) -> Parameters:
        """Take a list of parameters, each a quoted type and name with its values."""
        found = Found()
        while (token := self.peek()) is not None and token.quoted:
            self.take()
            words = token.text.split()
            if len(words) != 2:
                fail(token, 'a parameter such as "float radius"')
            found[words[1]] = Parameter(words[0], token.place, *self._values())
        return Parameters(found, self.last)

    def _values(self) -> tuple[npt.NDArray[np.float64], list[str]]:
        """Take a value, or values in brackets: numbers and words."""
        token = self.take("a value")
        if token.numbers is not None:
            return token.numbers, []
        if token.text != "[" or token.quoted:
            return _sorted([token])
        tokens: list[Token] = []
        while True:
            token = self.take("]")
            if token.text == "]" and not token.quoted:
                return _sorted(tokens)
            tokens.append(token)


@dataclass(frozen=True)
class Parameter:
    """One parameter: numbers, or words (strings and booleans)."""

    type: str
    place: str
    numbers: npt.NDArray[np.float64]
    words: list[str]


class Found(dict[str, Parameter]):
    """Parameters by their names, which remembers what was asked for."""

    def __init__(self) -> None:
        """Begin without any."""
        super().__init__()
        self.asked: set[str] = set()

    def find(self, name: str) -> Parameter | None:
        """Return a parameter; None where it is missing."""
        if name in self:
            return self[name]
        return None

    def __contains__(self, name: object) -> bool:
        """Tell whether there is a parameter."""
        self.asked.add(str(name))
        return super().__contains__(name)


@dataclass(frozen=True)
class Parameters:
    """A parameter list; ``place`` is where it ends."""

    found: Found
    place: str

    def tell_unread(self, what: str, warn: Callable[[str], None]) -> None:
        """Warn of the parameters that nothing has asked for, but for those that change no picture here."""
        for name in self.found:
            if name not in self.found.asked | HARMLESS and not name.startswith("interface."):
                warn(f"the {name} of a {what} is left out")

    def number(self, name: str, default: float) -> float:
        """Return a number."""
        parameter = self.found.find(name)
        if parameter is None or parameter.type in ("texture", "spectrum"):
            return default
        if len(parameter.numbers) != 1:
            raise InputError(f"{parameter.place}: {name} has {len(parameter.numbers)} numbers, expected one")
        return float(parameter.numbers[0])

    def four(self, name: str) -> list[float] | None:
        """Return four numbers; None where they are missing."""
        parameter = self.found.find(name)
        if parameter is None:
            return None
        if len(parameter.numbers) != 4:
            raise InputError(f"{parameter.place}: {name} has {len(parameter.numbers)} numbers, expected four")
        numbers: list[float] = parameter.numbers.tolist()
        return numbers

    def word(self, name: str, default: str) -> str:
        """Return a string."""
        parameter = self.found.find(name)
        if parameter is None:
            return default
        if len(parameter.words) != 1:
            raise InputError(f"{parameter.place}: {name} has {len(parameter.words)} strings, expected one")
        return parameter.words[0]

    def flag(self, name: str, default: bool) -> bool:
        """Return a boolean."""
        return self.word(name, str(default).lower()) == "true"

    def rows(self, width: int, *names: str) -> npt.NDArray[np.float64] | None:
        """Return the numbers of the first of some names as rows ``[n, width]``; None where all are missing."""
        for name in names:
            parameter = self.found.find(name)
            if parameter is not None:
                if len(parameter.numbers) % width:
                    raise InputError(
                        f"{parameter.place}: {name} has {len(parameter.numbers)} numbers, expected rows of {width}"
                    )
                return parameter.numbers.reshape(-1, width)
        return None


def is_old(path: Path) -> bool:
    """Tell whether a file has the directive that version 4 has left out; it stands at its end."""
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - _TAIL_BYTES, 0))
            tail = file.read(_TAIL_BYTES)
    except OSError:
        return False
    return re.search(rb"(?m)^\s*WorldEnd\b", tail) is not None


def file_of(place: str, name: str, folder: Path) -> Path:
    """Return the path of a file that a scene names; raises InputError if there is none."""
    try:
        return named_file(name, folder)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def fail(token: Token, expected: str) -> NoReturn:
    """Raise InputError: what stands there and what was expected."""
    text = "a list of numbers" if token.numbers is not None else repr(token.text[:60])
    raise InputError(f"{token.place}: got {text}, expected {expected}")


def _tokens(path: Path) -> Iterator[Token]:
    text = read_text(path, MAX_BYTES, "a pbrt scene")
    at, line = 0, 1
    while at < len(text):
        match = TOKEN.match(text, at)
        place = f"{path}:{line}"
        if match is None:
            raise InputError(f"{place}: a quoted string does not end on its line")
        word = match[0]
        at = match.end()
        if word[0] == "[":
            numbers = NUMBERS.match(text, at)
            if numbers is not None and (values := _list(place, numbers[0])) is not None:
                line += numbers[0].count("\n")
                at = numbers.end() + 1
                yield Token("[]", place, numbers=values)
                continue
        line += word.count("\n")
        if word[0] in " \t\r\n#":
            continue
        yield Token(word[1:-1], place, quoted=True) if word[0] == '"' else Token(word, place)


def _list(place: str, text: str) -> npt.NDArray[np.float64] | None:
    try:
        numbers = np.array(text.split(), np.float64)
    except ValueError:
        return None
    if not np.isfinite(numbers).all():
        raise InputError(f"{place}: a list has a number that is not finite")
    return numbers


def _number(token: Token) -> float:
    try:
        value = math.nan if token.quoted else float(token.text)
    except ValueError:
        fail(token, "a number")
    if not math.isfinite(value):
        fail(token, "a finite number")
    return value


def _sorted(tokens: list[Token]) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Separate numbers from words."""
    words = [token.text for token in tokens if token.quoted or token.text in ("true", "false")]
    numbers = [_number(token) for token in tokens if not (token.quoted or token.text in ("true", "false"))]
    return np.array(numbers, np.float64), words
