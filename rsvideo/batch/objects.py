"""Files in object storage, through fsspec: they appear whole or not at all, and are never renamed.

An upload that breaks off leaves no object. What comes back is hashed on this machine, and what has another hash is removed, to be made
anew. The filesystems of fsspec are opened when they are first needed; credentials and endpoints are those of the environment.
"""

import contextlib
import errno
import fnmatch
import glob
import hashlib
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

from rsvideo.config import address, files
from rsvideo.config.address import Address, Origin
from rsvideo.config.files import UnreachableError, UnreadableError
from rsvideo.config.patterns import DEEPEST, MOST_LOOKED_AT
from rsvideo.config.placing import Made

_OPEN = "open"  # the object that a place consists of which was made
_PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "az": "adlfs", "abfs": "adlfs"}
_CONNECT, _READ, _TRIES = 10, 60, 3  # seconds to connect, seconds without a byte, and how often
_BLOCK = 8 << 20
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)  # of this machine's disk, not of the network


@dataclass(frozen=True, kw_only=True)
class Objects:
    """Objects whose addresses begin alike; what each operation is for, `rsvideo.batch.places.Place` says."""

    address: str

    @property
    def at_once(self) -> bool:
        """Uploads take their time."""
        return False

    def at(self, name: str = "") -> str:
        """The address."""
        return f"{self.address}/{name}" if name else self.address

    def within(self, name: str) -> "Objects":
        """Addresses that go on with this name."""
        return Objects(address=self.at(name))

    def check_writable(self) -> None:
        """By writing."""
        proof = f".rsvideo-proof-{hashlib.sha256(self.address.encode()).hexdigest()[:8]}"
        self.state(proof, b".")
        _remove(self.at(proof))

    def make(self) -> None:
        """By an object that says so."""
        self.state(_OPEN, b".")

    def there(self) -> bool:
        """Whether that object is."""
        return self.stamp(_OPEN) is not None

    def remove(self) -> None:
        """That object first, so that nobody puts more."""
        if self.there():
            _remove(self.at(_OPEN))
        with _reaching(self.address) as system:
            path = address.parsed(self.address).path
            if held := [each for each in system.find(path) if each.startswith(f"{path}/")]:
                system.rm(held)

    def names(self) -> list[str]:
        """Of what lies directly under the address."""
        return sorted(each["name"].rpartition("/")[2] for each in _children(address.parsed(self.address)) if each["type"] == "file")

    def stamp(self, name: str) -> tuple[int, int] | None:
        """Its size, and a number that stands for its version."""
        if (found := origin(address.parsed(self.at(name)))) is None:
            return None
        return found.size, int(hashlib.sha256(found.version.encode()).hexdigest()[:15], 16)

    def digest(self, name: str) -> str | None:
        """Downloaded block by block."""
        digest = hashlib.sha256()
        with contextlib.suppress(FileNotFoundError), _reaching(self.at(name)) as system:
            with system.open(address.parsed(self.at(name)).path, "rb", block_size=_BLOCK, cache_type="readahead") as file:
                while block := file.read(_BLOCK):
                    digest.update(block)
            return digest.hexdigest()
        return None

    def holds(self, name: str, digest: str) -> bool:  # noqa: ARG002 # which is found out when it is moved
        """Whether it is there: only what is whole ever is."""
        return self.stamp(name) is not None

    def put(self, name: str, digest: str, content: Path | bytes) -> None:  # noqa: ARG002 # what is there may have another
        """Upload it over what is there; where the place was removed meanwhile, take it back."""
        if self.there():
            self._upload(name, content)
        if not self.there():
            with contextlib.suppress(OSError):
                _remove(self.at(name))
            raise FileNotFoundError(errno.ENOENT, "nobody waits for it any more", self.at(name))

    def fetch(self, name: str, digest: str, path: Path) -> bool:
        """Download it; what has another hash is removed, here and there."""
        try:
            _download(address.parsed(self.at(name)), path)
            if files.sha256(path) == digest:
                return True
        except FileNotFoundError:
            return False
        path.unlink()
        _remove(self.at(name))
        return False

    @contextlib.contextmanager
    def on_disk(self, name: str, *, most: int) -> Iterator[Path]:
        """A copy in a folder that goes at the end."""
        with tempfile.TemporaryDirectory(prefix="rsvideo-") as folder:
            path, stamp = Path(folder, "copy"), self.stamp(name)
            if stamp is not None and stamp[0] <= most:
                with contextlib.suppress(FileNotFoundError):
                    _download(address.parsed(self.at(name)), path)
            yield path

    def read(self, name: str, *, most: int) -> bytes:
        """All bytes."""
        if not (stamp := self.stamp(name)) or not stamp[0]:
            raise UnreadableError(f"{self.at(name)} {'is empty' if stamp else 'does not exist'}")
        if stamp[0] > most:
            raise UnreadableError(f"{self.at(name)} must hold at most {most / 1e6:g} MB, it holds {stamp[0] / 1e6:.0f} MB")
        try:
            with _reaching(self.at(name)) as system:
                return system.cat_file(address.parsed(self.at(name)).path, start=0, end=stamp[0])
        except FileNotFoundError as error:
            raise UnreadableError(f"{self.at(name)} does not exist") from error

    def state(self, name: str, data: bytes) -> None:
        """Objects appear whole."""
        self._upload(name, data)

    def publish(self, made: Sequence[Made]) -> None:
        """One after the other: the sidecar, which is last, never stands beside what is not there yet."""
        for each in made:
            self._upload(each.path.name, each.at)

    def _upload(self, name: str, content: Path | bytes) -> None:
        try:
            with _reaching(self.at(name)) as system:
                if isinstance(content, bytes):
                    system.pipe_file(address.parsed(self.at(name)).path, content)
                else:
                    system.put_file(str(content), address.parsed(self.at(name)).path)
        except FileNotFoundError as error:
            raise UnreachableError(errno.ENOENT, "there is no such bucket", self.at(name)) from error


