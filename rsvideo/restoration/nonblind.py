"""The latent image of a frame whose trajectory is given (Sec. 4.3): exact solves in column tiles.

Each tile's normal matrix K^H K + rho D^T D is banded per horizontal frequency and factored once per trajectory and rho
(physics.row_fourier, solvers.banded). What no scanline samples is no data: latent rows above and below the frame are free,
and the columns beyond its sides, like clipped pixels, are completed from the model's own K l.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, Literal, no_type_check

import cv2
import numpy as np
from jaxtyping import Bool, Float

from rsvideo import threads
from rsvideo.physics import tiles
from rsvideo.physics.camera import Camera
from rsvideo.physics.channels import any_channel, planes
from rsvideo.physics.luminance import LIFT
from rsvideo.physics.row_fourier import Extent, Grid, RowFourier, extent, row_fourier
from rsvideo.physics.tiles import MadeAnew, Tile
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.blurred_frame import BlurredFrame
from rsvideo.restoration.parallax import Flow, displacement
from rsvideo.restoration.settings import Settings
from rsvideo.solvers.banded import BandedFactor, BandedHermitian
from rsvideo.solvers.collaborative_filter import Matches, denoise, match
from rsvideo.solvers.differences import Differences
from rsvideo.solvers.total_variation import LatentUpdate
from rsvideo.solvers.total_variation import total_variation as admm
from rsvideo.threads import loop, spread

WIDEST = 512  # columns of a tile, its overlaps aside: tiles are worked on side by side, and small ones stay in the processor's caches
LARGEST = 8e8  # bytes of a tile's symbol, normal matrix and factor
KEPT = 1.2e8  # bytes of the symbols of all tiles; where a frame needs more they are made anew on each pass, one by one, in no more time
OVERLAP = 24  # columns over which neighbouring tiles are blended; origin: by trial
TV_RHO = 0.03  # rho of the augmented Lagrangian, Eq. (17), in units of the data term; origin: by trial
TV_AHEAD = 0.8  # of a step of what is completed, by which it is carried on: it takes half as many; below 1, or it does not settle
TV_FLOOR = 1e-5  # added to the normal matrix, which keeps it positive definite where no scanline samples it
COARSEST = 0.03  # the splitting's first denoising strength, linear light; five steps from 0.03 to 0.006 were good with BM3D
COARSEST_NOISE = 3.0  # times the noise, which the first strength is at least; origin: by trial
FINEST_NOISE = 1.25  # times the noise: the last strength; origin: by trial
FINISH = 1.0  # times the noise, for a picture that neighbours have helped to
UNEXPLAINED = 10.0  # weight of the residual's power beyond the noise's; chosen, as the next, on half of a corpus of photographs
EXPLAINED = 1.5  # times the noise's power, which total variation leaves where the model holds: 0.6 to 1.5
RIM = 16  # rows and columns along a tile's sides, a quarter at most, where the residual is not measured; origin: by trial

SamplesOf = Callable[[Tile], tuple[Float[np.ndarray, "rows samples 2"], Float[np.ndarray, "rows samples"] | None]]
"""Where the scanlines of a tile sample the latent image, and with which weights; None: all the same."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TileSystem:
    """One tile's frame and blur."""

    op: RowFourier
    frame: Float[np.ndarray, "*channels rows cols"]
    valid: Float[np.ndarray, "*channels rows cols"]  # 1 where the sample is data, 0 where it is clipped

    def factor(self, rho: float, floor: float) -> BandedFactor:
        """Of K^H K + rho D^T D + floor I. K^H K is made anew for each: to keep it would take as much memory as K."""
        re, im = self.op.gram()
        normal = BandedHermitian(re=re, im=im, frequencies=self.op.frequencies)
        return normal.factor((rho * self.op.difference_power + floor).astype(np.float32), rho)

    def completed(self) -> Float[np.ndarray, "*channels rows period"]:
        """The frame, its sides joined smoothly."""
        frame, op = self.frame, self.op
        ramp = np.linspace(0, 1, op.period - op.cols + 2, dtype=np.float32)[1:-1]
        joined = np.concatenate([frame, frame[..., -1:] * (1 - ramp) + frame[..., :1] * ramp], axis=-1)
        return np.roll(joined, op.left, axis=-1)

    def complete(
        self,
        blurred: Float[np.ndarray, "*channels rows period"],
        before: Float[np.ndarray, "*channels rows period"] | None = None,
        ahead: float = 0.0,
    ) -> Float[np.ndarray, "*channels rows period"]:
        """The frame where it is data, K l elsewhere, carried on `ahead` of its step from what was completed `before`; a clipped pixel is
        at least as bright as it reads."""
        out = np.empty_like(blurred, order="C")
        images = self.frame, self.valid, blurred, blurred if before is None else before, out
        rows = [np.ascontiguousarray(image).reshape(-1, image.shape[-1]) for image in images]
        spread(_completed, len(rows[0]), *rows, np.float32(ahead), self.op.left, size=out.nbytes)
        return out

    def crop(self, latent: Float[np.ndarray, "*channels latent_rows period"]) -> Float[np.ndarray, "*channels rows cols"]:
        """The latent image on the tile's own pixels."""
        return self.op.crop(latent, self.op.rows, self.op.cols)

    def blurred(self, latent: Float[np.ndarray, "*channels latent_rows period"]) -> Float[np.ndarray, "*channels rows period"]:
        """K l."""
        return self.op.image(self.op.forward(self.op.spectrum(latent)))


