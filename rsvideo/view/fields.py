"""The settings of a clip as a page shows and edits them, made from the one list of options: type, unit, bounds, default and words."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rsvideo.config.media import is_clip
from rsvideo.config.method import Method
from rsvideo.config.option import OptionField
from rsvideo.config.quantity import HAND_HELD_LIMIT
from rsvideo.config.request import Request, Sections, option_fields
from rsvideo.shooting import profiles
from rsvideo.view.opened import Opened, OutsideError

_UNITS = {"TIME": "s, ms, us or 1/50", "PX": "px", "DEGREES": "degrees", "FPS": "frames a second", "SECONDS": "s", "FROM-TO": "min:s-min:s"}
_SECTIONS = ("input", "camera", "motion", "deblur", "encoding")  # a pipe has no page
_ELSEWHERE = ("pipe.", "encoding.side_by_side", "input.range")  # what makes no sense in a preview
_TIMES = {"camera.exposure": f"more than 0, at most {HAND_HELD_LIMIT:g} s"}
_TIMES |= {f"camera.{name}": f"0 to {HAND_HELD_LIMIT:g} s" for name in ("readout", "row_time")}

Stated = Mapping[str, Mapping[str, Any]]
"""What a page states: sections of settings, each a mapping from names to what was typed."""


class SettingsError(ValueError):
    """What was typed into fields cannot be meant; the words by the fields' keys."""

    def __init__(self, faults: Mapping[str, str]) -> None:
        super().__init__(next(iter(faults.values())))
        self.faults = dict(faults)


def listed(source: Path) -> list[dict[str, Any]]:
    """The fields that concern a photograph or a clip, as plain values."""
    schema = Sections.model_json_schema()
    clip = is_clip(source)
    return [
        _field(each, schema["$defs"][type(getattr(Sections(), each.section)).__name__]["properties"][each.name])
        for each in option_fields()
        if each.section in _SECTIONS and not each.key.startswith(_ELSEWHERE) and (clip or not each.option.clips_only)
    ]


def _field(each: OptionField, schema: Mapping[str, Any]) -> dict[str, Any]:
    """One field; `schema` is its part of the JSON Schema."""
    kinds = [schema, *schema.get("anyOf", ())]
    default = each.field.default
    choices = next((kind["enum"] for kind in kinds if "enum" in kind), None)
    if each.key == "deblur.method":
        choices = [str(method) for method in Method]
    if each.key == "camera.direction":
        choices = ["top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]
    return {
        "key": each.key,
        "section": each.section,
        "name": each.name.replace("_", " "),
        "help": each.option.help,
        "unit": _UNITS.get(each.option.metavar or "", ""),
        "bounds": _TIMES.get(each.key) or _bounds(kinds),
        "default": "" if default in (None, False) else str(getattr(default, "value", default)),
        "unless": each.option.unless or "",
        "choices": choices,
        "switch": any(kind.get("type") == "boolean" for kind in kinds),
        "file": each.option.is_file,
    }


def _bounds(kinds: list[Any]) -> str:
    for kind in kinds:
        low, high = kind.get("minimum"), kind.get("maximum")
        above = kind.get("exclusiveMinimum")
        if above is not None and high is not None:
            return f"more than {above:g}, at most {high:g}"
        if low is not None and high is not None:
            return f"{low:g} to {high:g}"
        if low is not None:
            return f"at least {low:g}"
    return ""


def sections(stated: Stated, source: Path, opened: Opened) -> Sections:
    """The settings that a page states; SettingsError where some cannot be meant, OutsideError where one names a file elsewhere."""
    allowed = {each.key: each for each in option_fields()}
    given: dict[str, dict[str, Any]] = {}
    for section, values in stated.items():
        for name, value in values.items():
            field = allowed.get(f"{section}.{name}")
            if field is None or field.section not in _SECTIONS:
                raise SettingsError({f"{section}.{name}": f"there is no setting {section}.{name}; reload the page"})
            if value is None or value == "":
                continue
            given.setdefault(section, {})[name] = _beside(field, value, source, opened)
    try:
        return Sections.model_validate(given)
    except ValidationError as error:
        raise SettingsError(_faults(error)) from error


def _faults(error: ValidationError) -> dict[str, str]:
    """What is wrong, by the fields' keys, each in a sentence that names the value."""
    faults: dict[str, str] = {}
    for fault in error.errors(include_url=False):
        key = ".".join(map(str, fault["loc"][:2]))
        words = str(fault["msg"]).removeprefix("Value error, ")
        own = fault["type"] == "value_error"
        name = str(fault["loc"][1]).replace("_", " ") if len(fault["loc"]) > 1 else key
        faults.setdefault(key, words if own else f"{name}: {words[:1].lower()}{words[1:]}, got {str(fault['input'])[:60]!r}")
    return faults


def _beside(field: OptionField, value: Any, source: Path, opened: Opened) -> Any:
    """The value; of a file, which is named as it lies beside the clip, its path."""
    if not field.option.is_file:
        return value
    if not isinstance(value, str) or "\0" in value or len(value) > 4000:
        raise SettingsError({field.key: f"{field.name} must be the name of a file"})
    path = source.parent / value
    inside = opened.holds(path)
    if field.key == "camera.profile" and not (inside and path.is_file()):
        if any(mark in value for mark in "/\\") or value.startswith("."):
            raise OutsideError(f"the profile {value} lies outside of the folders that were opened; copy it beside the clip")
        if not inside or (profiles.is_file(value) and not path.exists()):
            raise SettingsError({field.key: f"there is no profile {value} beside the clip; calibrate makes one"})
        return value
    if not inside:
        raise OutsideError(f"{value} lies outside of the folders that were opened; copy it beside the clip")
    if not path.is_file():
        raise SettingsError({field.key: f"there is no file {value} beside {source.name}; is its name mistyped?"})
    return str(path)


def request(source: Path, output: Path, wanted: Sections) -> Request:
    """The request that a page's settings come to."""
    return Request.of(source, output, wanted, overwrite=True)
