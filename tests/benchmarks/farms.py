"""What many machines cost and survive: the same bytes, kills at random moments, the scheduler's overhead, the coordinator's memory.

    python tests/benchmarks/farms.py [--only same,overhead,kills,chunks,traffic] [--pairs 3] [--kills 30] [--chunks 10000] [--json FILE]

same: a clip of small frames is restored in each manner, with a scheduler of dask.distributed and its workers on this machine.
All else has a simulated core (tests/batch/stand_in.py), for which a frame is a byte and a chunk four of them, in workers that are real.
overhead: 200 frames that take 0.3 s each, in pairs, one run after the other. The core waits instead of computing, so that what else the
machine does counts little; it still counts in the overhead. kills: to a worker's process, to its nanny, or to the command that
coordinates. chunks: as many as the coordinator can take. traffic: 1080p frames that are decoded and encoded only.
"""

import argparse
import contextlib
import hashlib
import json
import os
import pickle
import random
import re
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import published
from batch import clip
from installed import RSVIDEO

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from rsvideo.batch import cluster, farm, plan
from tests.batch import clusters
from tests.batch.runs import STAND_IN, environment

FRAMES, ROWS, COLS = 66, 120, 192  # of the clip that is restored: three chunks
PACE, PACED = 0.3, 200  # seconds of a simulated frame, and how many there are
BYTES_A_CHUNK = 4  # of the simulated core

Row = dict[str, Any]


def small_clip(folder: Path) -> Path:
    """A job of one clip of small frames."""
    clip(folder / "a.mp4", ROWS, COLS, FRAMES)
    return stated(folder)


def simulated(folder: Path, chunks: int) -> Path:
    """A job of one clip for the simulated core."""
    (folder / "a.mp4").write_bytes(random.Random(chunks).randbytes(chunks * BYTES_A_CHUNK).replace(b"!", b"a").replace(b"?", b"a"))
    return stated(folder)


def stated(folder: Path) -> Path:
    """The job of the clip in a folder."""
    job = folder / "job.yaml"
    job.write_text("output: {folder: out}\ndefaults: {camera: {exposure: 1/50, readout: 15ms, focal_px: 230}}\nclips: [a.mp4]\n")
    return job


def call(*words: object) -> float:
    """Seconds that the command takes."""
    begun = time.perf_counter()
    subprocess.run([RSVIDEO, *map(str, words)], check=True, capture_output=True, timeout=7200)
    return time.perf_counter() - begun


def digests(job: Path) -> dict[str, str]:
    """SHA-256 of the results, of the sidecar without the seconds that the work took, and of what states its hash."""
    found = {}
    for path in sorted((job.parent / "out").iterdir()):
        data = path.read_bytes()
        if path.suffix == ".json":
            data = re.sub(rb'"seconds":[\d.e-]+', b"", data)
        found[path.name] = hashlib.sha256(data).hexdigest()
    return found


def redone(job: Path, *words: object) -> float:
    """Seconds of a run from the beginning."""
    return call("run", job, "--fresh", "--overwrite", "--progress", "none", *words)


@contextlib.contextmanager
def real_workers(folder: Path, threads: list[int]) -> Iterator[str]:
    """The address of a scheduler with workers that restore."""
    (folder / "dask").mkdir()
    with clusters.running(folder / "dask", {}) as machines:
        for each in threads:
            machines.start(
                "worker", machines.address, "--nworkers", "1", "--nthreads", str(each), "--local-directory", str(folder / "dask")
            )
        machines.await_workers(len(threads))
        yield machines.address


def same() -> Iterator[Row]:
    """Hashes of the results, however they are made."""

    def by_hand(job: Path) -> None:
        (job.parent / "out" / "a_rsvideo.mp4").unlink(missing_ok=True)
        listed = subprocess.run([RSVIDEO, "chunks", str(job), "--overwrite"], check=True, capture_output=True, timeout=600).stdout
        numbers = [each["chunk"] for each in json.loads(listed)]
        for number in random.Random(1).sample(numbers, len(numbers)):
            call("work", job, "--chunks", number)
        call("finish", job, "--overwrite")

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        job = small_clip(folder)
        first: dict[str, str] = {}
        with real_workers(folder, [1, 1]) as address:
            manners: dict[str, Callable[[], object]] = {
                "one process (`-j 1`)": lambda: redone(job, "-j", 1),
                "two processes (`-j 2`)": lambda: redone(job, "-j", 2),
                "two workers of dask.distributed": lambda: redone(job, "--scheduler", address),
                "`rsvideo work`, chunks in random order": lambda: by_hand(job),
            }
            for manner, make in manners.items():
                make()
                made = digests(job)
                first = first or made
                verdicts = [frame["verdict"] for frame in json.loads((folder / "out" / "a_rsvideo.rsvideo.json").read_text())["frames"]]
                restored = sum(verdict == "restored" for verdict in verdicts)
                yield {"manner": manner, "restored": restored, "same": "yes" if made == first else "no"}