def origin(at: Address) -> Origin | None:
    """An object as it is now; None where there is none. UnreachableError where there is no such bucket, or no access."""
    try:
        with _reaching(str(at)) as system:
            found = system.info(at.path)
    except FileNotFoundError as error:
        with _reaching(str(at)) as system:
            if not system.exists(at.bucket):
                raise UnreachableError(errno.ENOENT, f"there is no bucket {at.bucket}, or not for us", str(at)) from error
        return None
    return _as_origin(at.scheme, found) if found["type"] == "file" else None


def check_readable(text: str) -> None:
    """Raises UnreachableError, or ValueError, where an object cannot be read."""
    if origin(address.parsed(text)) is None:
        raise UnreachableError(errno.ENOENT, "it does not exist", text)


def download(source: Origin, path: Path) -> None:
    """Bring a source to this machine as it was when the job was read; UnreadableError where it has changed."""
    try:
        _download(address.parsed(source.address), path)
        if origin(address.parsed(source.address)) == source and path.stat().st_size == source.size:
            return
    except FileNotFoundError:
        pass
    raise UnreadableError(f"{source.address} was changed or removed since the job was read; the same command reads it anew")


def matching(at: Address, *, most: int) -> list[Origin]:
    """At most one more than `most` objects whose addresses match a pattern, in order; ValueError where too much has to be looked at."""
    found = []
    for each in _Search(pattern=str(at), scheme=at.scheme).within(at.bucket, at.key.split("/"), 0):
        found.append(_as_origin(at.scheme, each))
        if len(found) > most:
            break
    return sorted({each.address: each for each in found}.values(), key=lambda each: each.address)


@dataclass(kw_only=True)
class _Search:
    pattern: str
    scheme: str
    looked_at: int = 0

    def within(self, folder: str, parts: Sequence[str], depth: int) -> Iterator[dict[str, Any]]:
        """What the rest of the pattern stands for under one address."""
        first, *rest = parts
        if depth > DEEPEST:
            raise ValueError(f"{self.pattern!r} must lead through at most {DEEPEST} folders within each other")
        if first == "**" and rest:
            yield from self.within(folder, rest, depth)
        if rest and not glob.has_magic(first):
            yield from self.within(f"{folder}/{first}", rest, depth + 1)
            return
        for each in self.children(folder):
            name, is_file = each["name"].rpartition("/")[2], each["type"] == "file"
            if first == "**" and not is_file:
                yield from self.within(each["name"], parts, depth + 1)
            elif not fnmatch.fnmatchcase(name, first) or (name.startswith(".") and not first.startswith(".")):
                continue
            elif is_file and not rest:
                yield each
            elif not is_file and rest and first != "**":
                yield from self.within(each["name"], rest, depth + 1)

    def children(self, folder: str) -> list[dict[str, Any]]:
        """What lies directly under an address."""
        found = _children(address.parsed(f"{self.scheme}://{folder}"))
        self.looked_at += len(found)
        if self.looked_at > MOST_LOOKED_AT:
            raise ValueError(f"{self.pattern!r} must have at most {MOST_LOOKED_AT} objects to be looked at, there are more")
        return found


