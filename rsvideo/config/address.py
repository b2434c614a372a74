"""Addresses of object storage, such as s3://bucket/folder/clip.mp4: which are taken, and what one says."""

import posixpath
import re
from dataclasses import dataclass
from pathlib import PurePosixPath

from pydantic import BaseModel, ConfigDict

from rsvideo.config.printable import printable

SCHEMES = ("s3", "gs", "az", "abfs")
_BUCKET = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,254}")
_MOST_SHOWN = 80  # characters of an address that is refused
_LONGEST = 1024  # bytes of an object's name, as S3 has it


class Origin(BaseModel):
    """An object as it was when a job was read, which each machine brings to a file of its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    address: str
    size: int  # bytes
    version: str  # changes when its content does
    modified_ns: int  # since 1970

    @property
    def name(self) -> str:
        """The last part of its address."""
        return PurePosixPath(self.address).name

    @property
    def folder(self) -> str:
        """The name of what it lies in."""
        return PurePosixPath(self.address).parent.name


@dataclass(frozen=True, kw_only=True)
class Address:
    """The parts of an address."""

    scheme: str
    bucket: str
    key: str  # without a slash at either end; empty: the bucket itself

    def __str__(self) -> str:
        return f"{self.scheme}://{self.path}"

    @property
    def path(self) -> str:
        """Bucket and key, as fsspec takes them."""
        return f"{self.bucket}/{self.key}" if self.key else self.bucket


def is_address(text: str) -> bool:
    """Whether a name is one of object storage, be it one that is refused, and not of a file."""
    return "://" in text


def parsed(text: str) -> Address:
    """The address in a text; ValueError for one that is not taken, or might reach what nobody meant."""
    scheme, _, rest = text.partition("://")
    if "::" in text or scheme not in SCHEMES:
        raise ValueError(f"an address must begin with {', '.join(f'{each}://' for each in SCHEMES)} and chain no others, got {_safe(text)}")
    bucket, _, key = rest.partition("/")
    if "@" in bucket:
        raise ValueError(f"an address must not hold a user or a password, got one of {scheme}://; they come from the environment")
    key = key.removesuffix("/")
    if not _BUCKET.fullmatch(bucket) or ".." in bucket:
        raise ValueError(f"an address must name a bucket, as in {scheme}://bucket/folder, got {_safe(text)}")
    if not text.isprintable() or "\\" in text or {"", ".", ".."} & set(key.split("/") if key else ()):
        raise ValueError(f"an address must hold no control characters, no \\, and no parts such as .. or //, got {_safe(text)}")
    if len(key.encode()) > _LONGEST:
        raise ValueError(f"an address must have at most {_LONGEST} bytes after its bucket, got {_safe(text)}")
    return Address(scheme=scheme, bucket=bucket, key=key)


def relative(text: str, folder: str) -> str:
    """The path from a folder to an object where both lie in one bucket, which stays the same when both are moved; else the address."""
    one, other = parsed(text), parsed(folder)
    if (one.scheme, one.bucket) != (other.scheme, other.bucket):
        return text
    return posixpath.relpath(f"/{one.key}", f"/{other.key}")


def _safe(text: str) -> str:
    """The text as messages show it, without what stands before an @."""
    return repr(printable(re.sub(r"(://|::)[^/]*@", r"\1...@", text)[:_MOST_SHOWN]))