def overhead(pairs: int) -> Iterator[Row]:
    """Seconds of a run by one process, and by one worker of a scheduler that waits already; a frame takes `PACE` seconds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        job = simulated(folder, PACED // BYTES_A_CHUNK)
        (folder / "dask").mkdir()
        with clusters.running(folder / "dask") as machines:
            machines.worker(PACE=PACE)
            machines.await_workers(1)
            line = [sys.executable, str(STAND_IN), "run", str(job), "--fresh", "--overwrite", "--progress", "none"]

            def run(*words: str) -> tuple[float, float]:
                return _spent(lambda: subprocess.run([*line, *words], check=True, capture_output=True, env=environment({"PACE": PACE})))

            run("--scheduler", machines.address)  # once, so that all have imported what they need
            rows: list[Row] = []
            for number in range(pairs):
                (alone, alone_cpu), (scheduled, scheduled_cpu) = run("-j", "1"), run("--scheduler", machines.address)
                more = {"overhead": 100 * (scheduled / alone - 1), "cpu": scheduled_cpu - alone_cpu}
                rows.append({"pair": str(number + 1), "alone": alone, "scheduled": scheduled, **more})
                yield rows[-1]
            yield {"pair": "median", **{key: statistics.median(row[key] for row in rows) for key in rows[0] if key != "pair"}}


def _spent(run: Callable[[], object]) -> tuple[float, float]:
    """Seconds of a run, and of cores: of its processes, and of those of Dask, which stay."""

    def cores() -> float:
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
        running = (process.cpu_times() for process in psutil.Process().children(recursive=True))
        return ended.ru_utime + ended.ru_stime + sum(times.user + times.system for times in running)

    before, begun = cores(), time.perf_counter()
    run()
    return time.perf_counter() - begun, cores() - before


def kills(count: int) -> Iterator[Row]:
    """Random ends of workers, nannies and coordinators while jobs of 150 simulated chunks run, until there were so many."""
    chance, chunks = random.Random(16), 150
    struck = {"worker": 0, "nanny": 0, "coordinator": 0}
    jobs = same_bytes = again = lost = 0
    while sum(struck.values()) < count:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            job, diary = simulated(folder, chunks), folder / "diary"
            expected = _undisturbed(job)
            mishaps = {"DIARY": diary, "PACE": 0.08}
            _killed_until_done(folder, job, mishaps, chance, struck, count)
            jobs += 1
            same_bytes += (job.parent / "out" / "a_rsvideo.mp4").read_bytes() == expected
            done: set[str] = set()
            for line in diary.read_text().splitlines():
                what, _, chunk = line.partition(" ")
                again += what == "begun" and chunk in done
                done |= {chunk} if what == "done" else set()
            lost += chunks - len(done)
    total = {"killed": sum(struck.values()), "jobs": jobs, "same": same_bytes, "lost": lost, "again": again}
    yield {**struck, **total}


def _undisturbed(job: Path) -> bytes:
    words = [sys.executable, str(STAND_IN), "run", str(job)]
    subprocess.run(words, check=True, capture_output=True, timeout=120, env=environment({}))
    out = job.parent / "out" / "a_rsvideo.mp4"
    data = out.read_bytes()
    for path in out.parent.iterdir():
        path.unlink()
    return data


def _killed_until_done(folder: Path, job: Path, mishaps: Row, chance: random.Random, struck: dict[str, int], count: int) -> None:
    (folder / "dask").mkdir()
    with clusters.running(folder / "dask") as machines:
        nannies = [machines.worker(**mishaps) for _ in range(2)]
        machines.await_workers(2)
        line = [sys.executable, str(STAND_IN), "run", str(job), "--scheduler", machines.address]

        def start() -> subprocess.Popen[bytes]:
            return subprocess.Popen(line, env=environment({}), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        command = start()
        while True:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = command.wait(timeout=2 + 8 * chance.random())
                if code == 0 or (code == 4 and not [*(job.parent / "out").glob(".rsvideo-*")]):  # 4: killed when all was done
                    return
            if command.poll() is not None:
                raise RuntimeError(f"the run ended with {command.returncode}")
            if sum(struck.values()) == count:
                continue
            target, nanny = chance.choice([*struck]), chance.choice(nannies)
            if target == "coordinator":
                command.kill()
                command.wait()
                command = start()
            elif target == "nanny":
                nanny.kill()
                nanny.wait()
                nannies[nannies.index(nanny)] = machines.worker(**mishaps)
            else:
                workers = [each for each in psutil.Process(nanny.pid).children() if "spawn_main" in " ".join(each.cmdline())]
                if not workers:
                    continue
                os.kill(workers[0].pid, signal.SIGKILL)
            struck[target] += 1


def chunks(count: int) -> Iterator[Row]:
    """The coordinator's memory, and its chunks a second, over a clip of so many simulated chunks."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        job = simulated(folder, count)
        (folder / "dask").mkdir()
        with clusters.running(folder / "dask") as machines:
            for _ in range(2):
                machines.worker()
            machines.await_workers(2)
            line = [sys.executable, str(STAND_IN), "run", str(job), "--scheduler", machines.address, "--progress", "jsonl"]
            working = subprocess.Popen(line, env=environment({}), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
            process, taken, tenth = psutil.Process(working.pid), 0, max(1, count // 10)
            begun, used = time.perf_counter(), 0.0
            assert working.stdout is not None
            for text in working.stdout:
                if json.loads(text)["event"] == "chunk":
                    taken += 1
                    if taken == 1:
                        begun, used = time.perf_counter(), sum(process.cpu_times()[:2])
                    elif taken % tenth == 0:
                        seconds, spent = time.perf_counter() - begun, sum(process.cpu_times()[:2]) - used
                        memory = process.memory_info().rss / 1e6
                        yield {"chunks": taken, "memory": memory, "rate": taken / seconds, "cpu": 1e3 * spent / taken}
            if working.wait() != 0:
                raise RuntimeError(f"the run ended with {working.returncode}")


def traffic() -> Iterator[Row]:
    """What is moved and spent for a frame of 1080p and for a chunk of them, as decoded: nothing is restored."""
    with tempfile.TemporaryDirectory() as name:
        spent, stored, order = {}, 0.0, b""
        for frames in (8, 64):
            folder = Path(name) / str(frames)
            folder.mkdir()
            clip(folder / "a.mp4", 1080, 1920, frames)
            job = folder / "job.yaml"
            job.write_text("output: {folder: out}\ndefaults: {deblur: {method: none}}\nclips: [a.mp4]\n")
            call("chunks", job)
            batch = plan.read(job, overwrite=True)
            wanted = farm.orders(batch, farm.layout(batch, job), (0,))
            order = pickle.dumps(cluster.elsewhere(wanted[0]))
            call("work", job, "--chunks", f"0-{(frames - 1) // 32}")
            stored = sum(path.stat().st_size for path in folder.rglob("store/*/*/*")) / frames / 1e6
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            call("finish", job)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent[frames] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        yield {"what": "an order, through the scheduler", "amount": len(order) / 1e3, "unit": "kB a chunk"}
        yield {"what": "restored pictures, to the store and from it", "amount": stored, "unit": "MB a frame"}
        yield {"what": "the coordinator's encoding", "amount": 1e3 * (spent[64] - spent[8]) / 56, "unit": "ms of a core a frame"}


def main() -> None:
    """Measure, print as Markdown, and write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="same,overhead,kills,chunks,traffic")
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--chunks", type=int, default=10_000)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    measures: dict[str, Callable[[], Iterator[Row]]] = {
        "same": same,
        "overhead": lambda: overhead(args.pairs),
        "kills": lambda: kills(args.kills),
        "chunks": lambda: chunks(args.chunks),
        "traffic": traffic,
    }
    measured = {f"farms_{name}": list(measures[name]()) for name in args.only.split(",")}
    for rows in measured.values():
        published.print_rows(rows)
    if args.json:
        published.write(args.json, measured)


if __name__ == "__main__":
    main()
