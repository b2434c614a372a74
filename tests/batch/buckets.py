"""Object storage for tests: moto's server in a process of its own, and a bucket for each test."""

import atexit
import functools
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

_ENVIRONMENT = {
    "AWS_ACCESS_KEY_ID": "testing",
    "AWS_SECRET_ACCESS_KEY": "testing",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_EC2_METADATA_DISABLED": "true",
    "AWS_CONFIG_FILE": os.devnull,
    "AWS_SHARED_CREDENTIALS_FILE": os.devnull,
}


@dataclass(frozen=True, kw_only=True)
class Bucket:
    """A bucket of its own."""

    name: str
    client: Any

    @property
    def address(self) -> str:
        return f"s3://{self.name}"

    def put(self, **data: bytes) -> None:
        for key, content in data.items():
            self.client.put_object(Bucket=self.name, Key=key, Body=content)

    def files(self, under: str = "") -> dict[str, bytes]:
        """All objects whose names begin so, by the rest of their names."""
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket=self.name, Prefix=under)
        keys = [each["Key"] for page in pages for each in page.get("Contents", [])]
        return {key.removeprefix(under): self.client.get_object(Bucket=self.name, Key=key)["Body"].read() for key in keys}


@functools.cache
def environment() -> dict[str, str]:
    """By which everything speaks to the server, which is started when this is first called."""
    program = "from moto.server import main; main(['-H', '127.0.0.1', '-p', '0'])"
    log = Path(tempfile.mkstemp(prefix="moto-")[1])  # a pipe that nobody reads would fill up, and stop it
    with log.open("wb") as file:
        server = subprocess.Popen([sys.executable, "-c", program], stderr=file, stdout=subprocess.DEVNULL)
    atexit.register(_end, server, log)
    while server.poll() is None:
        if found := re.search(r"http://127\.0\.0\.1:\d+", log.read_text()):
            return {**_ENVIRONMENT, "AWS_ENDPOINT_URL": found[0]}
        time.sleep(0.05)
    raise RuntimeError(f"moto's server has ended: {log.read_text()[-1000:]}")


def _end(server: "subprocess.Popen[bytes]", log: Path) -> None:
    server.kill()
    server.wait()
    log.unlink()


def made() -> Bucket:
    """A new bucket; `environment` is in force."""
    import boto3

    bucket = Bucket(name=f"bucket-{uuid4().hex[:12]}", client=boto3.client("s3"))
    bucket.client.create_bucket(Bucket=bucket.name)
    return bucket
