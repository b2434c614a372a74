"""What a person reads of a request's field: on the command line and in the JSON Schema, which are both made from it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from pydantic import BaseModel, BeforeValidator
from pydantic.fields import FieldInfo


@dataclass(frozen=True, kw_only=True)
class Option:
    """The words of one field; stands among the metadata of its annotation."""

    help: str
    metavar: str | None = None
    unless: str | None = None  # what holds where the field is left out, if its default does not say
    named: str | None = None  # on the command line, where it is not the field's own name
    clips_only: bool = False
    is_file: bool = False  # a path, relative to the file that says it; what the file holds steers the work
    many: bool = False  # too many values to list them all

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """The field's JSON Schema, with these words as its description."""
        clips = " Of clips only." if self.clips_only else ""
        unless = f" Left out: {self.unless}." if self.unless else ""
        return {**handler(schema), "description": self.help + unless + clips}


@dataclass(frozen=True, kw_only=True)
class OptionField:
    """A field of a section of a request that has an `Option`."""

    section: str
    name: str
    field: FieldInfo
    option: Option

    @property
    def key(self) -> str:
        """`camera.exposure`, as `--set` writes it."""
        return f"{self.section}.{self.name}"

    @property
    def flag(self) -> str:
        """`--exposure`, as the command line writes it."""
        return self.option.named or "--" + self.name.replace("_", "-")

    @property
    def types(self) -> tuple[Any, tuple[Any, ...]]:
        """The type of a value that is given, and what bounds it; `str` where people write it in a form of its own."""
        kind, bounds = self.field.annotation, list(self.field.metadata)
        while (parts := get_args(kind)) and (hasattr(kind, "__metadata__") or type(None) in parts):
            bounds += getattr(kind, "__metadata__", ())
            kind = next(part for part in parts if part is not type(None))
        inner = [part for each in bounds for part in (each, *getattr(each, "metadata", ()))]
        return (str if any(isinstance(each, BeforeValidator) for each in inner) else kind), tuple(inner)


def fields(model: type[BaseModel]) -> Iterator[OptionField]:
    """The fields with an `Option` of all sections of a model."""
    for section, part in model.model_fields.items():
        kind = part.annotation
        if get_origin(kind) is None and isinstance(kind, type) and issubclass(kind, BaseModel):
            for name, field in kind.model_fields.items():
                if option := next((each for each in field.metadata if isinstance(each, Option)), None):
                    yield OptionField(section=section, name=name, field=field, option=option)
