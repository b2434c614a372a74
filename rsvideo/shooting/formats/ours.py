"""Our own profiles (YAML), written so that people can read and correct them."""

import math
import re
from typing import Any

import yaml

from rsvideo.shooting.camera_profile import CameraProfile


def encode(profile: CameraProfile) -> tuple[bytes, tuple[str, ...]]:
    """The file, which holds everything; numbers have digits to a hundredth of their standard deviation."""
    data = _written(profile.model_dump(mode="json", exclude_none=True, exclude_defaults=True))
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=10_000).encode(), ()


class _Dumper(yaml.SafeDumper):
    """Short mappings and lists stand on one line; words that our reader would take for numbers stand in quotes."""

    def represent_mapping(self, tag, mapping, flow_style=None):  # noqa: ARG002 # the library's signature
        inner = mapping.values() if isinstance(mapping, dict) else ()
        return super().represent_mapping(tag, mapping, flow_style=bool(inner) and not any(map(_long, inner)))

    def represent_str(self, data: str):
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=None if re.fullmatch(r"[A-Za-z][\w /-]*", data) else '"')


_Dumper.add_representer(str, _Dumper.represent_str)


def _long(value: object) -> bool:
    return isinstance(value, dict | list) or (isinstance(value, str) and len(value) > 60)


def _written(data: Any) -> Any:
    """Numbers without a deviation or an origin stand alone, and none has more digits than its deviation supports."""
    if isinstance(data, list):
        return [_written(item) for item in data]
    if not isinstance(data, dict):
        return data
    if "value" not in data:
        return {key: _written(value) for key, value in data.items()}
    if std := data.get("std"):
        digits = 2 - math.floor(math.log10(std))
        data = data | {"value": round(data["value"], digits), "std": float(f"{std:.3g}")}
    return data["value"] if len(data) == 1 else data
