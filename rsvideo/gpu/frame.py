"""The final image of a frame on the device: all tiles and all channels at once, or as many tiles as its memory holds.

The twin of `rsvideo.restoration.nonblind.TiledFrame`. All tiles share one grid, so a latent image is (tiles, channels, latent rows,
period); a picture is (channels, rows, cols). Both are float32 on the device, from `total_variation` until `to_host`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float32

from rsvideo.gpu import arrays
from rsvideo.gpu.arrays import Array, OutOfMemory, xp
from rsvideo.gpu.banded import BandedFactor, BandedHermitian
from rsvideo.gpu.collaborative_filter import Matches, denoise, match
from rsvideo.gpu.device import DeviceMemoryError
from rsvideo.gpu.row_fourier import RowFourier, row_fourier
from rsvideo.gpu.total_variation import completed, joined, split
from rsvideo.physics.channels import any_channel
from rsvideo.physics.row_fourier import Extent, extent
from rsvideo.physics.tiles import Tile

_IMAGES = 16  # latent images that a step of ADMM holds at a time, roughly
_SHARE = 0.8  # of the device's free memory that may be planned with


@dataclass(frozen=True, kw_only=True)
class Weights:
    """What the restoration has chosen; `rsvideo.restoration.nonblind` says of each what it is."""

    rho: float
    floor: float
    ahead: float  # of a step of what is completed
    overlap: int  # columns
    rim: int  # rows and columns


@dataclass(frozen=True, kw_only=True, eq=False)
class System:
    """Some of a frame's tiles: their blur, their normal matrices and what was observed of them."""

    op: RowFourier
    normal: BandedHermitian  # K^H K
    widths: tuple[int, ...]  # columns of each tile
    frame: Array  # (tiles, channels, rows, period); 0 beyond each tile's columns
    data: Array  # where that was observed
    least: Array  # what a pixel is at least: as it reads; minus infinity beyond the columns

    @staticmethod
    def of(
        offsets: Float32[np.ndarray, "tiles rows samples 2"], reach: Extent, frames: Sequence[Array], valid: Sequence[Array]
    ) -> "System":
        """Of tiles (channels, rows, cols), all here or all on the device, whose scanlines sample the latent image at `offsets`."""
        op, at = row_fourier(offsets, reach), np if isinstance(frames[0], np.ndarray) else xp
        shape = (len(frames), *frames[0].shape[:2], op.period)
        frame, data, least = at.zeros(shape, np.float32), at.zeros(shape, bool), at.full(shape, -np.inf, np.float32)
        for t, (pixels, observed) in enumerate(zip(frames, valid, strict=True)):
            columns = slice(op.left, op.left + pixels.shape[2])
            frame[t, ..., columns] = least[t, ..., columns] = pixels
            data[t, ..., columns] = observed
        widths = tuple(pixels.shape[2] for pixels in frames)
        frame, data, least = map(xp.asarray, (frame, data, least))
        return System(op=op, normal=BandedHermitian(band=op.gram()), widths=widths, frame=frame, data=data, least=least)

    def completed(self) -> Array:
        """The frame, its sides joined smoothly: beyond the last column linearly to the first one, about the period."""
        op, widths = self.op, np.array(self.widths)[:, None]
        beyond = (np.arange(op.period) - op.left - widths) % op.period + 1  # columns behind the last one
        ramp = (beyond / (op.period - widths + 1)).astype(np.float32)
        ramp, own = (xp.asarray(each[:, None, None]) for each in (ramp, beyond > op.period - widths))
        last = self.frame[np.arange(len(widths)), ..., op.left + widths[:, 0] - 1][..., None]
        first = self.frame[..., op.left : op.left + 1]
        return xp.where(own, self.frame, last * (1 - ramp) + first * ramp)

    def complete(self, blurred: Array, before: Array | None = None, ahead: float = 0.0) -> Array:
        """The frame where it is data, elsewhere K l and `ahead` times its step from `before`; a clipped pixel is at least as it reads."""
        return completed(self.data, self.frame, self.least, blurred, blurred if before is None else before, ahead)

    def factor(self, rho: float, floor: float) -> BandedFactor:
        """Of K^H K + rho D^T D + floor I."""
        return self.normal.factor(xp.asarray((rho * self.op.difference_power + floor).astype(np.float32)), rho)

    def blur(self, latent: Array) -> Array:
        """K l, image to image."""
        return self.op.image(self.op.forward(self.op.spectrum(latent)))

    def total_variation(self, mu: float, weights: "Weights", steps: int) -> Array:
        """argmin_l |K l - b|^2 / 2 + mu |grad l|_1 by so many steps of ADMM (Algorithm 2), every l-update exact."""
        op, rho, factor = self.op, weights.rho, self.factor(weights.rho, weights.floor)
        b = self.completed()
        latent = xp.zeros((*b.shape[:2], op.latent_rows, op.period), xp.float32)
        u, g = (xp.zeros((2, *latent.shape), xp.float32) for _ in range(2))  # g = j - u
        for _ in range(steps):
            spectrum = factor.solve(op.adjoint(op.spectrum(b)) + op.spectrum(joined(g, rho)))
            latent, blurred = op.image(spectrum), op.image(op.forward(spectrum))
            b = self.complete(blurred, b, weights.ahead)
            split(latent, mu / rho, u, g)
        return latent

    def nearest(self, latent: Array, aim: Array, ridge: float) -> Array:
        """argmin_l |K l - b|^2 + ridge |l - aim|^2, the frame completed by K latent."""
        op, factor = self.op, self.factor(0.0, ridge)
        data = op.spectrum(self.complete(self.blur(latent)))
        return op.image(factor.solve(op.adjoint(data) + xp.float32(ridge) * op.spectrum(aim)))


