"""What a trajectory is estimated from: a grey frame along its scanlines, normalised, with the camera that took it."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

import numpy as np
from jaxtyping import Float

from rsvideo.physics.camera import Camera
from rsvideo.physics.channels import any_channel
from rsvideo.physics.luminance import luminance
from rsvideo.physics.noise_level import noise_level
from rsvideo.physics.tiles import Tile, split
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.resolution import halved_image, pose_factors
from rsvideo.restoration.scanlines import View
from rsvideo.restoration.settings import Device, Settings

WINDOW_COLS = 800  # with most texture, from which the motion is estimated and on which it is judged
TRIAL_COLS = 560  # of them, on which paths are compared
COARSE_REACH = 6.0  # px; blurs longer than this still show at half the resolution, where paths then run first
LONG_REACH = 40.0  # px; longer blurs are searched at a lower resolution, since the work grows with their square
WHITE = 99.5  # percentile of luminance that becomes 1; brighter pixels count as clipped; origin: by trial
DARKEST_WHITE = 1e-3  # linear light; a darker frame is not stretched to white
SAMPLES = 24  # path samples an exposure that suffice to estimate a path of up to as many px
TILED_COLS = 96  # a narrower frame is one tile
TILE_COLS = 180  # columns a tile, roughly: coarser than those of the final image, for the path is what counts; 120 is no better
FEWEST_TILES, MOST_TILES = 2, 6
RIDGE = 0.7  # rho of f over noise power / gradient power; the blurred frame keeps about a third of the latent gradients' power
LEAST_RIDGE, MOST_RIDGE = 1.5e-3, 0.1  # of rho; origin: by trial
SEARCH_RIDGE = 3.0  # times rho, while paths are searched and judged: origin: by trial
TEXTURE = 8.0  # times the noise's power, which a frame's gradients must exceed to show motion; origin: by trial
LARGEST = 720  # px, the longer side up to which a scene is judged as it is; a larger one is halved
FINEST = 960  # px, the same of a frame twice as large or more, whose blur would be too short to show; larger ones take too long
SHOWN = 4.0  # px of blur
SMALLEST = 160  # px, the shorter side up to which a scene is not halved for its blur
LEAST_TEXTURE = 1e-7  # and this, white being 1
_LEAST_POWER = 1e-12  # of gradients, white being 1; a frame without any divides by this


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A grey frame and the camera that took it, along its scanlines."""

    frame: Float[np.ndarray, "rows cols"]  # linear light, normalised so that its bright parts are 1
    valid: Float[np.ndarray, "rows cols"]  # 0 where clipped
    camera: Camera
    samples: int  # K, per exposure
    tiles: int  # for three axes
    noise: float  # standard deviation
    flow: Flow | None = None  # of points beyond the camera's path, in px of this frame
    chosen: tuple[int, ...] | None = None  # which of the tiles count; None: all
    scale: float = 1.0  # of the frame; paths stay in px of the frame before it was made smaller
    device: Device = "cpu"  # what computes latent images of it

    def unit(self, axes: int) -> Float[np.ndarray, " axes"]:
        """What a pose is multiplied with in this frame: (x, y) or (x, y, roll)."""
        return pose_factors(self.scale, axes)

    def scaled(self, trajectory: Trajectory) -> Trajectory:
        """The path in px of this frame."""
        return trajectory.with_coefficients(trajectory.coefficients * self.unit(trajectory.coefficients.shape[1]))

    def cut(self, count: int | None = None) -> list[Tile]:
        """The tiles that count; `count` is how many the whole frame is cut into where no choice among them was made."""
        if self.chosen is None:
            return split(self.frame.shape[1], count or self.tiles, 0)
        every = split(self.frame.shape[1], self.tiles, 0)
        return [every[k] for k in self.chosen]

    @property
    def counted(self) -> int:
        """How many pixels count."""
        return self.frame.shape[0] * sum(tile.last - tile.first for tile in self.cut())

    @cached_property
    def gradient_power(self) -> float:
        """Mean square of the gradients of the tiles that count."""
        if self.chosen is None:
            return gradient_power(self.frame)
        return float(np.mean([gradient_power(self.frame[:, tile.columns]) for tile in self.cut()]))

    @property
    def least_texture(self) -> float:
        """The mean square of gradients below which a frame, or a part of it, shows no motion."""
        return max(LEAST_TEXTURE, TEXTURE * self.noise**2)

    @property
    def textured(self) -> bool:
        """Whether there are gradients above the noise to measure motion by."""
        return self.gradient_power >= self.least_texture

    @property
    def ridge(self) -> float:
        """rho: the noise's power over that of the latent gradients."""
        return float(np.clip(RIDGE * self.noise**2 / max(self.gradient_power, _LEAST_POWER), LEAST_RIDGE, MOST_RIDGE))

    @property
    def search_ridge(self) -> float:
        """rho while paths are searched and judged."""
        return SEARCH_RIDGE * self.ridge


def gradient_power(image: Float[np.ndarray, "rows cols"]) -> float:
    """Mean square of the gradients."""
    return float((np.diff(image, axis=1) ** 2).mean() + (np.diff(image, axis=0) ** 2).mean())