def _children(at: Address) -> list[dict[str, Any]]:
    try:
        with _reaching(str(at)) as system:
            if at.scheme == "s3":  # whose public `ls` holds all of a bucket, however much that is
                from fsspec.asyn import sync

                found: Any = sync(system.loop, system._lsdir, at.path, max_items=MOST_LOOKED_AT + 1)
            else:
                found = system.ls(at.path, detail=True)
    except FileNotFoundError as error:
        with _reaching(str(at)) as system:
            if not system.exists(at.bucket):
                raise UnreachableError(errno.ENOENT, f"there is no bucket {at.bucket}, or not for us", str(at)) from error
        return []
    return [each for each in found if each["name"].startswith(f"{at.path}/") and not each["name"].endswith("/")]


def _as_origin(scheme: str, found: dict[str, Any]) -> Origin:
    at = str(address.parsed(f"{scheme}://{found['name']}"))
    changed = next((found[name] for name in ("LastModified", "last_modified", "mtime", "updated") if found.get(name)), None)
    version = str(next((found[name] for name in ("ETag", "etag", "content_settings") if found.get(name)), changed))
    if isinstance(changed, str):
        changed = datetime.fromisoformat(changed)
    seconds = int(changed.timestamp()) if isinstance(changed, datetime) else 0  # lists state fractions, single objects do not
    return Origin(address=at, size=int(found["size"]), version=version, modified_ns=seconds * 10**9)


def _download(at: Address, path: Path) -> None:
    """FileNotFoundError where there is no such object."""
    with _reaching(str(at)) as system:
        system.get_file(at.path, str(path))


def _remove(text: str) -> None:
    with contextlib.suppress(FileNotFoundError), _reaching(text) as system:
        system.rm_file(address.parsed(text).path)


@contextlib.contextmanager
def _reaching(text: str) -> Iterator[Any]:
    """The filesystem of an address; but for objects that are missing, and this machine's disk, all that goes wrong is UnreachableError."""
    system = _system(address.parsed(text).scheme)
    try:
        yield system
    except (FileNotFoundError, UnreachableError):
        raise
    except Exception as error:  # whatever the network, and the libraries that speak to it, lead to
        if isinstance(error, OSError) and error.errno in _FULL:
            raise
        raise UnreachableError(errno.EIO, _words(error), text) from error


def _words(error: Exception) -> str:
    words, kind = " ".join(str(error).split())[:200], type(error).__name__
    if "Credentials" in kind:
        return "there are no credentials; for s3:// they come from AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or from AWS_PROFILE"
    if isinstance(error, PermissionError):
        return f"no access; are the credentials those of its owner? ({words or kind})"
    return words or kind


@cache
def _system(scheme: str) -> Any:
    try:
        import fsspec

        kind = fsspec.get_filesystem_class(scheme)
    except ImportError as error:
        package = _PACKAGES[scheme]
        brings = "rsvideo[objects]" if scheme == "s3" else package
        raise ValueError(f"{scheme}:// needs fsspec and {package}; pip install '{brings}' brings it") from error
    options: dict[str, Any] = {"use_listings_cache": False, "skip_instance_cache": True}
    if scheme == "s3":
        options["config_kwargs"] = {
            "connect_timeout": _CONNECT,
            "read_timeout": _READ,
            "retries": {"total_max_attempts": _TRIES, "mode": "standard"},
        }
    system = kind(**options)
    system.retries = 2  # of s3fs itself, for what boto does not try again
    return system
