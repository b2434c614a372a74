"""What a worker of dask.distributed does for a run: nothing but to hand orders to a process of its own, so that heartbeats go on.

Nothing heavy is imported here, since Dask's workers answer the scheduler while they import.
"""

import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

_turn = threading.Lock()  # an order of a run that died may still be worked on
_child: "subprocess.Popen[bytes] | None" = None


def unseen(token: str, words: str, folders: Sequence[str]) -> str | None:
    """A folder that this machine does not share with the run, if there is one.

    The file `token` holds `words` where the disk of the results is shared; the sources are in `folders`.
    """
    try:
        shared = Path(token).read_text() == words
        tempfile.TemporaryFile(dir=Path(token).parent).close()
    except OSError:
        shared = False
    folder = str(Path(token).parent)
    return folder if not shared else next((each for each in folders if not Path(each).is_dir()), None)


def carry_out(order: bytes, threads: int, *, quiet: bool) -> bytes:
    """Restore a chunk in this machine's child process, which stays for the next order; the answer as JSON (`errands.py`)."""
    global _child
    with _turn:
        if _child is None or _child.poll() is not None:
            words = [sys.executable, "-m", "rsvideo.batch.errands", str(threads), *(["quiet"] if quiet else [])]
            environment = os.environ | {"PYTHONSAFEPATH": "1"}
            _child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, start_new_session=True)
        assert _child.stdin is not None
        assert _child.stdout is not None
        try:
            _child.stdin.write(order)
            _child.stdin.flush()
        except OSError:  # it has died, which the empty answer says too
            pass
        if answer := _child.stdout.readline():
            return answer
        raise RuntimeError(f"its process ended with exit code {_child.wait()}")
