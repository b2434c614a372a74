"""How a page holds all that it needs: pictures as data, values as JSON, and a policy that lets nothing else in."""

import base64
import hashlib
import json
from importlib import resources

from markupsafe import Markup

from rsvideo.config.printable import printable


def text(name: str) -> str:
    """A template, style or script that stands beside this module."""
    return resources.files("rsvideo.report").joinpath(name).read_text(encoding="utf-8")


def policy(style: str, script: str | None = None) -> str:
    """The content security policy of a page with this style and script: what it shows is inside it, and it asks nobody for anything."""
    sources = ["default-src 'none'", "img-src data:", *(["media-src data:"] if script else []), f"style-src '{_hash(style)}'"]
    return "; ".join([*sources, *([f"script-src '{_hash(script)}'"] if script else []), "base-uri 'none'", "form-action 'none'"])


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def data_uri(content: bytes, kind: str) -> str:
    """The address of a picture or a video of the media type `kind` that stands in the page itself."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _written_out(value: object) -> object:
    """Plain values whose texts may be shown."""
    match value:
        case str():
            return printable(value, keep="\n\t")
        case dict():
            return {key: _written_out(each) for key, each in value.items()}
        case list() | tuple():
            return [_written_out(each) for each in value]
        case _:
            return value


def json_text(value: object) -> Markup:
    """JSON that may stand inside a script element."""
    return Markup(json.dumps(_written_out(value), ensure_ascii=True).replace("<", "\\u003c").replace("&", "\\u0026"))
