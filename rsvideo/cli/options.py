"""The options of a request on the command line, made from its models, which say of each what it means and may be.

The models take time to load, so the options are made when a command is called or its own help is printed.
"""

import enum
import inspect
import os
from collections.abc import Callable, Mapping
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer
from typer.core import TyperCommand

if TYPE_CHECKING:
    from rsvideo.config.option import OptionField
    from rsvideo.config.request import Request, Section, Sections
    from rsvideo.config.simulation import Simulation

    Model = TypeVar("Model", bound=Section)

DirectionName = Literal["top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]
MOST_JOBS = 256  # processes at a time; more is a slip
MOST_THREADS = 1024  # of one process; more is a slip
Given = Mapping[str, Any]
"""What was given, under keys such as `camera.exposure`; the parameter of this type stands where the options are listed."""

NOTHING: Given = MappingProxyType({})

Threads = Annotated[int | None, typer.Option(min=1, max=MOST_THREADS, help="[default: all cores]")]

_OFFERED = "__offered__"


def offers(*names: str, of: Literal["request", "simulation"] = "request") -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Let a command take the options of these sections (`camera`) or fields (`input.rate`) of a request, as its parameter `given`.

    `of` is the file of `rsvideo.config` that has them.
    """

    def mark(command: Callable[..., Any]) -> Callable[..., Any]:
        signature = inspect.signature(command)
        setattr(command, _OFFERED, (names, of, signature))
        own = [parameter for parameter in signature.parameters.values() if parameter.name != "given"]
        command.__signature__ = signature.replace(parameters=own)  # pyright: ignore[reportFunctionMemberAccess] # what typer reads
        return command

    return mark


class RequestCommand(TyperCommand):
    """A command that takes options of a request beside its own."""

    @cached_property
    def _whole(self) -> Any:
        """The command with all of its options."""
        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        own = getattr(self.callback, "__wrapped__")  # noqa: B009 # within what typer made of it
        app.command(context_settings=dict(self.context_settings))(_complete(own))
        return typer.main.get_command(app)

    def get_params(self, ctx: Any) -> Any:
        """All options, those of the request among them."""
        return self._whole.get_params(ctx)

    def invoke(self, ctx: Any) -> Any:
        """Call the command with what was given."""
        return self._whole.invoke(ctx)


def request(source: Path, output: Path, given: Given, *, overwrite: bool = False) -> "Request":
    """The request that options state; ValueError, in the command line's words, where one cannot be meant."""
    from rsvideo.config.request import Request

    return Request.of(source, output, sections(given), overwrite=overwrite)


def sections(given: Given) -> "Sections":
    """What options state, in the sections of a request."""
    from rsvideo.config.request import Sections, option_fields

    return _validated(given, Sections, option_fields())


def simulation(given: Given) -> "Simulation":
    """What options state of a simulation."""
    from rsvideo.config.simulation import Simulation, option_fields

    return _validated(given, Simulation, option_fields())


def _validated(given: Given, model: "type[Model]", fields: "tuple[OptionField, ...]") -> "Model":
    """What options state, as a model; ValueError, in the command line's words, where one cannot be meant."""
    from pydantic import ValidationError

    stated: dict[str, dict[str, Any]] = {}
    for key, value in given.items():
        section, _, name = key.partition(".")
        stated.setdefault(section, {})[name] = value
    try:
        return model.model_validate(stated)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        field = next(each for each in fields if (each.section, each.name) == fault["loc"][:2])
        words = str(fault["msg"]).removeprefix("Value error, ").replace(field.name, field.name.replace("_", "-"), 1)
        own = fault["type"] == "value_error"
        raise ValueError(words if own else f"{field.flag}: {words[:1].lower()}{words[1:]}, got {fault['input']!r}") from error


def use_threads(threads: int | None) -> None:
    """Let the compiled kernels use so many; before they are first called, since it is read then."""
    from rsvideo.threads import VARIABLE

    if threads:
        os.environ[VARIABLE] = str(threads)


def flag(key: str) -> str:
    """An option as it is written on the command line."""
    from rsvideo.config.request import option_fields

    return next(each.flag for each in option_fields() if each.key == key)


def _complete(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command as typer is to see it: a parameter for each option that it offers."""
    names, of, signature = getattr(command, _OFFERED)
    options = import_module(f"rsvideo.config.{of}").option_fields()
    fields: dict[str, OptionField] = {each.key.replace(".", "_"): each for each in options if {each.section, each.key} & {*names}}

    def called(**words: Any) -> Any:
        given = {fields[name].key: value for name, value in words.items() if name in fields and value is not None}
        return command(**{name: value for name, value in words.items() if name not in fields}, given=given)

    parameters: list[inspect.Parameter] = []
    for parameter in signature.parameters.values():
        if parameter.name == "given":
            parameters += [_parameter(name, each) for name, each in fields.items()]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    called.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportFunctionMemberAccess] # what typer reads
    called.__doc__ = command.__doc__
    return called


def _parameter(name: str, each: "OptionField") -> inspect.Parameter:
    kind, bounds = each.types
    words = typer.Option(each.flag, metavar=each.option.metavar, help=_help(each), **_limits(kind, bounds))
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[_plain(kind) | None, words])


def _help(each: "OptionField") -> str:
    """The field's words, and what holds without it."""
    default, words = each.field.default, each.option.help
    if each.option.clips_only and not words.startswith("Of a "):
        words = f"Of a clip: {words if words[:2].isupper() else words[:1].lower() + words[1:]}"
    unless = each.option.unless or ("" if default in (None, False) else str(getattr(default, "value", default)))
    return words + (f" [default: {unless}]" if unless else "")


def _plain(kind: Any) -> Any:
    """The type as typer knows it: a list of words for an enumeration, text for a path."""
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return Literal[tuple(str(member.value) for member in kind)]
    return str if kind is Path else kind


def _limits(kind: Any, bounds: tuple[Any, ...]) -> dict[str, Any]:
    if kind not in (int, float):
        return {}
    limits = {"min": next((each.ge for each in bounds if hasattr(each, "ge")), None)}
    return limits | {"max": next((each.le for each in bounds if hasattr(each, "le")), None)}