class DeviceFrame:
    """A frame as column tiles that overlap, each with its exact blur."""

    def __init__(
        self,
        cut: list[Tile],
        offsets: Float32[np.ndarray, "tiles rows samples 2"],
        pixels: Float[np.ndarray, "rows cols channels"],
        clipped: Bool[np.ndarray, "rows cols channels"],
        weights: Weights,
    ) -> None:
        self.cut, self.weights = cut, weights
        self.offsets, self.reach = offsets, extent(offsets, max(tile.last - tile.first for tile in cut))
        self._pixels, self._clipped = pixels, clipped
        self.planes, self.data = self.from_host(pixels), xp.ascontiguousarray(xp.moveaxis(xp.asarray(~clipped), 2, 0))
        self._at_a_time = len(cut)  # tiles; fewer once memory has run out
        self._kept: System | None = None  # of all tiles, where they are worked on at once

    @property
    def device(self) -> Literal["cuda"]:
        """Where it is worked on."""
        return "cuda"

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rows, columns, channels."""
        rows, cols, channels = self._pixels.shape
        return rows, cols, channels

    def observed(self) -> tuple[Float[np.ndarray, "rows cols channels"], Float[np.ndarray, "rows cols"]]:
        """The frame b, and 1 where it is data in all channels, both in the host's memory."""
        return self._pixels, (~any_channel(self._clipped)).astype(np.float32)

    def from_host(self, image: Float[np.ndarray, "rows cols channels"]) -> Array:
        """A picture on the device."""
        return arrays.planes_to_device(image)

    def to_host(self, image: Array) -> Float[np.ndarray, "rows cols channels"]:
        """A picture in the host's memory."""
        return arrays.planes_to_host(image)

    def match(self, guide: Array) -> Matches:
        """Which patches of a picture look like which."""
        return match(guide)

    def denoise(self, image: Array, sigma: float, *, pilot: Array | None = None, matches: Matches | None = None) -> Array:
        """A picture without noise of standard deviation `sigma`."""
        return denoise(image, sigma, pilot=pilot, matches=matches)

    def total_variation(self, mu: float, *, steps: int) -> Array:
        """The latent images of all tiles under total variation."""
        return self._of_all(lambda system, _: system.total_variation(mu, self.weights, steps))

    def nearest(self, latents: Array, target: Array, ridge: float) -> Array:
        """argmin_l |K l - b|^2 + ridge |l - target|^2; beyond the frame the target is the latent image itself."""

        def solved(system: System, some: slice) -> Array:
            aim = latents[some].copy()
            for t, tile in enumerate(self.cut[some]):
                self._crop(aim[t], tile)[...] = target[..., tile.columns]
            return system.nearest(latents[some], aim, ridge)

        return self._of_all(solved)

    def blended(self, latents: Array) -> Array:
        """The tiles' latent images joined over their overlaps by linear weights."""
        rows, cols, channels = self.shape
        image, total = xp.zeros((channels, rows, cols), xp.float32), np.zeros(cols, np.float32)
        for tile, latent in zip(self.cut, latents, strict=True):
            weight = tile.weight(self.weights.overlap)
            total[tile.columns] += weight
            image[..., tile.columns] += xp.asarray(weight) * self._crop(latent, tile)
        return image / xp.asarray(total)

    def unexplained(self, latents: Array) -> float:
        """The mean square of b - K l over what was observed, away from the tiles' sides, in all channels."""
        blurred = self._of_all(lambda system, some: system.blur(latents[some]))
        totals, counts = [], []  # on the device, which is waited for once
        for tile, b in zip(self.cut, blurred, strict=True):
            rows, cols = self.shape[0], tile.last - tile.first
            down, across = min(self.weights.rim, rows // 4), min(self.weights.rim, cols // 4)
            inner = np.s_[:, down : rows - down, tile.first + across : tile.last - across]
            data = self.data[inner]
            model = b[:, down : rows - down, self.reach.left + across : self.reach.left + cols - across]
            totals.append(xp.sum(data * (model - self.planes[inner]) ** 2))
            counts.append(data.sum())
        return float(xp.stack(totals).sum()) / max(float(xp.stack(counts).sum()), 1.0)

    def blurred(self, image: Array) -> Array:
        """K image (rows, cols), what lies beyond it continued from its borders."""
        wide = self._extended(image[None])
        whole = self._of_all(lambda system, some: system.blur(wide[some]))
        out = xp.empty_like(image)
        for tile, b in zip(self.cut, whole, strict=True):
            own = slice(self.reach.left + tile.start - tile.first, self.reach.left + tile.stop - tile.first)
            out[:, tile.start : tile.stop] = b[0][:, own]
        return out

    def covered(self) -> Float[np.ndarray, "rows cols"]:
        """K^T 1 over what is data in all channels: how much of each latent pixel's light was observed, 1 where all of it was."""
        data = self.data.min(axis=0)
        rows, cols = data.shape
        shown = xp.zeros((len(self.cut), 1, rows, self.reach.period), xp.float32)
        for t, tile in enumerate(self.cut):
            end = self.reach.left + tile.last - tile.first
            shown[t, 0, :, self.reach.left : end] = data[:, tile.columns]
            if tile.first:  # the frame goes on beyond the tile
                shown[t, 0, :, : self.reach.left] = data[:, tile.first, None]
            if tile.last < cols:
                shown[t, 0, :, end:] = data[:, tile.last - 1, None]
        whole = self._of_all(lambda system, some: system.op.image(system.op.adjoint(system.op.spectrum(shown[some]))))
        out = xp.empty((rows, cols), xp.float32)
        for tile, light in zip(self.cut, whole, strict=True):
            own = self._crop(light, tile)[0]
            out[:, tile.start : tile.stop] = own[:, tile.start - tile.first : tile.stop - tile.first]
        return arrays.to_host(out)

    def towards(self, target: Array, ridge: float) -> Array:
        """argmin_l |K l - b|^2 + ridge |l - target|^2."""
        aim = self._extended(target)
        return self.blended(self._of_all(lambda system, some: system.nearest(aim[some], aim[some], ridge)))

    def _crop(self, latent: Array, tile: Tile) -> Array:
        """A tile's latent image on the tile's own pixels."""
        top, left = self.reach.top, self.reach.left
        return latent[..., top : top + self.shape[0], left : left + tile.last - tile.first]

    def _extended(self, image: Array) -> Array:
        """Each tile's part of a picture, continued from its borders over all that is solved for."""
        reach, rows = self.reach, self.shape[0]
        down = (reach.top, reach.latent_rows - reach.top - rows)
        return xp.stack(
            [
                xp.pad(
                    image[..., tile.columns],
                    ((0, 0), down, (reach.left, reach.period - reach.left - (tile.last - tile.first))),
                    mode="edge",
                )
                for tile in self.cut
            ]
        )

    def _of_all(self, work: Callable[[System, slice], Array]) -> Array:
        """What the work makes of all tiles, as many at a time as memory holds; raises DeviceMemoryError where it does not hold one."""
        while True:
            try:
                groups = [slice(first, first + self._at_a_time) for first in range(0, len(self.cut), self._at_a_time)]
                parts = [work(self.system(some), some) for some in groups]
                return parts[0] if len(parts) == 1 else xp.concatenate(parts)
            except OutOfMemory as error:
                if self._at_a_time == 1:
                    raise DeviceMemoryError("it does not hold one tile of the frame") from error
            self._kept, self._at_a_time = None, self._at_a_time // 2
            arrays.release()

    def system(self, some: slice) -> System:
        """Of these tiles; kept where they are all."""
        if self._kept:
            return self._kept
        tiles = self.cut[some]
        frames, valid = ([whole[..., tile.columns] for tile in tiles] for whole in (self.planes, self.data))
        reach = self.reach.part(some.start, some.stop)
        system = System.of(self.offsets[some], reach, frames, valid)
        if len(tiles) == len(self.cut):
            self._kept = system
        return system


def fits(offsets: Float32[np.ndarray, "tiles rows samples 2"], cols: int, channels: int) -> bool:
    """Whether the device's free memory holds one tile of `cols` columns: its symbol, normal matrix and factor, and the images of a step."""
    reach = extent(offsets, cols)
    return reach.system_bytes + 4 * _IMAGES * channels * reach.latent_rows * reach.period <= _SHARE * arrays.free_bytes()