@no_type_check
@loop(fastmath=False)
def _completed(first, last, frame, valid, blurred, before, out, ahead, left):
    """`TileSystem.complete`, of each row."""
    for r in range(first, last):
        for c in range(blurred.shape[1]):
            out[r, c] = blurred[r, c] + ahead * (blurred[r, c] - before[r, c])
        for c in range(frame.shape[1]):
            out[r, left + c] = frame[r, c] if valid[r, c] > 0 else max(out[r, left + c], frame[r, c])


def tile_system(
    offsets: Float[np.ndarray, "rows samples 2"],
    frame: Float[np.ndarray, "*channels rows cols"],
    valid: Float[np.ndarray, "*channels rows cols"],
    weights: Float[np.ndarray, "rows samples"] | None = None,
) -> TileSystem:
    """The system of a tile whose scanlines sample the latent image at `offsets`, all with the same weight by default."""
    return TileSystem(op=row_fourier(offsets, frame.shape[-1], weights=weights), frame=frame, valid=valid)


def exact_update(system: TileSystem, rho: float) -> LatentUpdate[np.ndarray]:
    """Step 1 of ADMM, argmin_l |K l - b|^2 / 2 + rho |D l - g|^2 / 2: one factor for all steps and channels."""
    op, factor = system.op, system.factor(rho, TV_FLOOR)

    def update(data: np.ndarray, h: np.ndarray, _: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        spectrum = factor.solve(op.adjoint(op.spectrum(data)) + op.spectrum(np.float32(rho) * h))
        blurred = op.image(op.forward(spectrum))
        return op.image(spectrum), system.complete(blurred, data, TV_AHEAD)

    return update


def total_variation(system: TileSystem, mu: float, *, steps: int) -> Float[np.ndarray, "*channels latent_rows period"]:
    """argmin_l |K l - b|^2 / 2 + mu |grad l|_1 by so many steps of ADMM (Algorithm 2), every l-update exact."""
    states = admm(
        system.completed(),
        mu=mu,
        rho=TV_RHO,
        gradient=Differences(periodic_cols=True),
        update=exact_update(system, TV_RHO),
        start=np.zeros((*system.frame.shape[:-2], system.op.latent_rows, system.op.period), np.float32),
    )
    return next(islice(states, steps, None)).latent


@dataclass(frozen=True, kw_only=True, eq=False)
class TiledFrame:
    """A frame as column tiles that overlap, each with its exact blur; they are worked on side by side, where memory holds them together."""

    pixels: Float[np.ndarray, "rows cols channels"]
    unclipped: Float[np.ndarray, "rows cols"]  # 1 where the samples of all channels are data
    cut: list[Tile]
    grids: Sequence[Grid]  # of each tile
    systems: Sequence[TileSystem]  # of each tile, all channels; made anew on each pass where they would take more than KEPT

    @property
    def device(self) -> Literal["cpu"]:
        """Where it is worked on."""
        return "cpu"

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rows, columns, channels."""
        rows, cols, channels = self.pixels.shape
        return rows, cols, channels

    def observed(self) -> tuple[Float[np.ndarray, "rows cols channels"], Float[np.ndarray, "rows cols"]]:
        """The frame b, and 1 where it is data in all channels."""
        return self.pixels, self.unclipped

    def blurred(self, image: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
        """K image, what lies beyond it continued from its borders."""
        out = np.empty_like(image)

        def blur(tile: Tile, system: TileSystem) -> None:
            b = system.blurred(system.op.extended(image[:, tile.columns]))
            out[:, tile.start : tile.stop] = b[:, system.op.left + tile.start - tile.first : system.op.left + tile.stop - tile.first]

        self._of_each(blur, self.cut)
        return out

    def covered(self) -> Float[np.ndarray, "rows cols"]:
        """K^T 1 over what is data in all channels: how much of each latent pixel's light was observed, 1 where all of it was."""
        data = self.unclipped
        out = np.empty_like(data)

        def cover(tile: Tile, system: TileSystem) -> None:
            op, end = system.op, system.op.left + system.op.cols
            shown = np.zeros((op.rows, op.period), np.float32)
            shown[:, op.left : end] = data[:, tile.columns]
            if tile.first:  # the frame goes on beyond the tile
                shown[:, : op.left] = shown[:, op.left, None]
            if tile.last < data.shape[1]:
                shown[:, end:] = shown[:, end - 1, None]
            light = op.image(op.adjoint(op.spectrum(shown)))[op.top : op.top + op.rows, op.left : end]
            out[:, tile.start : tile.stop] = light[:, tile.start - tile.first : tile.stop - tile.first]

        self._of_each(cover, self.cut)
        return out

    def towards(self, target: Float[np.ndarray, "rows cols channels"], ridge: float) -> Float[np.ndarray, "rows cols channels"]:
        """argmin_l |K l - b|^2 + ridge |l - target|^2."""

        def solved(tile: Tile, system: TileSystem) -> np.ndarray:
            aim = planes(target, tile.columns)
            return system.crop(_towards(system, system.op.extended(aim), aim, ridge)).copy()  # without what lies beyond the frame

        return self._joined(self._of_each(solved, self.cut))

    def total_variation(self, mu: float, *, steps: int) -> list[np.ndarray]:
        """The latent images of each tile under total variation."""
        return self._of_each(lambda _, system: total_variation(system, mu, steps=steps), self.cut)

    def nearest(self, latents: list[np.ndarray], target: Float[np.ndarray, "rows cols channels"], ridge: float) -> list[np.ndarray]:
        """argmin_l |K l - b|^2 + ridge |l - target|^2; beyond the frame the target is the latent image itself."""
        given = list(zip(latents, self.cut, strict=True))
        return self._of_each(lambda each, system: _towards(system, each[0], planes(target, each[1].columns), ridge), given)

    def blended(self, latents: list[np.ndarray]) -> Float[np.ndarray, "rows cols channels"]:
        """The picture that the tiles' latent images make."""
        sides = [(self.shape[0], tile.last - tile.first) for tile in self.cut]
        return self._joined([grid.crop(latent, *side) for grid, latent, side in zip(self.grids, latents, sides, strict=True)])

    def _joined(self, pictures: list[np.ndarray]) -> Float[np.ndarray, "rows cols channels"]:
        """Pictures (channels, rows, tile) of the tiles joined over their overlaps by linear weights."""
        rows, cols, channels = self.shape
        image, total = np.zeros((channels, rows, cols), np.float32), np.zeros(cols, np.float32)
        for tile, picture in zip(self.cut, pictures, strict=True):
            weight = tile.weight(OVERLAP)
            total[tile.columns] += weight
            image[..., tile.columns] += weight * picture
        image /= total
        return cv2.merge([*image]).reshape(self.shape)

    def unexplained(self, latents: list[np.ndarray]) -> float:
        """The mean square of b - K l over what was observed, away from the tiles' sides, in all channels."""

        def residual(latent: np.ndarray, system: TileSystem) -> tuple[float, float]:
            op = system.op
            blurred = system.blurred(latent)[..., op.left : op.left + op.cols]
            down, across = min(RIM, op.rows // 4), min(RIM, op.cols // 4)
            inner = np.s_[..., down : op.rows - down, across : op.cols - across]
            return float(np.sum((system.valid * (blurred - system.frame))[inner] ** 2)), float(system.valid[inner].sum())

        totals, counts = zip(*self._of_each(residual, latents), strict=True)
        return sum(totals) / max(sum(counts), 1.0)

    def _of_each(self, work: Callable[[Any, TileSystem], Any], given: Sequence[Any]) -> list[Any]:
        """What the work makes of what is given for each tile, and of the tile's system."""
        if isinstance(self.systems, MadeAnew):
            return [work(each, system) for each, system in zip(given, self.systems, strict=True)]
        return threads.each(lambda k: work(given[k], self.systems[k]), range(len(given)))

    def match(self, guide: Float[np.ndarray, "rows cols channels"]) -> Matches:
        """Which patches of a picture look like which."""
        return match(guide)

    def denoise(
        self,
        image: Float[np.ndarray, "rows cols channels"],
        sigma: float,
        *,
        pilot: Float[np.ndarray, "rows cols channels"] | None = None,
        matches: Matches | None = None,
    ) -> Float[np.ndarray, "rows cols channels"]:
        """A picture without noise of standard deviation `sigma`."""
        return denoise(image, sigma, pilot=pilot, matches=matches)

    def from_host(self, image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols channels"]:
        """The same: it lies there."""
        return image

    def to_host(self, image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols channels"]:
        """The same: it lies there."""
        return image


def tiled(
    pixels: Float[np.ndarray, "rows cols channels"],
    clipped: Bool[np.ndarray, "rows cols channels"],
    trajectory: Trajectory,
    camera: Camera,
    *,
    samples: int,
    tolerance: float,
    flow: Flow | None = None,
) -> TiledFrame:
    """The frame with its blur along `trajectory`, and the `flow` beyond it; tolerance is the largest error in px at a tile's edge."""

    def samples_of(tile: Tile) -> tuple[Float[np.ndarray, "rows samples 2"], None]:
        return displacement(tile, trajectory, flow, camera, samples), None

    cut = cut_for(trajectory, camera, tolerance, flow, least=math.ceil(pixels.shape[1] / WIDEST))
    while max(each.system_bytes for each in _extents(cut, samples_of)) > LARGEST and 2 * len(cut) * tiles.NARROWEST <= pixels.shape[1]:
        cut = cut_for(trajectory, camera, tolerance, flow, least=2 * len(cut))
    return tiled_from(cut, samples_of, pixels, clipped)


def cut_for(trajectory: Trajectory, camera: Camera, tolerance: float, flow: Flow | None = None, least: int = 1) -> list[Tile]:
    """The tiles, `least` or more, at whose edges a blur's error is `tolerance` px at most."""
    count = max(tiles.tiles_needed(trajectory, camera, tolerance), flow.tiles_needed(camera, tolerance) if flow else 1, least)
    return tiles.split(camera.intrinsics.cols, count, OVERLAP)


def tiled_from(
    cut: list[Tile],
    samples_of: SamplesOf,
    pixels: Float[np.ndarray, "rows cols channels"],
    clipped: Bool[np.ndarray, "rows cols channels"],
) -> TiledFrame:
    """The frame whose scanlines sample the latent image, in each tile, at those offsets with those weights."""
    frame, valid = planes(pixels), 1 - planes(clipped)

    def made(k: int) -> TileSystem:
        offsets, weights = samples_of(cut[k])
        return tile_system(offsets, frame[..., cut[k].columns], valid[..., cut[k].columns], weights)

    reaches = _extents(cut, samples_of)
    together = sum(each.symbol_bytes for each in reaches) <= KEPT
    systems = threads.each(made, range(len(cut))) if together else MadeAnew(made, len(cut))
    unclipped = (~any_channel(clipped)).astype(np.float32)
    return TiledFrame(pixels=pixels, unclipped=unclipped, cut=cut, grids=reaches, systems=systems)


def _extents(cut: list[Tile], samples_of: SamplesOf) -> list[Extent]:
    return [extent(samples_of(tile)[0], tile.last - tile.first) for tile in cut]


def deblur(frame: BlurredFrame, settings: Settings, noise: float) -> Iterator[Any]:
    """The latent image under total variation, and after each splitting step, at the pose where the trajectory is 0.

    The image is the frame's kind of picture; `frame.to_host` makes an array of it. `noise` is its standard deviation in linear
    light, and counts for more where the blur's model leaves more unexplained, as with pictures that were compressed.
    """
    latents = frame.total_variation(settings.final_mu, steps=settings.tv_steps)
    image = frame.blended(latents)
    yield image
    if not settings.splittings:
        return
    noise = math.sqrt(noise**2 + UNEXPLAINED * max(frame.unexplained(latents) - EXPLAINED * noise**2, 0))
    pilot = matches = None
    for sigma in np.geomspace(max(COARSEST, COARSEST_NOISE * noise), FINEST_NOISE * noise, settings.splittings):
        root, strength = _lifted(image, float(sigma))
        matches = matches or frame.match(root)  # once: which patches look alike hardly changes
        pilot = frame.denoise(root, strength, matches=matches) if pilot is None else pilot
        pilot = frame.denoise(root, strength, pilot=pilot, matches=matches)
        smooth = _lowered(pilot)
        latents = frame.nearest(latents, smooth, float(noise**2 / sigma**2))
        image = frame.blended(latents)
        yield 0.5 * (image + smooth)


def finished(frame: BlurredFrame, latent: Any, noise: float) -> Any:
    """The last splitting step alone, of a latent image that has little noise left: it is its own pilot. Both are the frame's kind of
    picture; `noise` is as in `deblur`."""
    root, strength = _lifted(latent, FINISH * noise)
    smooth = _lowered(frame.denoise(root, strength, pilot=root))
    return 0.5 * (frame.towards(smooth, 1 / FINISH**2) + smooth)


def _lifted(image: Any, sigma: float) -> tuple[Any, float]:
    """A picture as the denoiser works on it, and how strong noise of `sigma` is there."""
    root = np.sqrt(np.maximum(image, 0) + LIFT)
    return root, float(sigma / (2 * np.median(root)))


def _lowered(root: Any) -> Any:
    return (root * root - LIFT).astype(np.float32)


def _towards(
    system: TileSystem,
    latent: Float[np.ndarray, "channels latent_rows period"],
    target: Float[np.ndarray, "channels rows cols"],
    ridge: float,
) -> Float[np.ndarray, "channels latent_rows period"]:
    """argmin_l |K l - b|^2 + ridge |l - target|^2; beyond the frame the target is the latent image itself."""
    op, factor = system.op, system.factor(0, ridge)
    aim = latent.copy()
    system.crop(aim)[:] = target
    data = system.complete(system.blurred(latent))
    return op.image(factor.solve(op.adjoint(op.spectrum(data)) + np.float32(ridge) * op.spectrum(aim)))
