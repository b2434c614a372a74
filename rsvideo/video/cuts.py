"""Where a clip changes from one scene to another."""

from collections.abc import Iterable, Iterator

import cv2
import numpy as np

from rsvideo.video.stream import Colour, Picture

_THUMB = (32, 18)  # px
_LEAST = 0.1  # of the range of codes, the mean change of a thumbnail at a cut
_TIMES = 4.0  # as much as the frames about it change
_ABOUT = 4  # changes before a cut, and after it, that it is compared with; origin: by trial


def cuts(pictures: Iterable[Picture], colour: Colour) -> Iterator[int]:
    """The index of each picture that begins another scene."""
    indices, changes, before = [], [], None
    for picture in pictures:
        thumb = cv2.resize(np.asarray(picture.planes[0], np.float32), _THUMB, interpolation=cv2.INTER_AREA)
        if before is not None:
            indices.append(picture.index)
            changes.append(float(np.abs(thumb - before).mean()) / (1.0 if colour.floating else colour.top))
        before = thumb
    for k, (index, change) in enumerate(zip(indices, changes, strict=True)):
        about = changes[max(k - _ABOUT, 0) : k] + changes[k + 1 : k + 1 + _ABOUT]
        if change > _LEAST and (not about or change > _TIMES * float(np.median(about))):
            yield index
