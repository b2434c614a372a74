"""On what latent images are computed: the processor, or an NVIDIA GPU. One clip is computed on one of them."""

from typing import Literal

from rsvideo.config.method import Method
from rsvideo.config.request import Request
from rsvideo.gpu import device

Device = Literal["cpu", "cuda"]


def check(request: Request) -> None:
    """Refuse a GPU that is stated and not there; ValueError."""
    if request.deblur.device == "cuda" and (why := device.unavailable()):
        raise ValueError(f"the device cuda cannot be used: {why}; --device cpu does without")


def chosen(wanted: Literal["auto", "cpu", "cuda"], method: Method) -> Device:
    """The device that is meant: a GPU only for methods that know one, and by itself only where a trial gave the right numbers."""
    if wanted == "cpu" or not method.knows_gpu:
        return "cpu"
    found = wanted == "cuda" or (not device.simulated() and device.unavailable() is None)
    return "cuda" if found else "cpu"


def settled(request: Request) -> Request:
    """The same with its device, which whoever carries it out then keeps to; a GPU is tried here, for all processes that are begun later."""
    taken = chosen(request.deblur.device, request.deblur.method)
    if taken == "cuda":
        device.unavailable()
    return request.replaced(deblur={"device": taken})
