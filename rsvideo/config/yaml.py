"""YAML as people write it, read so that no file can harm and every fault is named with its line.

Words mean what they mean in YAML 1.2: `no` and `on` are words, `1:30` and `2026-01-31` too, `5e-3` is a number and `010` is ten.
Values are built here, from the parser's events: the loaders of PyYAML and ruamel.yaml follow aliases and merge keys, make dates and
binaries, and recurse as deep as a file does before anybody can refuse it.
"""

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ValidationError

from rsvideo.config.files import read_whole
from rsvideo.config.printable import printable

MOST_BYTES = 256_000
DEEPEST = 32  # mappings and sequences within each other
MOST_ENTRIES = 20_000

Key = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)

_INT = re.compile(r"[-+]?\d{1,18}")
_FLOAT = re.compile(r"[-+]?(\.\d{1,30}|\d{1,30}(\.\d{0,30})?)([eE][-+]?\d{1,4})?")
_MOST_COMPARED = 100  # characters of a word that are compared with the names there are
_ALIKE = 0.6  # ratio of matching characters (difflib) from which on one name is taken to be meant by another
_MOST_LISTED = 20  # names that fit one line of an error
_MOST_SHOWN = 60  # characters of a value in an error
_WORDS: Mapping[str, bool | None] = {"": None, "~": None, "null": None, "true": True, "false": False}
_TAGS = {None, "!", *(f"tag:yaml.org,2002:{kind}" for kind in ("str", "map", "seq"))}
_MESSAGES = {"extra_forbidden": "there is no such key", "missing": "must be given", "model_type": "must be a mapping of keys"}


class ConfigError(ValueError):
    """What a file of settings says cannot be meant; each fault reads `file:line: key: what was wrong`."""

    def __init__(self, *faults: str) -> None:
        more = len(faults) - 1
        super().__init__(faults[0] + (f" (and {more} more fault{'s' if more > 1 else ''})" if more else ""))
        self.faults = faults


@dataclass(frozen=True, kw_only=True)
class Positions:
    """Where in its file each key and each item of a list stands."""

    path: Path
    lines: Mapping[Key, int]  # counted from 1

    def where(self, key: Key) -> str:
        """`file:line` of a key, or of the nearest that encloses it."""
        while key and key not in self.lines:
            key = key[:-1]
        return f"{self.path}:{self.lines.get(key, 1)}"

    def fault(self, key: Key, words: str) -> str:
        """The line that says what is wrong with the value of a key."""
        name = ".".join(shown(part) for part in key)
        return f"{self.where(key)}: {name + ': ' if name else ''}{words}"


def load(path: Path) -> tuple[Any, Positions]:
    """The one document in a file, made of dict, list, str, int, float, bool and None.

    Aliases, tags, duplicate keys, and what is too large or too deep are refused.
    """
    try:
        text = read_whole(path, most=MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} must be text in UTF-8, byte {error.start} is not; is it a picture or a clip?") from error
    reader = _Reader(path)
    try:
        data = reader.document(yaml.parse(text, Loader=yaml.SafeLoader))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise ConfigError(f"{path}:{line}: {error.problem or error.context}; is it YAML, its indentation made of blanks?") from error
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # the latter two from escapes beyond all characters
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path} must be YAML, {shown(' '.join(str(error).split()))}") from error
    return data, Positions(path=path, lines=reader.lines)


def read(path: Path, model: type[Model]) -> Model:
    """What a file holds, as `model` understands it."""
    return validated(model, *load(path))


