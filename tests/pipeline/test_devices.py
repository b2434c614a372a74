"""Which device computes, who settles it, and what becomes of a GPU that is not there or too small."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from rsvideo.config.method import Method
from rsvideo.config.request import Request
from rsvideo.frame import Frame
from rsvideo.gpu import device
from rsvideo.gpu.device import DeviceMemoryError
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import still
from rsvideo.pipeline import deblur, devices, fingerprint, output, processes
from rsvideo.pipeline.pieces import Outcome
from rsvideo.pipeline.prepare import Task, prepare
from rsvideo.progress import ignore
from rsvideo.restoration import device_frame, nonblind, single_frame
from rsvideo.restoration.blurred_frame import BlurredFrame
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.settings import Settings

GOOD: dict[str, Any] = {"exposure": 0.02, "readout": 0.02, "focal_px": 100}


@pytest.fixture(autouse=True)
def _anew(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What was found of this machine counts for no test."""
    monkeypatch.delenv(device.SIMULATOR, raising=False)
    device.take([])
    yield
    device.take([])


@pytest.fixture(params=[True, False], ids=["a device", "no device"])
def there(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    monkeypatch.setattr(device, "unavailable", lambda: None if request.param else "there is no NVIDIA driver")
    return request.param


def wanted(folder: Path, **of_deblur: Any) -> Request:
    source = folder / "in.png"
    cv2.imwrite(str(source), np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8))
    return Request.model_validate({"source": source, "output": folder / "out.png", "camera": GOOD, "deblur": of_deblur})


def test_auto_takes_a_device_where_there_is_one_and_the_task_keeps_to_it(tmp_path: Path, there: bool) -> None:
    task = prepare(wanted(tmp_path))
    found = "cuda" if there else "cpu"
    assert task.settings.device == task.request.deblur.device == found


@pytest.mark.parametrize("method", [Method.UNIFORM, Method.STITCH, Method.NONE])
def test_methods_that_know_no_gpu_stay_on_the_processor(tmp_path: Path, method: Method) -> None:
    assert devices.settled(wanted(tmp_path, method=method, device="cuda")).deblur.device == "cpu"


def test_a_gpu_counts_in_the_fingerprint_however_it_was_chosen_and_the_processor_does_not(tmp_path: Path, there: bool) -> None:
    by_itself, cpu, cuda = (fingerprint.of_request(wanted(tmp_path, device=name)) for name in ("auto", "cpu", "cuda"))
    assert by_itself == (cuda if there else cpu)
    assert cuda != cpu
    stated = wanted(tmp_path).model_dump(mode="json", exclude={"source", "output", "overwrite", "origin"})
    del stated["deblur"]["device"]
    assert cpu == fingerprint.of_values({**stated, "rsvideo": fingerprint.version("rsvideo")})


def test_the_record_names_a_gpu_and_not_the_processor(tmp_path: Path) -> None:
    task = prepare(wanted(tmp_path, device="cpu"))
    assert "device" not in output.settings_record(task, "srgb").restoration
    on_gpu = replace(task, settings=replace(task.settings, device="cuda"))
    assert output.settings_record(on_gpu, "srgb").restoration["device"] == "cuda"


def test_a_gpu_that_is_stated_and_not_there_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "unavailable", lambda: "there is no NVIDIA driver")
    with pytest.raises(ValueError, match=r"device cuda cannot be used: there is no NVIDIA driver; --device cpu does without"):
        prepare(wanted(tmp_path, device="cuda"))


def test_what_a_gpus_memory_does_not_hold_is_computed_on_the_processor_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def carry_out(task: Task, _: object) -> Outcome:
        tried.append(task.settings.device)
        if task.settings.device == "cuda":
            raise DeviceMemoryError("it does not hold one tile of the frame")
        return Outcome(notes=("one",), seconds=1.0)

    task = prepare(wanted(tmp_path, device="cpu"))
    monkeypatch.setattr(deblur, "_kind", lambda _: SimpleNamespace(carry_out=carry_out))
    outcome = deblur.carry_out(replace(task, settings=replace(task.settings, device="cuda")), ignore)
    assert tried == ["cuda", "cpu"]
    note = "the GPU's memory did not do, all was computed on the processor (it does not hold one tile of the frame)"
    assert outcome.notes == ("one", note)


