"""Several clips side by side in one small H.264 file, for a page to play."""

import io
from dataclasses import dataclass
from fractions import Fraction

import av
import cv2
import numpy as np
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from jaxtyping import UInt8

WIDEST, HIGHEST = 1920, 2160  # px of the whole
_GAP = 4  # px between tiles
_FEW = 4  # tiles up to which two stand side by side; more stand three by three
_GREY = 32  # of 255, behind the tiles
_LEAST_SECONDS = 1e-3  # of a film, however short
_LEAST_BITS = 50_000  # a second; a page may grow beyond its share rather than show nothing
_FILLED = 0.9  # of the bytes, which the pictures may take: the container and the encoder's error take the rest; origin: by trial

Tile = UInt8[np.ndarray, "rows cols 3"]  # red, green, blue


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Where tiles stand: row by row, `across` in each."""

    tiles: int
    rows: int  # of a tile
    cols: int
    across: int

    @classmethod
    def fitting(cls, tiles: int, rows: int, cols: int) -> "Grid":
        """The grid in which tiles of that shape can be largest."""

        def scale(across: int) -> float:
            down = -(-tiles // across)
            return min(1.0, (WIDEST - (across - 1) * _GAP) / (across * cols), (HIGHEST - (down - 1) * _GAP) / (down * rows))

        wide = 2 if tiles <= _FEW else 3
        across = min(tiles, wide)
        s = scale(across)
        return cls(tiles=tiles, rows=max(2, int(s * rows) & ~1), cols=max(2, int(s * cols) & ~1), across=across)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the whole."""
        down = -(-self.tiles // self.across)
        return down * self.rows + (down - 1) * _GAP, self.across * self.cols + (self.across - 1) * _GAP


class Mosaic:
    """Takes the tiles of one instant after the other; `close` hands over the file."""

    def __init__(self, grid: Grid, rate: Fraction, *, most_bytes: int, frames: int) -> None:
        self._grid, self._file = grid, io.BytesIO()
        self._container = av.open(self._file, "w", format="mp4")
        rows, cols = grid.shape
        seconds = max(_LEAST_SECONDS, frames / float(rate))
        bits = str(max(_LEAST_BITS, int(_FILLED * 8 * most_bytes / seconds)))
        stream = self._container.add_stream("libx264", rate=rate)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height, stream.pix_fmt = cols + cols % 2, rows + rows % 2, "yuv420p"
        stream.options = {"crf": "20", "preset": "veryfast", "maxrate": bits, "bufsize": bits, "threads": "2", "g": "48"}
        context = stream.codec_context
        context.color_primaries = context.color_trc = context.colorspace = 1  # BT.709
        self._stream, self._count = stream, 0

    def write(self, tiles: list[Tile | None]) -> None:
        """One instant; a tile that is missing stays grey."""
        grid = self._grid
        canvas = np.full((self._stream.height, self._stream.width, 3), _GREY, np.uint8)
        for n, tile in enumerate(tiles):
            if tile is not None:
                top, left = n // grid.across * (grid.rows + _GAP), n % grid.across * (grid.cols + _GAP)
                same = tile.shape[:2] == (grid.rows, grid.cols)
                small = tile if same else cv2.resize(tile, (grid.cols, grid.rows), interpolation=cv2.INTER_AREA)
                canvas[top : top + grid.rows, left : left + grid.cols] = small
        frame = VideoFrame.from_ndarray(canvas, format="rgb24").reformat(format="yuv420p", dst_colorspace="ITU709")
        frame.pts, frame.time_base = self._count, 1 / self._stream.average_rate if self._stream.average_rate else Fraction(1, 24)
        self._count += 1
        self._container.mux(self._stream.encode(frame))

    def close(self) -> bytes:
        """The file."""
        self._container.mux(self._stream.encode(None))
        self._container.close()
        return self._file.getvalue()