def validated(model: type[Model], data: object, positions: Positions) -> Model:
    """`data` as `model` understands it; every fault is named with its line and, for a slip of the pen, what was meant."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        found = sorted(error.errors(include_url=False), key=lambda fault: fault["type"] == "missing")  # a key may only be misspelt
        faults = [positions.fault(*_explained(model, fault)) for fault in found]
        raise ConfigError(*dict.fromkeys(faults)) from error


def meant(word: object, names: Iterable[str]) -> str:
    """`; did you mean ...` for a word that is nearly one of `names`, else what there is."""
    by_spelling = {name.lower(): name for name in names}
    if near := difflib.get_close_matches(str(word).lower()[:_MOST_COMPARED], by_spelling, n=1, cutoff=_ALIKE):
        return f"; did you mean {by_spelling[near[0]]}?"
    return f"; there is {', '.join(by_spelling.values())}" if 0 < len(by_spelling) <= _MOST_LISTED else ""


def shown(value: object, *, most: int = _MOST_SHOWN) -> str:
    """A value as an error line may show it: printable, and not too long."""
    text = printable(str(value) if isinstance(value, str | int) else repr(value))
    return text if len(text) <= most else text[: most - 3] + "..."


def _explained(model: type[BaseModel], fault: Any) -> tuple[Key, str]:
    """The key of a fault that pydantic found, and what is wrong there in our words."""
    key, kind = tuple(fault["loc"]), fault["type"]
    words = _MESSAGES.get(kind) or str(fault["msg"]).removeprefix("Value error, ")
    if kind == "extra_forbidden":
        return key, words + meant(key[-1], _names(model, key[:-1]))
    if kind in ("missing", "value_error"):
        return key, words
    words = f"{words[:1].lower()}{words[1:]}, got {shown(fault['input'])}"
    if kind in ("literal_error", "enum"):
        words += meant(fault["input"], re.findall(r"'([^']*)'", str(fault.get("ctx", {}).get("expected", ""))))
    return key, words


def _names(model: type[BaseModel], key: Key) -> list[str]:
    """The fields of the models that may stand under a key."""
    models = [model]
    for part in key:
        if fields := [each.model_fields[part] for each in models if isinstance(part, str) and part in each.model_fields]:
            models = [found for field in fields for found in _models(field.annotation)]
    return [name for each in models for name in each.model_fields]


def _models(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


class _Reader:
    """Builds values from the parser's events, and notes the line of each."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: dict[Key, int] = {}

    def document(self, events: Iterator[yaml.Event]) -> Any:
        data = None
        documents = 0
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._error(event, (), "must be one document, a second one begins here")
            elif isinstance(event, yaml.NodeEvent):
                data = self._value(event, events, ())
        if data is None:
            raise ConfigError(f"{self.path} must hold settings, it is empty")
        return data

    def _value(self, event: yaml.Event, events: Iterator[yaml.Event], key: Key) -> Any:
        self.lines.setdefault(key, event.start_mark.line + 1)
        if isinstance(event, yaml.AliasEvent):
            raise self._error(event, key, "must be written out, aliases (*name) are not followed")
        if len(key) > DEEPEST or len(self.lines) > MOST_ENTRIES:
            raise self._error(event, key[:4], f"must hold at most {MOST_ENTRIES} entries, {DEEPEST} deep")
        if getattr(event, "tag", None) not in _TAGS:
            raise self._error(event, key, f"must be plain YAML, tags such as {shown(event.tag)} are not followed")  # pyright: ignore[reportAttributeAccessIssue]
        match event:
            case yaml.MappingStartEvent():
                return self._mapping(events, key)
            case yaml.SequenceStartEvent():
                return self._sequence(events, key)
            case yaml.ScalarEvent():
                return self._scalar(event, key)
        raise self._error(event, key, "must be a value")

    def _mapping(self, events: Iterator[yaml.Event], key: Key) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for event in events:
            if isinstance(event, yaml.MappingEndEvent):
                break
            if not isinstance(event, yaml.ScalarEvent):
                raise self._error(event, key, "must have words as keys")
            name = self._text(event, key)
            inner = (*key, name)
            if name in values:
                raise self._error(event, inner, f"is given twice, first in line {self.lines[inner]}; which one is meant?")
            self.lines[inner] = event.start_mark.line + 1
            values[name] = self._value(next(events), events, inner)
        return values

    def _sequence(self, events: Iterator[yaml.Event], key: Key) -> list[Any]:
        values: list[Any] = []
        for event in events:
            if isinstance(event, yaml.SequenceEndEvent):
                break
            values.append(self._value(event, events, (*key, len(values))))
        return values

    def _scalar(self, event: yaml.ScalarEvent, key: Key) -> Any:
        text = self._text(event, key)
        if not event.implicit[0]:  # quoted, or tagged as text
            return text
        if text.lower() in _WORDS:
            return _WORDS[text.lower()]
        if _INT.fullmatch(text):
            return int(text)
        return float(text) if _FLOAT.fullmatch(text) else text

    def _text(self, event: yaml.ScalarEvent, key: Key) -> str:
        if not all(" " <= letter < "\ud800" or letter > "\udfff" or letter in "\t\n" for letter in event.value):
            raise self._error(event, key, f"must hold characters that can be shown, got {shown(ascii(event.value))}")
        return event.value

    def _error(self, event: yaml.Event, key: Key, words: str) -> ConfigError:
        lines = {**self.lines, key: event.start_mark.line + 1}
        return ConfigError(Positions(path=self.path, lines=lines).fault(key, words))