def test_a_host_without_memory_is_not_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def carry_out(*_: object) -> Outcome:
        raise MemoryError("of the host")

    monkeypatch.setattr(deblur, "_kind", lambda _: SimpleNamespace(carry_out=carry_out))
    with pytest.raises(MemoryError, match="of the host"):
        deblur.carry_out(prepare(wanted(tmp_path, device="cpu")), ignore)


def test_the_extra_the_driver_and_a_trial_are_needed_in_this_order(monkeypatch: pytest.MonkeyPatch) -> None:
    def why() -> str | None:
        device.take([])
        return device.unavailable()

    monkeypatch.setattr(device, "find_spec", lambda name: None if name == "cupy" else name)
    assert why() == "the extra gpu is not installed, there is no CuPy; pip install 'rsvideo[gpu]' brings it"
    monkeypatch.setenv(device.SIMULATOR, "1")
    assert why() is None
    assert devices.chosen("auto", Method.RSVIDEO) == "cpu"  # which nobody means by chance
    assert devices.chosen("cuda", Method.RSVIDEO) == "cuda"
    monkeypatch.delenv(device.SIMULATOR)
    monkeypatch.setattr(device, "find_spec", lambda name: name)
    monkeypatch.setattr(device, "_DRIVERS", ("libno_such_driver.so",))
    assert why() == "there is no NVIDIA driver"
    monkeypatch.setattr(device, "_loads", lambda _: True)
    monkeypatch.setattr(device, "_PROBE", "raise RuntimeError('no kernel image')")
    assert why() == "a trial on the GPU failed: RuntimeError: no kernel image"
    monkeypatch.setattr(device, "_PROBE", "pass")
    assert why() is None


def _unavailable(answers: Connection) -> None:
    answers.send(device.unavailable())


@pytest.mark.parametrize("why", [None, "there is no NVIDIA driver"])
def test_a_process_believes_the_trial_of_the_one_that_began_it(why: str | None) -> None:
    device.take([why])
    answers, process = processes.started(_unavailable, threads=1, quiet=True)
    assert answers.recv() == why
    process.join()


def test_a_gpu_that_is_stated_is_tried_before_processes_begin(tmp_path: Path) -> None:
    devices.settled(wanted(tmp_path, device="cpu"))
    assert not device.found()
    devices.settled(wanted(tmp_path, device="cuda"))
    assert len(device.found()) == 1


def test_the_trial_runs_no_module_that_lies_about(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trap, sprung = tmp_path / "cupy.py", tmp_path / "sprung"
    trap.write_text(f"open({str(sprung)!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    monkeypatch.setattr(device, "find_spec", lambda _: object())
    monkeypatch.setattr(device, "_loads", lambda _: True)
    device.unavailable()
    assert not sprung.exists()


def test_asking_for_a_device_starts_none_in_this_process() -> None:
    program = "import sys; from rsvideo.gpu import device; device.unavailable(); print({'cupy', 'numba', 'numba.cuda'} & {*sys.modules})"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip() == "set()"


def test_a_frame_goes_through_the_door_that_its_settings_name(monkeypatch: pytest.MonkeyPatch) -> None:
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=32)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=100.0, rows=32, cols=40))
    pixels = np.full((32, 40, 3), 0.5, np.float32)
    rest = still(timing.interval, degree=1, axes=2)
    on_processor, reached = nonblind.tiled(pixels, pixels > 1, rest, camera, samples=2, tolerance=0.25), []

    def tiled(*_: object, **how: object) -> BlurredFrame:
        reached.append(how["samples"])
        return on_processor

    monkeypatch.setattr(device_frame, "tiled", tiled)
    view, settings = to_scanlines(Frame(pixels=pixels, clipped=pixels > 1), camera), Settings(device="cuda")
    assert single_frame.tiled_frame(view, rest, settings) is on_processor
    assert reached == [settings.samples]
    assert single_frame.tiled_frame(view, rest, Settings()) is not on_processor
