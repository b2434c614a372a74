"""What can be done to a photograph or a clip, by name."""

import enum


class Method(enum.StrEnum):
    """The project's own restoration, and what people would do without it."""

    RSVIDEO = "rsvideo"  # each scanline deblurred with its own piece of one motion
    NONE = "none"  # decoded and encoded only
    UNIFORM = "uniform"  # one kernel a frame
    NONUNIFORM = "nonuniform"  # one density of camera poses a frame, as behind a global shutter
    STITCH = "stitch"  # blocks of rows with a kernel each, then stitched
    RECTIFY = "rectify"  # the rolling shutter's distortion alone
    RECTIFY_UNIFORM = "rectify+uniform"
    RECTIFY_NONUNIFORM = "rectify+nonuniform"
    VIDSTAB = "vidstab"  # whole frames steadied by FFmpeg's vid.stab, an extra
    VIDSTAB_UNIFORM = "vidstab+uniform"
    GYRO = "gyro"  # along the motion that a gyroscope has measured
    GYRO_REFINE = "gyro+refine"  # the project's own restoration, started there

    @property
    def rectifies(self) -> bool:
        """Whether frames are rectified first."""
        return self.startswith("rectify")

    @property
    def steadied(self) -> bool:
        """Whether vid.stab's frames take the place of the clip's."""
        return self.startswith("vidstab")

    @property
    def follows_gyro(self) -> bool:
        """Whether a gyroscope's log is needed."""
        return self.startswith("gyro")

    @property
    def knows_gpu(self) -> bool:
        """Whether latent images can be computed on a GPU."""
        return self in (Method.RSVIDEO, Method.GYRO, Method.GYRO_REFINE)

    @property
    def needs_lens(self) -> bool:
        """Whether a turn of the camera is more than a shift of the picture."""
        return self not in (Method.NONE, Method.UNIFORM, Method.STITCH, Method.VIDSTAB, Method.VIDSTAB_UNIFORM)

    @property
    def needs_clip(self) -> bool:
        """Whether the method finds the motion between frames."""
        return self.rectifies or self.steadied