def scene_of(view: View, settings: Settings, flow: Flow | None = None) -> Scene:
    """What the trajectory of a frame is estimated from."""
    grey = luminance(view.pixels)
    white = max(float(np.percentile(grey, WHITE)), DARKEST_WHITE)
    normalised = np.minimum(grey / white, 1).astype(np.float32)
    valid = ~(any_channel(view.clipped) | (grey >= white))
    return Scene(
        frame=normalised,
        valid=valid.astype(np.float32),
        camera=view.camera,
        samples=min(settings.samples, SAMPLES),
        flow=flow,
        tiles=min(_tile_count(grey.shape[1]), MOST_TILES),
        noise=noise_level(normalised) if view.camera.noise is None else view.noise / view.colour_noise / white,
        device=settings.device,
    )


def _tile_count(cols: int) -> int:
    """How many tiles so many columns are cut into."""
    return max(round(cols / TILE_COLS), FEWEST_TILES) if cols >= TILED_COLS else 1


def windowed(scene: Scene, cols: int | None = None) -> Scene:
    """The `cols` columns with most texture, WINDOW_COLS by default, where the frame is wider than that."""
    cols = WINDOW_COLS if cols is None else cols
    if scene.frame.shape[1] <= cols:
        return scene
    power = np.abs(np.diff(scene.frame, axis=1)).sum(axis=0)
    total = np.convolve(power, np.ones(cols - 1), "valid")
    first = int(np.argmax(total))
    part = slice(first, first + cols)
    lens = scene.camera.intrinsics
    return replace(
        scene,
        frame=np.ascontiguousarray(scene.frame[:, part]),
        valid=np.ascontiguousarray(scene.valid[:, part]),
        camera=replace(scene.camera, intrinsics=replace(lens, cx=lens.cx - first, cols=cols)),
        flow=scene.flow and scene.flow.from_column(first),
    )


def spread(scene: Scene, cols: int) -> Scene:
    """The scene, of whose tiles some count, `cols` columns of them together: from equal parts of the frame, side by side, those with
    most texture. Tiles far from one another tell a roll from a shift."""
    wide = scene.frame.shape[1]
    count = _tile_count(wide)
    wanted = min(max(FEWEST_TILES, round(cols / wide * count)), count)
    texture = [np.abs(np.diff(scene.frame[:, tile.columns], axis=1)).sum() for tile in split(wide, count, 0)]
    parts = np.array_split(np.arange(count), wanted)
    return replace(scene, tiles=count, chosen=tuple(int(max(part, key=texture.__getitem__)) for part in parts))


def halved_until_textured(scene: Scene) -> Scene | None:
    """The same, halved until its gradients exceed the noise: the blur has spread those of a noisy frame. None where they never do."""
    while not scene.textured:
        if min(scene.frame.shape) < 2 * SMALLEST:
            return None
        scene = halved(scene)
    return scene


def halved(scene: Scene, times: int = 1) -> Scene:
    """The same at half the resolution, all its columns; as often as wanted."""
    return _measured_anew(_smaller(scene, times)) if times else scene


def _measured_anew(scene: Scene) -> Scene:
    """The same with the noise that its frame shows, where the camera's is not given."""
    return replace(scene, noise=noise_level(scene.frame)) if scene.camera.noise is None else scene


def _smaller(scene: Scene, times: int) -> Scene:
    """The same, halved so often; its noise is taken to fall as that of independent pixels."""
    for _ in range(times):
        scene = Scene(
            frame=halved_image(scene.frame),
            valid=np.floor(halved_image(scene.valid)),  # where one of four is clipped, the whole is
            camera=scene.camera.halved(),
            samples=math.ceil(scene.samples / 2),
            tiles=max(1, round(scene.tiles / 2)),
            noise=scene.noise / 2,  # the mean of four independent pixels
            flow=scene.flow and scene.flow.scaled(0.5),
            scale=scene.scale / 2,
            device=scene.device,
        )
    return scene


def shrunk(scene: Scene, blur: float, most: float) -> Scene:
    """The same, halved until its blur, of `blur` px in the whole frame, has `most` px or fewer."""
    return halved(scene, _too_long(scene, blur, most))


def _too_long(scene: Scene, blur: float, most: float) -> int:
    """How many halvings that takes."""
    shortest = min(scene.frame.shape)
    return _halvings(lambda times: blur * scene.scale / 2**times > most and shortest >> times > SMALLEST)


def _halvings(large: Callable[[int], bool]) -> int:
    """How many it takes until a scene is not too large any more."""
    return next(times for times in count() if not large(times))


def reduced(scene: Scene, blur: float = 0.0) -> Scene:
    """The same, halved until its longer side has at most LARGEST px, and its blur, of `blur` px in the whole frame, at most SAMPLES.

    Where its blur would then be shorter than SHOWN px, it stays larger, up to FINEST px, once it is halved.
    It has as many path samples an exposure as its blur has px: fewer would make a comb of it.
    """
    longest = max(scene.frame.shape)

    def large(times: int) -> bool:
        short = times > 0 and 0 < blur * scene.scale / 2 ** (times + 1) < SHOWN
        return longest >> times > (FINEST if short else LARGEST)

    smaller = _smaller(scene, _halvings(large))
    smaller = _smaller(smaller, _too_long(smaller, blur, SAMPLES))
    scene = scene if smaller is scene else _measured_anew(smaller)  # once, for it takes longer than to halve it
    return replace(scene, samples=max(scene.samples, math.ceil(blur * scene.scale)))
