"""A server of the pages for tests, in a process of its own, and plain requests to it."""

import contextlib
import http.client
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

STAND_IN = Path(__file__).with_name("stand_in.py")


@dataclass(frozen=True, kw_only=True)
class Server:
    """A server that runs."""

    address: str  # with its token
    process: subprocess.Popen[str]

    @property
    def port(self) -> int:
        return urlsplit(self.address).port or 0

    @property
    def token(self) -> str:
        return urlsplit(self.address).path.strip("/")

    def ask(
        self,
        path: str,
        *,
        method: str = "GET",
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
        token: str | None = None,
    ) -> tuple[int, bytes]:
        """A request as any program on this machine can send it."""
        given = {"Host": f"127.0.0.1:{self.port}"} | dict(headers or {})
        with contextlib.closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)) as connection:
            connection.request(method, f"/{self.token if token is None else token}/{path}", body=body, headers=given)
            answer = connection.getresponse()
            return answer.status, answer.read()

    def tell(self, path: str, **values: Any) -> dict[str, Any]:
        """What a page's own request is answered, with HTTP's number as `status`."""
        headers = {"Content-Type": "application/json", "Origin": f"http://127.0.0.1:{self.port}", "Sec-Fetch-Site": "same-origin"}
        status, data = self.ask(path, method="POST", body=json.dumps(values).encode(), headers=headers)
        return json.loads(data) | {"status": status}


@contextlib.contextmanager
def serving(*folders: Path, state: Path, **environment: object) -> Iterator[Server]:
    """A server of these folders, ended as Ctrl-C ends it: with all processes of its group."""
    stated = {name: str(value) for name, value in environment.items()}
    line = [sys.executable, str(STAND_IN), "view", *map(str, folders)]
    pipe = subprocess.PIPE
    env = os.environ | {"XDG_STATE_HOME": str(state)} | stated
    with subprocess.Popen(line, stdout=pipe, text=True, env=env, start_new_session=True) as process:
        assert process.stdout
        try:
            yield Server(address=process.stdout.readline().strip(), process=process)
        finally:
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
